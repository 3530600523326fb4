"""What a person sees while something runs, on stderr so that stdout stays clean for --json.

On a terminal: one live line per ring (rich). Elsewhere: one plain line per event. The control loop only notes what
happened; rich draws in its own thread, at most ten times a second.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, TextIO

if TYPE_CHECKING:
    from mazeplan.records import NavigationResult

REFRESH_HZ = 10
LINES_SHOWN = 12  # rings visited; a ball that goes to and fro must not push the current line off the screen
NOTES_SHOWN = 2  # failures and recoveries in one line


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


@contextmanager
def campaign_progress(
    total: int, stream: TextIO | None = None, *, label: str = "runs"
) -> Iterator[Callable[[int], None]]:
    """A bar with rate and time left on a terminal, nothing elsewhere; yields `advance(finished)`."""
    out = sys.stderr if stream is None else stream
    if not is_terminal(out):
        yield lambda finished: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, TextColumn, TimeRemainingColumn
    from rich.text import Text

    class Rate(ProgressColumn):
        def render(self, task: Any) -> Text:
            speed = task.finished_speed or task.speed
            return Text("" if speed is None else f"{speed:.2f}/s")

    console = Console(file=out, force_terminal=True)
    columns = (TextColumn(label), BarColumn(), MofNCompleteColumn(), Rate(), TextColumn("left"), TimeRemainingColumn())
    with Progress(*columns, console=console, refresh_per_second=REFRESH_HZ, redirect_stdout=False) as progress:
        task = progress.add_task(label, total=total)
        yield lambda finished: progress.update(task, completed=finished)
