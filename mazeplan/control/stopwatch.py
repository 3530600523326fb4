"""The one clock that decides anything: by it the planner ends a search at its deadline.

It is handed in, so that a run can be told again: `Live` reads the wall clock and keeps where it ended a search,
`Recorded` ends the searches of another time at the same places.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Protocol

WHOLE = "-"  # a search that its deadline did not end
MOST = 1000  # searches that are remembered; far more than a tick makes


class Stopwatch(Protocol):
    """Runs while one search goes on, and the next, and the next."""

    def begin(self, deadline_ms: float) -> None:
        """A search begins, which is to end within so long."""

    def over(self, done: int) -> bool:
        """Whether it ends here, after so many iterations; asked before each. The first is always made."""
        ...

    def end(self) -> float:
        """The search is over; ms that it took."""
        ...

    def taken(self) -> str | None:
        """Where the searches since this was last asked were ended; None where all went to their end."""
        ...


class Live:
    """Time as it goes by: the next iteration is taken to last as long as the longest so far. clock: s."""

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

    def taken(self) -> str | None:
        """For each search since this was last asked, after how many iterations its deadline ended it, or `-`; None
        where all went to their end."""
        cuts = list(self._cuts)
        self._cuts.clear()
        return " ".join(cuts) if any(cut != WHOLE for cut in cuts) else None


class Recorded:
    """Searches end where `Live` ended them. `load` says where, before each tick."""

    def __init__(self) -> None:
        self._cuts: deque[int | None] = deque()
        self._cut: int | None = None

    def load(self, taken: str | None) -> None:
        """What `Live.taken` gave for the tick that is to come. Raises ValueError for anything else."""
        self._cuts = deque(None if cut == WHOLE else int(cut) for cut in (taken or "").split())

    def begin(self, deadline_ms: float) -> None:
        """See Stopwatch."""
        self._cut = self._cuts.popleft() if self._cuts else None

    def over(self, done: int) -> bool:
        """See Stopwatch."""
        return done == self._cut

    def end(self) -> float:
        """No time is told: 0."""
        return 0.0

    def taken(self) -> str | None:
        """Nothing new."""
        return None
