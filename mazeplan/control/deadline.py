"""Stopwatches that end a planner's search at its deadline.

`Live` reads the wall clock and records where it ended each search. `Recorded` ends the searches of a replayed run at
the same iterations, so that the replay is exact.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Protocol

WHOLE = "-"  # a search that ended before its deadline
MOST = 1000  # maximum number of searches kept; one tick makes far fewer


class Stopwatch(Protocol):
    """Measures one search after the other."""

    def begin(self, deadline_ms: float) -> None:
        """Start a search with this deadline."""

    def over(self, done: int) -> bool:
        """Whether to end the search after `done` iterations. The first iteration is always made."""
        ...

    def end(self) -> float:
        """End the search. Returns its duration, ms."""
        ...

    def pop_cuts(self) -> str | None:
        """The iterations at which deadlines ended searches since the last call; None if no deadline did."""
        ...


class Live:
    """Stopwatch by the wall clock. It expects the next iteration to take as long as the longest one so far.

    clock: function that returns the time in s."""

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock = clock
        self._cuts: deque[str] = deque(maxlen=MOST)
        self._began = self._end = self._last = self._longest = 0.0

    def begin(self, deadline_ms: float) -> None:
        """See Stopwatch."""
        self._began, self._longest = self._clock(), 0.0
        self._end = self._began + 1e-3 * deadline_ms
        self._cuts.append(WHOLE)

    def over(self, done: int) -> bool:
        """See Stopwatch."""
        last, self._last = self._last, self._clock()
        if done == 0:
            return False
        self._longest = max(self._longest, self._last - last)
        if self._last + self._longest <= self._end:
            return False
        self._cuts[-1] = str(done)
        return True

    def end(self) -> float:
        """See Stopwatch."""
        return 1e3 * (self._clock() - self._began)

    def pop_cuts(self) -> str | None:
        """One word for each search since the last call; None if no deadline ended any of them.

        The word is the number of iterations until the deadline, or `-` for a search that ended before it."""
        cuts = list(self._cuts)
        self._cuts.clear()
        return " ".join(cuts) if any(cut != WHOLE for cut in cuts) else None


class Recorded:
    """Ends searches where `Live` ended them; call `load` before each tick."""

    def __init__(self) -> None:
        self._cuts: deque[int | None] = deque()
        self._cut: int | None = None

    def load(self, cuts: str | None) -> None:
        """Set the text that `Live.pop_cuts` returned for the next tick. Raises ValueError for other text."""
        self._cuts = deque(None if cut == WHOLE else int(cut) for cut in (cuts or "").split())

    def begin(self, deadline_ms: float) -> None:
        """See Stopwatch."""
        self._cut = self._cuts.popleft() if self._cuts else None

    def over(self, done: int) -> bool:
        """See Stopwatch."""
        return done == self._cut

    def end(self) -> float:
        """Always 0."""
        return 0.0

    def pop_cuts(self) -> str | None:
        """Always None."""
        return None
