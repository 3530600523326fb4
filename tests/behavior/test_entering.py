"""The next move begins before the ball is in the next ring, where the prediction sees it coming."""

from __future__ import annotations

from dataclasses import replace

import pytest
from test_leaves import MAZE, Bench, at

from mazeplan.behavior.current_leg import ENTERING
from mazeplan.btree.ports import Key
from mazeplan.btree.status import Status
from mazeplan.core.records import FailureKind


def falling(bench):
    """A ball at the opening 1-2@45 that will be in ring 2 in a moment."""
    bench.run.ahead = lambda seconds, beside=(0.0, 0.0): (
        replace(bench.run.here, ring=2) if seconds > 0.1 else bench.run.here
    )
    leaf = bench.leaf("PassOpening", opening="1-2@45")
    return leaf, bench.tick(leaf, at(1, 45.0))


def test_passing_ends_as_soon_as_the_ball_is_seen_coming():
    bench = Bench()
    leaf, status = falling(bench)
    assert status is Status.RUNNING
    assert bench.run.command is not None  # and is pushed meanwhile
    assert bench.tick(leaf, at(1, 45.0, t=0.03)) is Status.SUCCESS
    assert bench.run.here.ring == 2
    confirm = bench.leaf("ConfirmRing", opening="1-2@45")
    assert bench.tick(confirm, at(1, 45.0, t=0.03)) is Status.SUCCESS
    plan = bench.leaf("PlanInRing", opening="2-3@90", plan=Key("plan"))
    assert bench.tick(plan, at(1, 45.0, t=0.07)) is Status.SUCCESS  # planned in ring 2
    assert bench.board.get("plan").states[-1, 0] > 1.2


def test_without_seeing_it_coming_it_goes_on_pushing():
    bench = Bench()
    leaf = bench.leaf("PassOpening", opening="1-2@45")
    assert bench.tick(leaf, at(1, 45.0)) is Status.RUNNING
    assert bench.tick(leaf, at(1, 45.0, t=0.03)) is Status.RUNNING
    assert bench.run.here.ring == 1


def test_a_prediction_that_wavers_between_the_rings_is_no_failure():
    bench = Bench()
    falling(bench)
    rings = []
    for t, ring in ((0.03, 1), (0.07, 2), (0.1, 1), (0.13, 2)):
        state = at(ring, 45.0, t=t)
        bench.run.begin(t, state, state)
        rings.append(bench.run.here.ring)
    assert rings == [2, 2, 2, 2]


@pytest.mark.parametrize("came", [False, True])
def test_a_ball_that_does_not_come_missed_the_opening_and_one_that_came_fell_back(came):
    bench = Bench()
    bench.run.leg.opening = MAZE.opening("1-2@45")
    falling(bench)
    if came:
        state = at(2, 45.0, t=0.02)
        bench.run.begin(0.02, state, state)
        bench.run.leg.opening = MAZE.opening("2-3@90")  # chosen for the next leg meanwhile
    track = bench.leaf("Track", opening="2-3@90", plan=Key("plan"))
    bench.board.set("plan", None)
    state = at(1, 45.0, t=0.03)
    bench.run.begin(0.03, state, state)
    track.start()
    bench.run.begin(ENTERING + 0.05, state, state)
    assert bench.run.here.ring == 1
    assert track.step() is Status.FAILURE
    assert bench.failure() is (FailureKind.FELL_BACK if came else FailureKind.MISSED_OPENING)
    assert bench.run.graph.tries("1-2@45") == (0, 0 if came else 1)
    assert bench.run.leg.opening.name == ("2-3@90" if came else "1-2@45")  # which a recovery goes by
    assert bench.run.leg.refused is None


def test_a_fall_after_the_next_choice_is_not_blamed_on_an_opening_that_refused_the_ball_before():
    bench = Bench()
    bench.run.leg.opening = MAZE.opening("1-2@45")
    falling(bench)
    late = ENTERING + 0.05
    bench.run.begin(late, at(1, 45.0, t=late), at(1, 45.0, t=late))
    assert bench.run.leg.refused is MAZE.opening("1-2@45")
    choose = bench.leaf("ChooseOpening", goal=5, opening=Key("opening"))
    assert bench.tick(choose, at(2, 45.0, t=1.0)) is Status.SUCCESS
    track = bench.leaf("Track", opening=bench.board.get("opening"), plan=Key("plan"))
    bench.board.set("plan", None)
    track.start()
    bench.run.begin(1.1, at(1, 45.0, t=1.1), at(1, 45.0, t=1.1))
    assert track.step() is Status.FAILURE
    assert bench.failure() is FailureKind.FELL_BACK
