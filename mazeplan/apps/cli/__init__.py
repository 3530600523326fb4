"""The `mazeplan` command: exit statuses, signals, streams and one-line errors.

Exit status: 0 success, 1 the job ran without success, 2 bad input or usage, 3 the rig failed, 130 Ctrl-C, 143 SIGTERM,
129 SIGHUP. A signal ends a run like Ctrl-C: the plate is level and the log complete.
Streams: a full or closed stderr changes nothing. A stdout that cannot be written turns status 0 into 1 and prints one
line; if the reader left (`| head`), it prints nothing.
Each command imports what it needs when it runs, so that `--help` answers at once.
"""

from __future__ import annotations

import errno
import os
import re
import signal
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import pairwise
from pathlib import Path
from typing import Any, NoReturn

import typer

from mazeplan.apps.cli.app import app
from mazeplan.apps.cli.output import say, short_warnings
from mazeplan.core.errors import InputError, MazeplanError

_UsageError: Any = typer.BadParameter.__base__  # typer exports BadParameter, but not its base

INTERRUPTED = 130  # exit status
UNWRITABLE = (errno.ENOSPC, errno.EPIPE)  # a full disk; a reader that left, as in `mazeplan log export ... | head`
UNUSABLE = (errno.EACCES, errno.EPERM, errno.EROFS, errno.ELOOP, errno.ENAMETOOLONG)  # the system refuses a path
ENDING = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))


def keep_compiled() -> None:
    """Give Numba a temporary cache folder if it can write neither to the package nor to the user's cache."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    places = [Path(__file__).parent, next(place for place in (cache, *cache.parents) if os.path.exists(place))]
    if "NUMBA_CACHE_DIR" in os.environ or any(os.access(place, os.W_OK) for place in places):
        return
    os.environ["NUMBA_CACHE_DIR"] = tempfile.mkdtemp(prefix="mazeplan-compiled-")
    say("cannot keep compiled code: set NUMBA_CACHE_DIR to a folder that can be written")


@contextmanager
def ended_as_interrupted() -> Iterator[list[int]]:
    """Turn the first signal of ENDING into KeyboardInterrupt. Yields a list that receives the number of the signal."""
    received: list[int] = []
    before: dict[int, Any] = {}

    def on_signal(number: int, frame: Any) -> None:
        if not received:
            received.append(number)
            raise KeyboardInterrupt

    for number in ENDING:
        if signal.getsignal(number) is signal.SIG_DFL:  # nohup ignores SIGHUP on purpose
            with suppress(ValueError):  # not in the main thread
                before[number] = signal.signal(number, on_signal)
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def flush_output(status: int, stdout: Any) -> int:
    """Flush stdout and return the exit status; end the program if stdout cannot be written."""
    try:
        stdout.flush()
    except OSError as problem:
        end_unwritable(problem, status)
    if sys.stdout is not stdout:  # typer replaces it after the reader left
        end_unwritable(BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE)), status)
    return status


def end_unwritable(problem: OSError, status: int = 0) -> NoReturn:
    """End at once, because the buffer of stdout would fail again. Print nothing if the reader left."""
    if problem.errno != errno.EPIPE:
        say(f"mazeplan: cannot write: {problem.strerror}")
    os._exit(status or 1)


def with_option(error: MazeplanError, words: Sequence[str]) -> str:
    """The error message, preceded by the option whose value is wrong. words: the command line"""
    text = str(error)
    if not isinstance(error, InputError) or error.line is not None or text.startswith("-"):
        return text
    for option, value in pairwise(words):
        got = error.file is None and f"got {value!r}" in text.replace("got rig ", "got ")
        if option.startswith("-") and (got or str(error.file) == value):
            return f"{option}: {text}"
    return text


def _usage_message(error: Any) -> str:
    """A usage error in one line."""
    text = " ".join(error.format_message().split())
    found = re.fullmatch(r"Invalid value for '(-[\w-]+)'[^:]*: (?:Value error, )?(.*)", text)
    if found is None:
        return text
    option, problem = found.groups()
    got = next((f"got {word}: " for name, word in pairwise(sys.argv) if name == option), "")
    return f"{option}: {problem if problem.startswith('got ') else got + problem}"


def main() -> None:
    """Entry point of the `mazeplan` command: turn deliberate errors into one line and an exit status."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed, as by `2>&-`
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115  open until the end
    keep_compiled()
    stdout = sys.stdout
    with ended_as_interrupted() as received:
        try:
            sys.exit(_run(received))
        except SystemExit as end:
            sys.exit(flush_output(end.code if isinstance(end.code, int) else 0, stdout))


def _run(received: list[int]) -> int:
    """Run the command and return its exit status. received: number of the signal that ended it, if any"""
    try:
        with short_warnings():
            # in standalone mode typer prints usage errors itself, over several lines
            status = app(prog_name="mazeplan", standalone_mode=False)
    except MazeplanError as error:
        others = error.others if isinstance(error, InputError) else ()
        return _fail(with_option(error, sys.argv[1:]), error.exit_status, *(str(other) for other in others))
    except _UsageError as error:
        if type(error).__name__ == "NoArgsIsHelpError":  # a group without a command; the message is the help
            say(error.format_message())
            return InputError.exit_status
        return _fail(_usage_message(error), InputError.exit_status)
    except (KeyboardInterrupt, typer.Abort):
        status = INTERRUPTED
    except typer.Exit as end:  # typer also turns Ctrl-C into Exit
        status = end.exit_code
    except OSError as problem:
        if problem.errno in UNUSABLE and problem.filename is not None:
            error = InputError(f"cannot be used: {problem.strerror}", file=str(problem.filename))
            return _fail(with_option(error, sys.argv[1:]), InputError.exit_status)
        if problem.errno not in UNWRITABLE:
            raise
        end_unwritable(problem)
    except Exception as problem:
        from mazeplan.btree.blame import blames_a_node, exception_line

        if not blames_a_node(problem):
            raise
        return _fail(exception_line(problem), InputError.exit_status)
    if status == INTERRUPTED:
        return _fail(signal.Signals(received[0]).name, 128 + received[0]) if received else _fail("interrupted", status)
    return status if isinstance(status, int) else 0


def _fail(message: str, status: int, *more: str) -> int:
    for line in (message, *more):
        say(f"mazeplan: {line}")
    return status
