"""Stopwatches that end a planner's search at its deadline.

`Stopwatch` reads the wall clock and records where it ended each search. `Recorded` ends the searches of a replayed run
at the same iterations, so that the replay is exact.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

WHOLE = "-"  # a search that ended before its deadline
MOST = 1000  # maximum number of searches kept; one tick makes far fewer


class Stopwatch:
    """Measures one search after the other. It expects the next iteration to take as long as the longest one so far.

    clock: function that returns the time in s."""

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock = clock
        self._cuts: deque[str] = deque(maxlen=MOST)
        self._began = self._end = self._last = self._longest = 0.0

    def begin(self, deadline_ms: float) -> None:
        """Start a search with this deadline."""
        self._began, self._longest = self._clock(), 0.0
        self._end = self._began + 1e-3 * deadline_ms
        self._cuts.append(WHOLE)

    def over(self, done: int) -> bool:
        """Whether to end the search after `done` iterations. The first iteration is always made."""
        last, self._last = self._last, self._clock()
        if done == 0:
            return False
        self._longest = max(self._longest, self._last - last)
        if self._last + self._longest <= self._end:
            return False
        self._cuts[-1] = str(done)
        return True

    def end(self) -> float:
        """End the search. Returns its duration, ms."""
        return 1e3 * (self._clock() - self._began)

    def pop_cuts(self) -> str | None:
        """One word for each search since the last call; None if no deadline ended any of them.

        The word is the number of iterations until the deadline, or `-` for a search that ended before it."""
        cuts = list(self._cuts)
        self._cuts.clear()
        return " ".join(cuts) if any(cut != WHOLE for cut in cuts) else None


class Recorded(Stopwatch):
    """Ends searches where a `Stopwatch` ended them, and measures no time; call `load` before each tick."""

    def __init__(self) -> None:
        super().__init__(lambda: 0.0)
        self._ends: deque[int | None] = deque()
        self._cut: int | None = None

    def load(self, cuts: str | None) -> None:
        """Set the text that `pop_cuts` returned for the next tick. Raises ValueError for other text."""
        self._ends = deque(None if cut == WHOLE else int(cut) for cut in (cuts or "").split())

    def begin(self, deadline_ms: float) -> None:
        """See `Stopwatch.begin`."""
        self._cut = self._ends.popleft() if self._ends else None

    def over(self, done: int) -> bool:
        """See `Stopwatch.over`."""
        return done == self._cut
