"""Recorded runs: their moments, one time for all runs, and failures to jump to.

This module has no page and no clock: the caller says how much time passed. Times are s of the rigs' clocks. Each clock
begins at 0 with its run, so that two runs can play side by side.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.apps.view.moment import COLUMN, Moment
from mazeplan.apps.view.replay.logged_moments import LoggedMoments
from mazeplan.apps.view.story import maze_of
from mazeplan.core.errors import LogError
from mazeplan.core.events import FailureReported, RecoveryChosen, TimedEvent
from mazeplan.core.logs.log_index import index_log
from mazeplan.core.logs.run_log_reader import checked_fields, trees_of
from mazeplan.core.records import Array
from mazeplan.maze.geometry import Maze

SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)  # s of the run in 1 s of wall time
_NEAR = 1e-6  # s; times that are no farther apart are the same tick


@dataclass(frozen=True)
class Mark:
    """A failure to jump to: its time, a short text, and a full text."""

    t: float
    brief: str
    text: str


@dataclass(frozen=True)
class RecordedRun:
    """One log.

    name:     of the file
    header:   facts about the run
    moments:  one for each tick
    times:    of the ticks, (N,), never decreasing
    maze:     None if the log has no map that can be read
    failures: with their recoveries; if the run did not arrive, also its end
    notes:    what the log lacks, a sentence each
    result:   the outcome, None if the log has none
    """

    name: str
    header: dict[str, Any]
    moments: LoggedMoments
    times: Array
    maze: Maze | None
    failures: tuple[Mark, ...]
    notes: tuple[str, ...]
    result: dict[str, Any] | None

    def at(self, t: float) -> Moment:
        """The moment of the last tick until time t; before the first tick, the first moment."""
        return self.moments[self.tick_at(t)]

    def tick_at(self, t: float) -> int:
        """The number, from 0, of the tick that `at` shows at time t."""
        return max(0, int(np.searchsorted(self.times, t + _NEAR, side="right")) - 1)

    def column(self, name: str, first: int = 0, end: int | None = None) -> Array:
        """One of `moment.COLUMNS` over the ticks `first` up to `end`, by default the whole run, (N,)."""
        return self.moments.rows(first, len(self.moments) if end is None else end)[:, COLUMN[name]]

    @property
    def outcome(self) -> str:
        """How the run ended, in words."""
        if self.result is None:
            return f"no result: ends at {self.times[-1]:.2f} s"
        reason = str(self.result.get("reason") or "no reason given")
        return f"{'arrived' if self.result.get('success') else reason} at {self.times[-1]:.2f} s"


def open_recording(path: str | Path) -> RecordedRun:
    """Open a log, also a log that was cut off or that an older version wrote. Raises LogError if it cannot be shown.

    `LoggedMoments` says which part is read now."""
    path = Path(path)
    index = index_log(path)
    rare, shown = [document for _, document in index.rare], LoggedMoments(index)
    if not len(shown):
        raise LogError("holds no tick, there is nothing to show", file=path)
    with checked_fields(path):
        failures, trees = tuple(_failures(rare)), trees_of(rare)
    times = np.array([moment.t for moment in shown]) if shown.whole else index.times
    shown[0]  # the page draws it first; raises LogError if it is damaged
    if not np.isfinite(times).all():
        raise LogError("damaged: a tick without a time", file=path)
    times, maze = np.maximum.accumulate(times), maze_of(index.header)
    notes = []
    if not index.complete:
        notes.append(f"The log was cut off: what came after {times[-1]:.2f} s is not in it.")
    if not trees:
        notes.append("The log has no tree: it was not driven by one, or an older version wrote it.")
    if maze is None:
        notes.append("The log has no map that can be read: the maze cannot be drawn.")
    result = next((document for topic, document in reversed(rare) if topic == "/result"), None)
    return RecordedRun(path.name, index.header, shown, times, maze, failures, tuple(notes), result)


def _failures(messages: Iterable[tuple[str, dict[str, Any]]]) -> list[Mark]:
    marks: list[Mark] = []
    for topic, document in messages:
        if topic == "/result" and not document["success"]:
            last = max((mark.t for mark in marks), default=0.0)
            how = f"ended: {document.get('reason') or 'no reason given'}"
            marks.append(Mark(max(float(document.get("time_s", last)), last), how, how))
        if topic != "/event":
            continue
        timed = TimedEvent.from_document(document)
        event = timed.event
        if isinstance(event, FailureReported):
            where = f" at {event.where}" if event.where else ""
            why = f": {event.detail}" if event.detail else ""
            marks.append(Mark(timed.t, event.kind, f"{event.kind}{where}{why}"))
        elif isinstance(event, RecoveryChosen) and marks:
            then = f" → {event.recovery}"
            marks[-1] = Mark(marks[-1].t, marks[-1].brief + then, marks[-1].text + then)
    return marks


class Playback:
    """The time that a replay shows. times: of the ticks at which steps stop, (N,), s, never decreasing"""

    def __init__(self, times: Array) -> None:
        self._times = times
        self.t, self.playing, self.speed = float(times[0]), False, 1.0

    @property
    def first(self) -> float:
        """Time of the first tick, s."""
        return float(self._times[0])

    @property
    def last(self) -> float:
        """Time of the last tick, s."""
        return float(self._times[-1])

    def seek(self, t: float) -> None:
        """Go to a time between the first and the last tick."""
        self.t = min(max(t, self.first), self.last) if math.isfinite(t) else self.t

    def step(self, ticks: int) -> None:
        """Go to the next tick (1), the previous tick (-1) ..., and stay there."""
        self.playing = False
        if ticks > 0:
            at = int(np.searchsorted(self._times, self.t + _NEAR, side="right")) + ticks - 1
        else:
            at = int(np.searchsorted(self._times, self.t - _NEAR, side="left")) + ticks
        self.t = float(self._times[min(max(at, 0), len(self._times) - 1)])

    def toggle(self) -> None:
        """Go on or stop; at the end, go on from the beginning."""
        self.playing = not self.playing
        if self.playing and self.t >= self.last - _NEAR:
            self.t = self.first

    def advance(self, seconds: float) -> None:
        """Let wall time pass, s."""
        if self.playing:
            self.seek(self.t + self.speed * max(seconds, 0.0))
            self.playing = self.t < self.last - _NEAR

    def jump(self, marks: Sequence[Mark], direction: int) -> Mark | None:
        """Go to the next mark (1) or the previous mark (-1) and stay there. Returns the mark, None without one."""
        self.playing = False
        ahead = [mark for mark in marks if direction * (mark.t - self.t) > _NEAR]
        mark = min(ahead, key=lambda mark: abs(mark.t - self.t), default=None)
        if mark is not None:
            self.seek(mark.t)
        return mark


def common_times(recordings: Sequence[RecordedRun]) -> Array:
    """Times at which steps stop, (N,): all ticks of the first run, and the ticks of other runs before and after it."""
    times = recordings[0].times
    for other in (recording.times for recording in recordings[1:]):
        before, after = other[other < times[0] - _NEAR], other[other > times[-1] + _NEAR]
        times = np.concatenate([before, times, after])
    return times
