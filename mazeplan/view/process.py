"""The page as a process of its own: it draws what comes by a pipe, and sends back what was pressed."""

from __future__ import annotations

import os
import signal
import socket
import sys
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from multiprocessing.connection import Connection
from threading import Event, Lock, Thread
from typing import Any

from mazeplan.view.door import Door
from mazeplan.view.livetab import LiveTab, Offer, Order

NICE = 5  # the run goes first where both want the processor
KEPT = 20_000  # messages that wait to be drawn


def live_page(offer: Offer, door: Door, listening: socket.socket, pipe: Connection) -> None:
    """Until the other end of the pipe is gone. Ctrl-C is for the program that started this one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(OSError, AttributeError):
        os.nice(NICE)
    from mazeplan.view.page import Page

    line = _Line(pipe)
    page = Page(door, listening, [LiveTab(offer, line.drain, line.order)])
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


class _Line:
    """What comes and goes by the pipe."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe, self._lock, self.over = pipe, Lock(), Event()
        self._waiting: deque[tuple[str, dict[str, Any]]] = deque(maxlen=KEPT)
        Thread(target=self._receive, name="mazeplan line", daemon=True).start()

    def _receive(self) -> None:
        while True:
            try:
                self._waiting.extend(self._pipe.recv())
            except (EOFError, OSError):
                self.over.set()
                return

    def drain(self) -> Iterator[tuple[str, dict[str, Any]]]:
        """What came since this was called last."""
        while self._waiting:
            yield self._waiting.popleft()

    def order(self, order: Order) -> None:
        """Send what was pressed; any thread."""
        with self._lock, suppress(OSError):
            self._pipe.send(order)
