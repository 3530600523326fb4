"""What a person sees while something runs, on stderr so that stdout stays clean for --json.

On a terminal: one live line per ring (rich). Elsewhere: one plain line per event. The control loop only notes what happened; rich draws in its own
thread, ten times a second.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, Self, TextIO

from mazeplan.records import NavigationResult


@dataclass
class _RingLine:
    ring: int
    since: float
    until: float
    opening: str = ""
    doing: str = ""
    notes: list[str] = field(default_factory=list)


class NavigationProgress:
    """Shows one navigation; a context manager. live: None asks the stream whether it is a terminal."""

    def __init__(self, stream: TextIO | None = None, *, live: bool | None = None) -> None:
        self._stream = stream or sys.stderr
        self._live_wanted = self._stream.isatty() if live is None else live
        self._lines: list[_RingLine] = []
        self._live: Any = None

    def __enter__(self) -> Self:
        if self._live_wanted:
            from rich.console import Console
            from rich.live import Live

            console = Console(file=self._stream, force_terminal=True)
            self._live = Live(get_renderable=self._table, console=console, refresh_per_second=10)
            self._live.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._live is not None:
            self._live.stop()
            self._live = None

    def _say(self, text: str) -> None:
        if self._live is None:
            print(text, file=self._stream, flush=True)

    def _table(self) -> Any:
        from rich.table import Table

        table = Table(box=None, pad_edge=False)
        for title in ("ring", "time", "opening", "doing", "recoveries"):
            table.add_column(title, justify="right" if title == "time" else "left")
        for line in list(self._lines):
            seconds = f"{line.until - line.since:.2f} s"
            table.add_row(f"ring {line.ring}", seconds, line.opening, line.doing, "; ".join(line.notes))
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
        """The last word."""
        if self._lines:
            self._lines[-1].doing = "arrived" if result.success else result.reason
        word = "arrived" if result.success else f"did not arrive: {result.reason}"
        text = f"{result.time_s:7.2f} s  {word} (rig {result.rig}, seed {result.seed}, {len(result.failures)} failures)"
        if self._live is not None:
            self._live.stop()
            self._live = None
        self._say(text)


@contextmanager
def campaign_progress(total: int, stream: TextIO | None = None, *, label: str = "runs") -> Iterator[Callable[[int], None]]:
    """A bar with rate and time left on a terminal, nothing elsewhere; yields `advance(finished)`."""
    out = stream or sys.stderr
    if not out.isatty():
        yield lambda finished: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (TextColumn(label), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(file=out)) as progress:
        task = progress.add_task(label, total=total)
        yield lambda finished: progress.update(task, completed=finished)
