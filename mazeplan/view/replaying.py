"""Recorded runs, to be looked at again: their moments, one time for all of them, and places to jump to.

Nothing here knows a page or a clock: who shows a run says how much time went by. Times are s of the rigs' clocks, which
begin at 0 with each run, so that two runs are side by side without more.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.data.runlog_reader import read_log, read_messages
from mazeplan.errors import LogError
from mazeplan.maze.geometry import Maze
from mazeplan.records import Array
from mazeplan.view.moment import Moment
from mazeplan.view.story import maze_of, moments

SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)  # s of the run in one on the wall
_NEAR = 1e-6  # s; times that are no farther apart are the same tick


@dataclass(frozen=True)
class Mark:
    """A time to jump to, what happened then in a word or two, and all that is known of it."""

    t: float
    brief: str
    text: str


@dataclass(frozen=True)
class Recording:
    """One log.

    name:     what the file is called
    moments:  one for each tick, with the times of them, (N,), which never go back
    maze:     None where the log has none that can be read
    failures: what went wrong and what was done about it; where the run did not arrive, also how it ended
    notes:    what the log does not have, and what follows from it, a sentence each
    """

    name: str
    moments: tuple[Moment, ...]
    times: Array
    maze: Maze | None
    failures: tuple[Mark, ...]
    notes: tuple[str, ...]

    def at(self, t: float) -> Moment:
        """As it stood at time t: the last tick until then; before the first one, that."""
        return self.moments[self.tick_at(t)]

    def tick_at(self, t: float) -> int:
        """The number, from 0, of that tick."""
        return max(0, int(np.searchsorted(self.times, t + _NEAR, side="right")) - 1)

    def column(self, name: str) -> Array:
        """One of `moment.COLUMNS` over the whole run, (N,)."""
        return np.array([moment.column(name)[-1] if len(moment.rows) else math.nan for moment in self.moments])

    @property
    def outcome(self) -> str:
        """How it ended, in words."""
        result = self.moments[-1].result
        if result is None:
            return f"no result: ends at {self.times[-1]:.2f} s"
        reason = str(result.get("reason") or "no reason told")
        return f"{'arrived' if result.get('success') else reason} at {self.times[-1]:.2f} s"


def open_recording(path: str | Path) -> Recording:
    """Read a log, also one that was cut or is of an older version. Raises LogError for one that cannot be shown."""
    path = Path(path)
    log = read_log(path)  # says what is damaged
    header, messages, complete = read_messages(path)
    try:
        told = moments(messages)
        failures = tuple(_failures(messages))
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError) as problem:
        raise LogError(f"damaged: a field is missing or of the wrong kind ({problem})", file=path) from None
    if not told:
        raise LogError("holds no tick, there is nothing to show", file=path)
    times = np.maximum.accumulate(np.array([moment.t for moment in told]))
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
    return Recording(path.name, tuple(told), times, maze, failures, tuple(notes))


def _failures(messages: Iterable[tuple[str, dict[str, Any]]]) -> list[Mark]:
    marks: list[Mark] = []
    for topic, document in messages:
        if topic == "/result" and not document["success"]:
            last = max((mark.t for mark in marks), default=0.0)
            how = f"ended: {document.get('reason') or 'no reason told'}"
            marks.append(Mark(max(float(document.get("time_s", last)), last), how, how))
        if topic != "/event":
            continue
        detail = document["detail"]
        if document["kind"] == "failure":
            kind = str(detail["kind"])
            where = f" at {detail['where']}" if detail.get("where") else ""
            why = f": {detail['detail']}" if detail.get("detail") else ""
            marks.append(Mark(float(document["t"]), kind, f"{kind}{where}{why}"))
        elif document["kind"] == "recovery" and marks:
            then = f" → {detail.get('recovery')}"
            marks[-1] = Mark(marks[-1].t, marks[-1].brief + then, marks[-1].text + then)
    return marks


class Player:
    """A time that is stopped, goes on, or is set. times: (N,) of the ticks at which steps stop, s, never going back."""

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
        """Go to a time; beyond an end, to that."""
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
        """So many seconds went by on the wall."""
        if self.playing:
            self.seek(self.t + self.speed * max(seconds, 0.0))
            self.playing = self.t < self.last - _NEAR

    def jump(self, marks: Sequence[Mark], direction: int) -> Mark | None:
        """Go to the next mark (1) or the one before (-1) and stay there; None where there is none."""
        self.playing = False
        ahead = [mark for mark in marks if direction * (mark.t - self.t) > _NEAR]
        mark = min(ahead, key=lambda mark: abs(mark.t - self.t), default=None)
        if mark is not None:
            self.seek(mark.t)
        return mark


def common_times(recordings: Sequence[Recording]) -> Array:
    """Times at which steps stop: the ticks of the first run, and those of others before and after it, (N,)."""
    times = recordings[0].times
    for other in (recording.times for recording in recordings[1:]):
        before, after = other[other < times[0] - _NEAR], other[other > times[-1] + _NEAR]
        times = np.concatenate([before, times, after])
    return times
