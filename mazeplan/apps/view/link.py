"""The line between a run and its page. The page is a process of its own, so that it costs the run no time.

    run's thread --take--> queue --one thread--> pipe --> page        page --orders--> pipe --one thread--> on_order

`take` only puts a message into a queue. If the page is too slow, or hangs, the queue fills. Then `take` drops ticks,
plans and statuses. If the queue fills further, `take` also drops rare messages, such as the beginning of a run.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from time import sleep
from typing import Any

from mazeplan.apps.view.livetab import STATE, LiveTab, Offer, Order

FREQUENT = frozenset({"/tick", "/plan", "/status"})
WAITING, MOST = 300, 5000  # with this many messages in the queue, frequent messages (WAITING) or all (MOST) are dropped
PAUSE_S = 0.015  # s between looks into the queue; it has no lock, so that the run never waits
END_S = 2.0  # s that the page has to end by itself
NICE = 5  # niceness of the page: the run goes first when both want the processor
KEPT = 20_000  # maximum number of messages that wait to be drawn


class PageLink:
    """A page in a process of its own; a context manager.

    on_order: called with each order, in a separate thread
    opened: set when the first browser shows the page
    ended: set when the page has ended"""

    def __init__(self, offer: Offer, listening: socket.socket, on_order: Callable[[Order], object]) -> None:
        self.opened, self.ended = threading.Event(), threading.Event()
        self.viewers = 0  # browsers that show the page
        self._on_order, self._closing = on_order, False
        self._queue: deque[tuple[str, dict[str, Any]]] = deque()
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(
            target=live_page, args=(offer, listening, theirs), name="mazeplan page", daemon=True
        )
        self._process.start()
        theirs.close()
        for work in (self._send, self._receive):
            threading.Thread(target=work, name=f"mazeplan page {work.__name__}", daemon=True).start()

    def take(self, topic: str, t: float, document: dict[str, Any]) -> None:
        """Pass a message of the run to the page; returns at once (`core.logs.run_log.Take`)."""
        waiting = len(self._queue)
        if waiting < WAITING or (waiting < MOST and topic not in FREQUENT):
            self._queue.append((topic, document))

    def tell(self, phase: str, note: str = "") -> None:
        """Tell the page the phase of the session: idle, failed (the last run could not begin), starting or running."""
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
            line.shutdown(socket.SHUT_RDWR)  # closing alone does not end a call that waits for the other end
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


# -- the page's process ------------------------------------------------------------------------------------------------


def live_page(offer: Offer, listening: socket.socket, pipe: Connection) -> None:
    """The page's process. It draws until the other end of the pipe is gone. It leaves Ctrl-C to the run's process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(OSError, AttributeError):
        os.nice(NICE)
    from mazeplan.apps.view.page import Page
    from mazeplan.apps.view.server import STOP_BAR

    line = _PageEnd(pipe)
    page = Page(listening, [LiveTab(offer, line.drain, line.order)], bar=STOP_BAR)
    viewers = -1

    def on() -> bool:
        nonlocal viewers
        now = len(page.server.get_clients())
        if now != viewers:
            viewers = now
            line.order({"do": "viewers", "count": now})
        return not line.over.is_set()

    page.loop(on)
    sys.stderr.flush()
    os._exit(0)  # viser's threads wait for browsers, which may hang


class _PageEnd:
    """The page's end of the line."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe, self._lock, self.over = pipe, threading.Lock(), threading.Event()
        self._waiting: deque[tuple[str, dict[str, Any]]] = deque(maxlen=KEPT)
        threading.Thread(target=self._receive, name="mazeplan line", daemon=True).start()

    def _receive(self) -> None:
        while True:
            try:
                self._waiting.extend(self._pipe.recv())
            except (EOFError, OSError):
                self.over.set()
                return

    def drain(self) -> Iterator[tuple[str, dict[str, Any]]]:
        """Messages since the last call."""
        while self._waiting:
            yield self._waiting.popleft()

    def order(self, order: Order) -> None:
        """Send an order. Any thread may call this."""
        with self._lock, suppress(OSError):
            self._pipe.send(order)
