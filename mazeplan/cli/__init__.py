"""The command line. Each command imports what it needs when it runs, so that `--help` answers at once.

Exit status: 0 done, 1 the job ran and did not succeed, 2 bad input or usage (one line), 3 the rig failed, 130 Ctrl-C,
143 and 129 for SIGTERM and SIGHUP, which end a run as Ctrl-C does: with the plate level and the log complete.

Streams: one that is closed is not written to, what stderr does not take is dropped; neither changes the exit status.
What stdout does not take (a full disk, a reader who left) is told in one line, and 0 becomes 1.
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
from pathlib import Path
from typing import Any, NoReturn

import typer

from mazeplan.cli.app import app
from mazeplan.errors import InputError, MazeplanError

_UsageError: Any = typer.BadParameter.__base__  # the class is private to typer; its place above BadParameter is not

INTERRUPTED = 130  # exit status
UNWRITABLE = (errno.ENOSPC, errno.EPIPE)  # a full disk; the reader left, as in `mazeplan log export ... | head`
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


class Heedless:
    """stderr, but what cannot be written to it (a full disk, a reader who left) is dropped: what a run says on its way
    must not end it."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """All of it, or nothing."""
        with suppress(OSError):
            return self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        """As far as it goes."""
        with suppress(OSError):
            self._stream.flush()


def give_streams() -> None:
    """A stream that was closed (`2>&-`) is none at all in Python, and what is printed to it goes to stdout."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
    if not isinstance(sys.stderr, Heedless):
        stream: Any = Heedless(sys.stderr)
        sys.stderr = stream


def delivered(status: int, stdout: Any) -> int:
    """The exit status, once what was printed to stdout has left the program. What cannot be written is told in one
    line, and the status is 1 where the job's own was 0."""
    try:
        stdout.flush()
    except OSError as problem:
        unwritable(problem, status)
    if sys.stdout is not stdout:  # typer put another in its place when the reader had left
        unwritable(BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE)), status)
    return status


def unwritable(problem: OSError, status: int = 0) -> NoReturn:
    """The end, when stdout takes no more: what is left to be written would fail again, and say so."""
    print(f"mazeplan: cannot write: {problem.strerror}", file=sys.stderr)
    sys.stderr.flush()
    os._exit(status or 1)


def named(error: MazeplanError, words: Sequence[str]) -> str:
    """The error's line, with the option by which the user gave what is wrong; words: the command line."""
    text = str(error)
    if not isinstance(error, InputError) or error.line is not None or text.startswith("-"):
        return text
    for option, value in _options(words):
        same = error.file is not None and os.path.abspath(value) == os.path.abspath(str(error.file))
        if same or (error.file is None and f"got {value!r}" in text.replace("got rig ", "got ")):
            return f"{option}: {text}"
    return text


def _usage(text: str, words: Sequence[str]) -> str:
    """What typer says of an option's number, as all other lines say it: with what was got."""
    found = re.fullmatch(r"Invalid value for '(-[\w-]+)[^']*': Input should be (?:a )?(.*)", text)
    values = [] if found is None else [value for option, value in _options(words) if option == found[1]]
    if found is None or not values:
        return text
    kinds = {"valid integer": "a whole number", "valid number": "a number", "greater than or equal to": "a number >="}
    begins = next((kind for kind in kinds if found[2].startswith(kind)), None)
    expected = found[2] if begins is None else kinds[begins] + found[2].removeprefix(begins).partition(",")[0]
    return f"{found[1]}: got {values[-1]!r}, expected {expected}"


def _options(words: Sequence[str]) -> Iterator[tuple[str, str]]:
    """(option, value) on a command line."""
    for word, after in zip(words, [*words[1:], ""], strict=True):
        if word.startswith("--") and "=" in word:
            option, _, value = word.partition("=")
            yield option, value.replace("\0", "")
        elif word.startswith("-") and after and "\0" not in after:
            yield word, after


def main() -> None:
    """Entry point of the `mazeplan` command: turns deliberate errors into one line and their exit status."""
    give_streams()
    keep_compiled()
    stdout = sys.stdout
    with ended_as_interrupted() as told:
        try:
            _main(told)
        except SystemExit as done:
            sys.exit(delivered(done.code if isinstance(done.code, int) else 0, stdout))


def _main(told: list[int]) -> None:
    try:
        status = app(standalone_mode=False)  # or typer would print usage errors itself, over several lines
    except MazeplanError as error:
        print(f"mazeplan: {named(error, sys.argv[1:])}", file=sys.stderr)
        sys.exit(error.exit_status)
    except _UsageError as error:
        if type(error).__name__ == "NoArgsIsHelpError":  # a group without a command: its message is the help
            print(error.format_message(), file=sys.stderr)
        else:
            print(f"mazeplan: {_usage(' '.join(error.format_message().split()), sys.argv[1:])}", file=sys.stderr)
        sys.exit(2)
    except (KeyboardInterrupt, typer.Abort):
        status = INTERRUPTED
    except typer.Exit as ended:  # typer makes this of Ctrl-C
        status = ended.exit_code
    except OSError as problem:
        if problem.errno not in UNWRITABLE:
            raise
        unwritable(problem)
    except Exception as problem:
        from mazeplan.behavior.leaf import blames_a_leaf, fault

        if not blames_a_leaf(problem):
            raise
        print(f"mazeplan: {fault(problem)}", file=sys.stderr)
        sys.exit(InputError.exit_status)
    if status == INTERRUPTED:
        status = 128 + told[0] if told else INTERRUPTED
        print(f"mazeplan: {signal.Signals(told[0]).name if told else 'interrupted'}", file=sys.stderr)
    sys.exit(status if isinstance(status, int) else 0)
