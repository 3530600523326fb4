"""Searches that their deadline ended, and the same searches once more."""

from __future__ import annotations

import numpy as np
import pytest
from ilqg_problems import ring_planner

from mazeplan.control.ilqg import Recorded, Stopwatch
from mazeplan.core.records import StopReason


class Clock:
    """Goes on by what is told, at each look."""

    def __init__(self, *ms: float) -> None:
        self.now, self.ms = 0.0, list(ms)

    def __call__(self) -> float:
        self.now += 1e-3 * (self.ms.pop(0) if self.ms else 0.0)
        return self.now


def test_the_next_iteration_may_take_as_long_as_the_longest():
    watch = Stopwatch(Clock(0.0, 1.0, 2.0, 3.0, 1.0, 1.0))  # begin, first look, then iterations of 2, 3 and 1 ms
    watch.begin(9.5)
    assert [watch.over(done) for done in range(4)] == [False, False, False, True]  # 1 + 2 + 3 + 1 and 3 more are 10
    assert watch.end() == pytest.approx(8.0)
    assert watch.pop_cuts() == "3"
    assert watch.pop_cuts() is None


def test_the_first_iteration_is_always_made():
    watch = Stopwatch(Clock(0.0, 100.0, 1.0))
    watch.begin(1.0)
    assert not watch.over(0)
    assert watch.over(1)


def test_all_searches_of_a_tick_are_told():
    watch = Stopwatch(Clock(*(5.0,) * 20))
    for deadline in (1e9, 1.0, 1e9):
        watch.begin(deadline)
        for done in range(3):
            if watch.over(done):
                break
    assert watch.pop_cuts() == "- 1 -"
    watch.begin(1e9)
    assert watch.pop_cuts() is None  # nothing was ended: nothing to tell


@pytest.mark.parametrize("deadline", [2.0, 4.0, 6.0, 1e9])
def test_a_search_is_ended_again_where_it_was(deadline):
    live, recorded = Stopwatch(Clock(*(1.0,) * 500)), Recorded()
    then = ring_planner(watch=live).plan(np.zeros(6), 1.0, deadline_ms=deadline)
    recorded.load(live.pop_cuts())
    now = ring_planner(watch=recorded).plan(np.zeros(6), 1.0, deadline_ms=0.0)  # it is not what decides
    assert (now.reason, now.iterations) == (then.reason, then.iterations)
    assert (then.reason is StopReason.DEADLINE) == (deadline < 1e9)
    for name in ("states", "controls", "gains"):
        np.testing.assert_array_equal(getattr(now, name), getattr(then, name))
    assert now.ms == 0.0


def test_a_new_tick_forgets_the_last_cuts():
    watch = Recorded()
    watch.load("2 - 1")
    watch.begin(0.0)
    assert [watch.over(done) for done in (0, 1, 2)] == [False, False, True]
    watch.begin(0.0)
    assert not any(watch.over(done) for done in range(5))
    watch.load(None)
    watch.begin(0.0)
    assert not any(watch.over(done) for done in range(5))
    with pytest.raises(ValueError, match="soon"):
        watch.load("soon")
