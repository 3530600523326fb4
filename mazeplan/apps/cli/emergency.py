"""The emergency stop: any key at the terminal levels the plate of a real rig.

It reads keys only while the program is in the foreground of a terminal. Ctrl-C and Ctrl-Z keep their effect.
"""

from __future__ import annotations

import os
import select
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from mazeplan.apps.cli.output import say

TTY = "/dev/tty"


def interrupt() -> None:
    """End the present work as Ctrl-C does."""
    os.kill(os.getpid(), signal.SIGINT)


@contextmanager
def stop_key(rig: Any, then: Callable[[], object], *, terminal: str = TTY) -> Iterator[bool]:
    """Within this context, the first key calls `rig.stop()` and `then`. Yields whether it reads keys of a terminal.

    For a rig without `stop`, such as a simulated rig, it leaves the terminal alone."""
    from mazeplan.rigs.interface import traits

    stop = traits(rig).stop
    fd = None if stop is None else _open_terminal(terminal)
    if fd is None or stop is None:
        yield False
        return
    import termios
    import tty

    before = termios.tcgetattr(fd)
    wake, waker = os.pipe()

    def listen() -> None:
        while wake not in select.select([fd, wake], [], [])[0]:
            if not _foreground(fd):  # in the background, reading would suspend the program
                select.select([wake], [], [], 0.2)
                continue
            if os.read(fd, 64):  # otherwise the terminal is gone
                _stop(stop, then)
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
        # SIGTTOU would suspend a program in the background that sets the terminal
        masked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTTOU})
        with suppress(termios.error):
            termios.tcsetattr(fd, termios.TCSADRAIN, before)
        signal.pthread_sigmask(signal.SIG_SETMASK, masked)
        for end in (fd, wake, waker):
            os.close(end)


def _stop(stop: Callable[[], None], then: Callable[[], object]) -> None:
    """Stop the rig, and call `then` also if that fails: it ends the run, which levels the plate once more."""
    try:
        stop()
        say("emergency stop: the plate is level")
    except Exception as problem:  # a rig may raise anything
        say(f"emergency stop: the rig did not stop: {' '.join(str(problem).split())}; cut its power")
    finally:
        then()


def _open_terminal(terminal: str) -> int | None:
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
    except OSError:  # the terminal belongs to another session, or is gone
        return False
