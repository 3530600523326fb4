"""Progress on stderr: a line for each event of a navigation; for other work notes, and a bar on a terminal."""

from __future__ import annotations

import math
import os
import shlex
import sys
from collections import Counter
from functools import cache
from pathlib import Path
from time import monotonic
from typing import Any, Self, TextIO

from mazeplan.apps.cli.output import plural, say
from mazeplan.core.progress import Display
from mazeplan.core.resources import PACKAGE

QUIET_S = 8.0  # s, after which a new step is printed without a terminal


def is_terminal(stream: TextIO) -> bool:
    """Whether lines on the stream can be redrawn."""
    return stream.isatty() and os.environ.get("TERM", "") not in ("", "dumb")


class NavigationProgress(Display):
    """Prints a line for each event of a navigation."""

    def __init__(self, rig: str) -> None:
        """rig: as it was given on the command line, for what to do next"""
        self._rig = rig

    def ring_entered(self, ring: int, t: float) -> None:
        """Show the ring that the ball is in now. t: rig time, s"""
        say(f"{t:7.2f} s  in ring {ring}")

    def passed(self, ring: int, opening: str, t: float) -> None:
        """Show the opening through which the ball left `ring`."""
        say(f"{t:7.2f} s  left ring {ring} by {opening}")

    def event(self, t: float, text: str) -> None:
        """Show a failure or recovery."""
        say(f"{t:7.2f} s  {text}")

    def finished(self, result: Any) -> None:
        """Print the result (`records.NavigationResult`), and what to do next."""
        outcome = "arrived" if result.success else f"did not arrive: {result.reason}"
        failures = plural(len(result.failures), "failure")
        goals = f", goals: rings {', '.join(str(g.ring) for g in result.goals)}" if len(result.goals) > 1 else ""
        say(f"{result.time_s:7.2f} s  {outcome} (rig {result.rig}, seed {result.seed}, {failures}{goals})")
        if advice := next_step(result, self._rig):
            say(f"next: {advice}")


def next_step(result: Any, rig: str) -> str:
    """What to look at after a run that did not arrive; empty if it arrived or somebody ended it."""
    from mazeplan.core.records import FailureKind as Kind

    if result.success or result.reason in ("stopped", "interrupted", "skipped"):
        return ""
    kinds = Counter(f.kind for f in result.failures if f.kind not in (Kind.OUT_OF_TIME, Kind.MISFIT))
    kind = kinds.most_common(1)[0][0] if kinds else None
    if kind in (Kind.NO_ROUTE, Kind.OPENING_CLOSED):
        return "mazeplan map route: it shows which openings lead to the goal"
    measured = kind in (Kind.BALL_LOST, Kind.BALL_OUT, Kind.RIG_FAILED)
    if measured or result.doubts or result.reason == Kind.MISFIT:
        return f"mazeplan rig check {shlex.quote(rig)}: it tests signs, axes, clock and sensors of the rig"
    if kind is None and result.reason == "failed":
        return "mazeplan behavior check: the tree ended by itself, and nothing went wrong with the ball"
    if kind is None:
        return "a larger --time-limit: nothing went wrong"
    if result.log is None:
        return "the same command with --log run.mcap, then mazeplan report run.mcap: it draws each failure"
    log, what = shlex.quote(result.log), kind.replace("_", " ")
    return f"mazeplan report {log}: it draws each {what}; mazeplan diagnose {log}: it says what the model lacks"


class ProgressBar:
    """Shows long work on a terminal: step, share done, rate, time left or time taken. A context manager.

    Without a terminal, it prints the step if nothing was printed for QUIET_S.

    label: name of the work
    transient: whether to erase the bar at the end
    compiles: whether the work may compile for a minute; this is reported without a terminal, too"""

    def __init__(self, label: str, *, transient: bool = True, compiles: bool = True) -> None:
        self._label, self._transient, self._compiles = label, transient, compiles
        self._bar: Any = None
        self._task: Any = None
        self._done, self._total = 0.0, math.inf
        self._said = monotonic()

    def __enter__(self) -> Self:
        if self._compiles:
            report_compiling()
        if is_terminal(sys.stderr):
            self._bar = _rich_bar(self._transient)
            self._task = self._bar.add_task(self._label, total=None, step="")
            self._bar.start()
        return self

    def __exit__(self, *error: object) -> None:
        bar, self._bar = self._bar, None
        if bar is not None:
            bar.stop()

    def show(self, step: str) -> None:
        """Show the present step."""
        if self._bar is None:
            if monotonic() - self._said > QUIET_S:
                self.note(f"{self._label}: {step}")
            return
        if self._done >= self._total:  # a new step of unknown length
            self._done, self._total = 0.0, math.inf
            self._bar.reset(self._task)
            self._bar.tasks[0].total = None  # `reset` keeps the total if it gets None
        self._bar.update(self._task, step=step, refresh=True)

    def note(self, text: str) -> None:
        """Print a line, above the bar if there is one."""
        self._said = monotonic()
        if self._bar is not None:
            self._bar.console.print(text, markup=False, highlight=False, soft_wrap=True)
        else:
            say(text)

    def advance(self, done: float, total: float) -> None:
        """Show `done` of `total`. A smaller `done` or another `total` begins a new step."""
        if self._bar is None:
            return
        if total != self._total or done < self._done:
            self._bar.reset(self._task, total=total, completed=done)
        else:
            self._bar.update(self._task, completed=done)
        self._done, self._total = done, total


def _rich_bar(transient: bool) -> Any:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"), BarColumn(bar_width=16), TaskProgressColumn(show_speed=True),
        TimeRemainingColumn(), TextColumn("{task.fields[step]}", markup=False),
    )  # fmt: skip
    console = Console(file=sys.stderr, force_terminal=True)
    return Progress(*columns, console=console, redirect_stdout=False, transient=transient)


@cache
def report_compiling() -> None:
    """Print a line if no compiled code is kept yet, because the first command compiles for a minute."""
    kept = [PACKAGE, Path.home() / ".cache" / "numba", Path(os.environ.get("NUMBA_CACHE_DIR", PACKAGE))]
    if not any(next(place.rglob("*.nbi"), None) for place in kept):
        say("compiling, once for this machine: half a minute or so")
