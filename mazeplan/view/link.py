"""The line between a run and its page, which is a process of its own: what a page costs, it costs there.

    run's thread --take--> queue --one thread--> pipe --> page        page --orders--> pipe --one thread--> on_order

`take` only puts a message into a queue. Where the page does not keep up, or hangs, the queue is full after a while, and
ticks and plans are left out; what begins and ends a run, and what happens rarely, is kept longer.
"""

from __future__ import annotations

import os
import socket
import sys
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from time import sleep
from typing import Any

from mazeplan.view.door import Door
from mazeplan.view.livetab import STATE, Offer, Order
from mazeplan.view.process import live_page

FREQUENT = frozenset({"/tick", "/plan", "/status"})
WAITING, MOST = 300, 5000  # messages in the queue beyond which frequent ones, or all, are left out
PAUSE_S = 0.015  # between looks into the queue: no lock, so that nobody ever waits for it
END_S = 2.0  # s that the page has to end by itself


class PageLink:
    """A page of its own process for one offer; a context manager. on_order: called in a thread of its own with what
    somebody pressed; `opened` is set when the first browser shows the page, `ended` when the page is no more."""

    def __init__(self, offer: Offer, door: Door, listening: socket.socket, on_order: Callable[[Order], object]) -> None:
        self.opened, self.ended = threading.Event(), threading.Event()
        self.viewers = 0  # browsers that show the page
        self._on_order, self._closing = on_order, False
        self._queue: deque[tuple[str, dict[str, Any]]] = deque()
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(
            target=live_page, args=(offer, door, listening, theirs), name="mazeplan page", daemon=True
        )
        self._process.start()
        theirs.close()
        for work in (self._send, self._receive):
            threading.Thread(target=work, name=f"mazeplan page {work.__name__}", daemon=True).start()

    def take(self, topic: str, t: float, document: dict[str, Any]) -> None:
        """A message of a run, for the page; returns at once (`data.runlog.Take`)."""
        waiting = len(self._queue)
        if waiting < WAITING or (waiting < MOST and topic not in FREQUENT):
            self._queue.append((topic, document))

    def tell(self, phase: str, note: str = "") -> None:
        """How the session stands: phase is idle, failed (the last run could not), starting or running."""
        self.take(STATE, 0.0, {"phase": phase, "note": note})

    def _send(self) -> None:
        while not self.ended.is_set():
            batch = [self._queue.popleft() for _ in range(len(self._queue))]
            if batch and not _sent(self._pipe, batch):
                return
            sleep(PAUSE_S)

    def _receive(self) -> None:
        while True:
            try:
                order = self._pipe.recv()
            except (EOFError, OSError):
                self.ended.set()
                if not self._closing:
                    with suppress(OSError):
                        print("mazeplan: the page has ended; the run goes on without it", file=sys.stderr)
                return
            if order["do"] == "viewers":
                self.viewers = order["count"]
                if self.viewers:
                    self.opened.set()
            else:
                self._on_order(order)

    def close(self) -> None:
        """End the page."""
        self._closing = True
        self.ended.set()
        with suppress(OSError), socket.socket(fileno=os.dup(self._pipe.fileno())) as line:
            line.shutdown(socket.SHUT_RDWR)  # closing alone ends no call that waits for the other end
        self._process.join(END_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._pipe.close()

    def __enter__(self) -> PageLink:
        return self

    def __exit__(self, *problem: object) -> None:
        self.close()


def _sent(pipe: Connection, batch: list[tuple[str, dict[str, Any]]]) -> bool:
    try:
        pipe.send(batch)
    except (OSError, ValueError):
        return False
    return True
