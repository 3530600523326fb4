"""What a person sees while something runs, on stderr so that stdout stays clean for --json.

On a terminal: one live line per ring (rich). Elsewhere: one plain line per event. The control loop only notes what
happened; rich draws in its own thread, at most ten times a second.
"""

from __future__ import annotations

import math
import os
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, TextIO

from mazeplan.cli.output import say

if TYPE_CHECKING:
    from mazeplan.data.runlog import RunLog
    from mazeplan.records import NavigationResult

REFRESH_HZ = 10
LINES_SHOWN = 12  # rings visited; a ball that goes to and fro must not push the current line off the screen
NOTES_SHOWN = 2  # failures and recoveries in one line
COMPILING_S = 2.0
_listening: list[Any] = []


@dataclass
class _RingLine:
    ring: int
    since: float
    until: float
    opening: str = ""
    doing: str = ""
    notes: list[str] = field(default_factory=list)

    def cells(self) -> tuple[str, str, str, str, str]:
        notes = list(self.notes)
        more = len(notes) - NOTES_SHOWN
        told = ([f"{more} before"] if more > 0 else []) + notes[-NOTES_SHOWN:]
        return f"ring {self.ring}", f"{self.until - self.since:.2f} s", self.opening, self.doing, "; ".join(told)


def is_terminal(stream: TextIO) -> bool:
    """Whether lines on the stream can be drawn anew."""
    return stream.isatty() and os.environ.get("TERM", "") not in ("", "dumb")


class NavigationProgress:
    """Shows one navigation; a context manager. live: None asks the stream whether it is a terminal."""

    def __init__(self, stream: TextIO | None = None, *, live: bool | None = None) -> None:
        self._stream = sys.stderr if stream is None else stream
        self._live_wanted = is_terminal(self._stream) if live is None else live
        self._lines: list[_RingLine] = []
        self._live: Any = None

    def __enter__(self) -> Self:
        tell_of_compiling()
        if self._live_wanted:
            from rich.console import Console
            from rich.live import Live

            console = Console(file=self._stream, force_terminal=True)
            # stdout is not redirected: what is printed there belongs there
            self._live = Live(
                get_renderable=self._table, console=console, refresh_per_second=REFRESH_HZ, redirect_stdout=False
            )
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop()

    def _stop(self) -> None:
        live, self._live = self._live, None
        if live is not None:
            live.stop()

    def _say(self, text: str) -> None:
        if self._live is None:
            with suppress(OSError):  # a reader who left
                print(text, file=self._stream, flush=True)

    def _table(self) -> Any:
        from rich.table import Table
        from rich.text import Text

        table = Table(box=None, pad_edge=False)
        for title in ("ring", "time", "opening", "doing", "recoveries"):
            table.add_column(title, justify="right" if title == "time" else "left")
        for line in self._lines[-LINES_SHOWN:]:
            table.add_row(*(Text(cell) for cell in line.cells()))  # Text: brackets in a name are no markup
        return table

    def ring_entered(self, ring: int, t: float) -> None:
        """The ball is in another ring: a new line."""
        self._lines.append(_RingLine(ring, t, t))
        self._say(f"{t:7.2f} s  in ring {ring}")

    def passed(self, ring: int, opening: str, t: float) -> None:
        """The ball left `ring` by an opening."""
        if self._lines:
            self._lines[-1].opening, self._lines[-1].until, self._lines[-1].doing = opening, t, ""
        self._say(f"{t:7.2f} s  left ring {ring} by {opening}")

    def event(self, t: float, text: str) -> None:
        """A failure or recovery."""
        if self._lines:
            self._lines[-1].notes.append(text)
        self._say(f"{t:7.2f} s  {text}")

    def tick(self, t: float, ring: int, text: str) -> None:
        """Time goes on; `text` is the leaf that commands."""
        if self._lines:
            self._lines[-1].until, self._lines[-1].doing = t, text

    def finished(self, result: NavigationResult) -> None:
        """The last word; nothing is drawn after it."""
        if self._lines:
            self._lines[-1].doing = "arrived" if result.success else result.reason
        self._stop()
        word = "arrived" if result.success else f"did not arrive: {result.reason}"
        count = len(result.failures)
        failures = "1 failure" if count == 1 else f"{count} failures"
        self._say(f"{result.time_s:7.2f} s  {word} (rig {result.rig}, seed {result.seed}, {failures})")


class Working:
    """Shows long work on a terminal: what is being done, how far it is, how fast that goes and how long it will still
    take where that is known, else how long it took until now. Elsewhere nothing. A context manager.

    label: a word for all of it; transient: the last picture is wiped; compiles: for the first time that may take a
    minute, which is told elsewhere, too."""

    def __init__(
        self, label: str, stream: TextIO | None = None, *, transient: bool = True, compiles: bool = True
    ) -> None:
        self._compiles = compiles
        self._stream = sys.stderr if stream is None else stream
        self._label, self._transient = label, transient
        self._shown: Any = None
        self._task: Any = None
        self._done, self._total = 0.0, math.inf

    def __enter__(self) -> Self:
        if self._compiles:
            tell_of_compiling()
        if is_terminal(self._stream):
            self._shown = _bar(self._stream, self._transient)
            self._task = self._shown.add_task(self._label, total=None, words="")
            self._shown.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        shown, self._shown = self._shown, None
        if shown is not None:
            shown.stop()

    def tell(self, text: str) -> None:
        """What is being done now."""
        if self._shown is None:
            return
        if self._done >= self._total:  # how far this is nobody has said yet
            self._done, self._total = 0.0, math.inf
            self._shown.reset(self._task)
            self._shown.tasks[0].total = None  # `reset` takes None for: as it is
        self._shown.update(self._task, words=text, refresh=True)

    def line(self, text: str) -> None:
        """Something found on the way, which stays to be read."""
        if self._shown is not None:
            self._shown.console.print(text, markup=False, highlight=False, soft_wrap=True)

    def over(self, found: Iterable[Any], words: Callable[[Any], str]) -> Iterator[Any]:
        """What is found one by one, shown meanwhile; words: of the newest. Wiped while the caller has it."""
        parts, told = iter(found), ""
        while True:
            with self:
                self.tell(told)
                try:
                    part = next(parts)
                except StopIteration:
                    return
            told = words(part)
            yield part

    def advance(self, done: float, total: float) -> None:
        """So much of so much is done. Less than before, or of another total: other work began."""
        if self._shown is None:
            return
        if total != self._total or done < self._done:
            self._shown.reset(self._task, total=total, completed=done)
        else:
            self._shown.update(self._task, completed=done)
        self._done, self._total = done, total


def log_read(path: Path) -> RunLog:
    """A log, while it is shown that it is read: one of half an hour takes seconds. Raises LogError."""
    from mazeplan.data.runlog import read_log

    with Working("reading", compiles=False) as shown:
        shown.tell(path.name)
        return read_log(path)


def _bar(stream: TextIO, transient: bool) -> Any:
    """rich's bar: what, how far, and how fast."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn
    from rich.table import Column
    from rich.text import Text

    class Pace(ProgressColumn):
        def render(self, task: Any) -> Text:
            return Text(_pace(task))

    class Doing(ProgressColumn):
        def render(self, task: Any) -> Text:
            return Text(task.fields["words"], no_wrap=True, overflow="ellipsis")

    columns = (TextColumn("{task.description}"), BarColumn(bar_width=16), Pace(), Doing(Column(ratio=1)))
    console = Console(file=stream, force_terminal=True)
    # stdout is not redirected: what is printed there belongs there
    return Progress(
        *columns, console=console, refresh_per_second=REFRESH_HZ, redirect_stdout=False, transient=transient,
        expand=True,
    )  # fmt: skip


def _pace(task: Any) -> str:
    """`12/40  3.10/s  left 0:00:09`; of shares `30 %  left 0:00:09`; how long it took where no total is known."""
    if task.total is None:
        return _clock(task.elapsed or 0.0)
    speed = task.finished_speed or task.speed
    counted = isinstance(task.total, int) and isinstance(task.completed, int)
    told = [f"{task.completed:g}/{task.total:g}" if counted else f"{task.percentage:.0f} %"]
    told += [f"{speed:.2f}/s"] if counted and speed is not None else []
    left = task.time_remaining
    return "  ".join([*told, "left -:--:--" if left is None else f"left {_clock(left)}"])


def _clock(seconds: float) -> str:
    return f"{int(seconds) // 3600}:{int(seconds) // 60 % 60:02d}:{int(seconds) % 60:02d}"


@contextmanager
def campaign_progress(
    total: int, stream: TextIO | None = None, *, label: str = "runs", begin: int = 0
) -> Iterator[Callable[[int], None]]:
    """A bar with rate and time left on a terminal, nothing elsewhere; yields `advance(finished)`. begin: how many were
    finished before."""
    with Working(label, stream, transient=False) as shown:
        shown.advance(begin, total)
        yield lambda finished: shown.advance(finished, total)


def tell_of_compiling() -> None:
    """From now on say so, once, when Numba compiles for more than COMPILING_S: the first time takes a minute. One line,
    with a terminal or without, as nothing else would tell why the program is silent."""
    from numba.core import event

    class Told(event.Listener):
        depth, timer, told = 0, None, False

        def on_start(self, event: Any) -> None:
            self.depth += 1
            if self.depth == 1 and not self.told:
                self.timer = threading.Timer(COMPILING_S, self.tell)
                self.timer.daemon = True
                self.timer.start()

        def on_end(self, event: Any) -> None:
            self.depth -= 1
            if self.depth == 0 and self.timer is not None:
                self.timer.cancel()

        def tell(self) -> None:
            self.told = True
            say("compiling, once for this machine: up to two minutes")

    if not _listening:
        _listening.append(Told())
        event.register("numba:compile", _listening[0])
