"""The emergency stop: while a machine of wood and wire is driven from a terminal, any key levels its plate.

Nothing is read unless this program is in the foreground of a terminal; Ctrl-C and Ctrl-Z do what they always do.
"""

from __future__ import annotations

import os
import select
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from mazeplan.cli.output import say

TTY = "/dev/tty"


def interrupt() -> None:
    """End what goes on as Ctrl-C does."""
    os.kill(os.getpid(), signal.SIGINT)


@contextmanager
def stop_key(rig: Any, then: Callable[[], object], *, terminal: str = TTY) -> Iterator[bool]:
    """While it is entered a key calls `rig.stop()` and `then`, once; True if there is a terminal to press it at.

    A rig without `stop`, as simulated ones are, has none, and no terminal is touched."""
    stop = getattr(rig, "stop", None)
    fd = _opened(terminal) if callable(stop) else None
    if fd is None or not callable(stop):
        yield False
        return
    import termios
    import tty

    before = termios.tcgetattr(fd)
    wake, waker = os.pipe()

    def listen() -> None:
        while True:
            ready, _, _ = select.select([fd, wake], [], [])
            if wake in ready:
                return
            if not _foreground(fd):  # reading would stop the program
                if wake in select.select([wake], [], [], 0.2)[0]:
                    return
                continue
            if not os.read(fd, 64):  # the terminal is gone
                return
            stop()
            then()
            say("emergency stop: the plate is level")
            return

    thread = threading.Thread(target=listen, name="mazeplan stop key", daemon=True)
    try:
        tty.setcbreak(fd, termios.TCSADRAIN)
        thread.start()
        say("any key stops the rig at once")
        yield True
    finally:
        os.write(waker, b".")
        if thread.ident is not None:
            thread.join(timeout=1.0)
        with suppress(termios.error), _not_stopped_for_it():
            termios.tcsetattr(fd, termios.TCSADRAIN, before)
        for end in (fd, wake, waker):
            os.close(end)


def _opened(terminal: str) -> int | None:
    """The terminal, if this program is in its foreground."""
    try:
        fd = os.open(terminal, os.O_RDONLY | os.O_NOCTTY)
    except OSError:
        return None
    if os.isatty(fd) and _foreground(fd):
        return fd
    os.close(fd)
    return None


def _foreground(fd: int) -> bool:
    try:
        return os.tcgetpgrp(fd) == os.getpgrp()
    except OSError:  # not our terminal, or it is gone
        return False


@contextmanager
def _not_stopped_for_it() -> Iterator[None]:
    """A program in the background that sets the terminal would be stopped, unless it does not want to hear of it."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTTOU})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
