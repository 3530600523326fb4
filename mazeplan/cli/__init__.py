"""The command line. Each command imports what it needs when it runs, so that `--help` answers at once.

Exit status: 0 done, 1 the job ran and did not succeed, 2 bad input or usage (one line), 3 the rig failed, 130 Ctrl-C,
143 and 129 for SIGTERM and SIGHUP, which end a run as Ctrl-C does: with the plate level and the log complete.
"""

from __future__ import annotations

import errno
import os
import signal
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import typer

from mazeplan.cli.app import app
from mazeplan.errors import MazeplanError

_UsageError: Any = typer.BadParameter.__base__  # the class is private to typer; its place above BadParameter is not

INTERRUPTED = 130  # exit status
ENDING = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))


def keep_compiled() -> None:
    """Where neither the package's folder nor the user's cache may be written, Numba would refuse to compile: then a new
    folder is used, for this process alone."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    places = [Path(__file__).parent, next(place for place in (cache, *cache.parents) if place.exists())]
    if "NUMBA_CACHE_DIR" in os.environ or any(os.access(place, os.W_OK) for place in places):
        return
    os.environ["NUMBA_CACHE_DIR"] = tempfile.mkdtemp(prefix="mazeplan-compiled-")
    print("compiled code cannot be kept: set NUMBA_CACHE_DIR to a folder that may be written to", file=sys.stderr)


@contextmanager
def ended_as_interrupted() -> Iterator[list[int]]:
    """Signals that end the program raise KeyboardInterrupt, the first one only; the list gets its number."""
    told: list[int] = []
    before: dict[int, Any] = {}

    def on_signal(number: int, frame: Any) -> None:
        if not told:
            told.append(number)
            raise KeyboardInterrupt

    for number in ENDING:
        if signal.getsignal(number) is signal.SIG_DFL:  # nohup ignores SIGHUP, and means it
            with suppress(ValueError):  # not in the main thread
                before[number] = signal.signal(number, on_signal)
    try:
        yield told
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def give_streams() -> None:
    """A stream that was closed (`2>&-`) is none at all in Python, and what is printed to it goes to stdout."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115


def main() -> None:
    """Entry point of the `mazeplan` command: turns deliberate errors into one line and their exit status."""
    give_streams()
    keep_compiled()
    with ended_as_interrupted() as told:
        _main(told)


def _main(told: list[int]) -> None:
    try:
        status = app(standalone_mode=False)  # or typer would print usage errors itself, over several lines
    except MazeplanError as error:
        print(f"mazeplan: {error}", file=sys.stderr)
        sys.exit(error.exit_status)
    except _UsageError as error:
        if type(error).__name__ == "NoArgsIsHelpError":  # a group without a command: its message is the help
            print(error.format_message(), file=sys.stderr)
        else:
            print(f"mazeplan: {' '.join(error.format_message().split())}", file=sys.stderr)
        sys.exit(2)
    except (KeyboardInterrupt, typer.Abort):
        status = INTERRUPTED
    except typer.Exit as ended:  # typer makes this of Ctrl-C
        status = ended.exit_code
    except BrokenPipeError:  # the reader of our output left, as in `mazeplan log export ... | head`
        sys.stderr.close()
        sys.exit(1)
    except OSError as problem:
        if problem.errno != errno.ENOSPC:
            raise
        with suppress(OSError):
            print(f"mazeplan: cannot write: {problem.strerror}", file=sys.stderr)
        os._exit(1)  # what is left to be written would fail again, and say so
    if status == INTERRUPTED:
        status = 128 + told[0] if told else INTERRUPTED
        with suppress(OSError):  # the terminal may be gone
            print(f"mazeplan: {signal.Signals(told[0]).name if told else 'interrupted'}", file=sys.stderr)
    sys.exit(status if isinstance(status, int) else 0)
