"""Recorded runs: their moments, one time for all of them, and failures to jump to.

This module has no page and no clock: its user says how much time passed. Times are s of the rigs' clocks, which begin
at 0 with each run, so that two runs can play side by side.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.apps.view.moment import Moment
from mazeplan.apps.view.story import maze_of, moments
from mazeplan.core.errors import LogError
from mazeplan.core.events import FailureReported, RecoveryChosen, TimedEvent
from mazeplan.core.logs.run_log_reader import read_log, read_messages
from mazeplan.core.records import Array
from mazeplan.maze.geometry import Maze

SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)  # s of the run in one on the wall
_NEAR = 1e-6  # s; times that are no farther apart are the same tick


@dataclass(frozen=True)
class Mark:
    """A failure to jump to: its time, in short, and in full."""

    t: float
    brief: str
    text: str


@dataclass(frozen=True)
class RecordedRun:
    """One log.

    name:     of the file
    moments:  one for each tick
    times:    of the ticks, (N,), never decreasing
    maze:     None for a log without a map that can be read
    failures: with their recoveries; of a run that did not arrive, also how it ended
    notes:    what the log lacks, a sentence each
    """

    name: str
    moments: tuple[Moment, ...]
    times: Array
    maze: Maze | None
    failures: tuple[Mark, ...]
    notes: tuple[str, ...]

    def at(self, t: float) -> Moment:
        """The moment of the last tick until time t; before the first tick, of the first."""
        return self.moments[self.tick_at(t)]

    def tick_at(self, t: float) -> int:
        """The number, from 0, of that tick."""
        return max(0, int(np.searchsorted(self.times, t + _NEAR, side="right")) - 1)

    def column(self, name: str) -> Array:
        """One of `moment.COLUMNS` over the whole run, (N,)."""
        return np.array([moment.column(name)[-1] if len(moment.rows) else math.nan for moment in self.moments])

    @property
    def outcome(self) -> str:
        """How the run ended, in words."""
        result = self.moments[-1].result
        if result is None:
            return f"no result: ends at {self.times[-1]:.2f} s"
        reason = str(result.get("reason") or "no reason given")
        return f"{'arrived' if result.get('success') else reason} at {self.times[-1]:.2f} s"


def open_recording(path: str | Path) -> RecordedRun:
    """Read a log, also one that was cut or is of an older version. Raises LogError for a log that cannot be shown."""
    path = Path(path)
    log = read_log(path)  # raises for a damaged log
    header, messages, complete = read_messages(path)
    try:
        shown = moments(messages)
        failures = tuple(_failures(messages))
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError) as problem:
        raise LogError(f"damaged: a field is missing or of the wrong kind ({problem})", file=path) from None
    if not shown:
        raise LogError("holds no tick, there is nothing to show", file=path)
    times = np.maximum.accumulate(np.array([moment.t for moment in shown]))
    if not np.isfinite(times).all():
        raise LogError("damaged: a tick without a time", file=path)
    maze = maze_of(header)
    notes = []
    if not complete:
        notes.append(f"The log was cut off: what came after {times[-1]:.2f} s is not in it.")
    if not log.trees:
        notes.append("The log has no tree: it was not driven by one, or an older version wrote it.")
    if maze is None:
        notes.append("The log has no map that can be read: the maze cannot be drawn.")
    return RecordedRun(path.name, tuple(shown), times, maze, failures, tuple(notes))


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
    """The time that a replay shows. times: (N,) of the ticks at which steps stop, s, never decreasing."""

    def __init__(self, times: Array) -> None:
        self._times = times
        self.t, self.playing, self.speed = float(times[0]), False, 1.0

    @property
    def first(self) -> float:
        """s."""
        return float(self._times[0])

    @property
    def last(self) -> float:
        """s."""
        return float(self._times[-1])

    def seek(self, t: float) -> None:
        """Go to a time, at most to an end."""
        self.t = min(max(t, self.first), self.last) if math.isfinite(t) else self.t

    def step(self, ticks: int) -> None:
        """Go to the next tick (1), the one before (-1) ..., and stay there."""
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
        """Seconds passed on the wall clock."""
        if self.playing:
            self.seek(self.t + self.speed * max(seconds, 0.0))
            self.playing = self.t < self.last - _NEAR

    def jump(self, marks: Sequence[Mark], direction: int) -> Mark | None:
        """Go to the next mark (1) or the one before (-1) and stay there; None without one."""
        self.playing = False
        ahead = [mark for mark in marks if direction * (mark.t - self.t) > _NEAR]
        mark = min(ahead, key=lambda mark: abs(mark.t - self.t), default=None)
        if mark is not None:
            self.seek(mark.t)
        return mark


def common_times(recordings: Sequence[RecordedRun]) -> Array:
    """Times at which steps stop: the ticks of the first run, and those of others before and after it, (N,)."""
    times = recordings[0].times
    for other in (recording.times for recording in recordings[1:]):
        before, after = other[other < times[0] - _NEAR], other[other > times[-1] + _NEAR]
        times = np.concatenate([before, times, after])
    return times
