"""Saves open work before a watchdog ends the process, because a loop that hangs runs no `finally`."""

from __future__ import annotations

import os
import threading
from contextlib import suppress
from typing import Any, NoReturn
from weakref import WeakSet

LIMIT_S = 0.5  # for saving one object; a disk may hang, too
_open: WeakSet[Any] = WeakSet()


def save_at_hard_end(what: Any) -> None:
    """Call `what.save()` before a watchdog ends the process, in another thread than the one that hangs.

    Only a weak reference is kept."""
    _open.add(what)


def end_process(status: int) -> NoReturn:
    """Save what can be saved, each object within LIMIT_S, and end the process at once."""
    for what in list(_open):
        saver = threading.Thread(target=_save, args=(what,), daemon=True)
        saver.start()
        saver.join(LIMIT_S)
    os._exit(status)


def _save(what: Any) -> None:
    with suppress(Exception):  # the process ends for another reason, which has been reported
        what.save()
