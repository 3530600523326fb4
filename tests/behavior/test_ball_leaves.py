"""Leaves for several balls."""

from __future__ import annotations

from dataclasses import replace

import pytest
from test_leaves import MAZE, Bench, at

from mazeplan.behavior.context import BallView
from mazeplan.btree.status import Status
from mazeplan.core.errors import TreeError
from mazeplan.core.records import FailureKind


class Two(Bench):
    """A bench with two balls."""

    def __init__(self):
        super().__init__()
        self.run.balls.aheads = (lambda *_: self.run.balls.views[0].state, lambda *_: self.run.balls.views[1].state)

    def see(self, *states, t=0.0):
        first, second = (replace(state, t=t) for state in states)
        self.run.begin(t, first, first, None, (BallView(second, second),))

    def once(self, kind, **ports):
        leaf = self.leaf(kind, **ports)
        leaf.execute()
        return leaf.status


@pytest.fixture
def two():
    return Two()


def test_the_ball_that_can_be_there_soonest_is_chosen(two):
    for states, soonest in (((at(1), at(3)), 2), ((at(4, 180.0), at(4, 0.0)), 1), ((at(5), at(1)), 2)):
        two.see(*states)
        leaf = two.leaf("ChooseBall", goal=5)
        numbers = []
        leaf.set = lambda port, value, into=numbers: into.append(value)
        leaf.execute()
        assert (leaf.status, numbers) == (Status.SUCCESS, [soonest])


def test_without_a_way_for_any_ball_there_is_no_route(two):
    two.see(at(1), at(2))
    for opening in MAZE.openings_between(4, 5):
        two.run.graph.close(opening.name)
    assert two.once("ChooseBall", goal=5) is Status.FAILURE
    assert two.failure() is FailureKind.NO_ROUTE


def test_leaves_act_for_the_ball_that_is_led(two):
    two.see(at(5), at(2, 30.0))
    assert two.once("InRing", ring=2) is Status.FAILURE
    assert two.once("LeadBall", ball=2, centre=5) is Status.SUCCESS
    assert two.once("InRing", ring=2) is Status.SUCCESS
    assert two.run.ahead(0.1).ring == 2
    assert two.run.balls.kept == {1}
    two.see(at(5), at(3, 40.0), t=0.1)
    assert (two.run.here.ring, two.run.measured.ring) == (3, 3)
    assert two.once("LeadBall", ball=1, centre=5) is Status.SUCCESS
    assert (two.run.here.ring, two.run.balls.kept) == (5, frozenset())


def test_what_belongs_to_the_ball_before_is_forgotten(two):
    two.see(at(1, 45.0), at(2))
    two.run.leg.opening = two.run.leg.refused = MAZE.openings[0]
    two.run.leg.enter(two.run.here.ring, 2, two.run.now)
    assert two.once("LeadBall", ball=2, centre=5) is Status.SUCCESS
    two.see(at(1, 45.0), at(1, 60.0), t=0.1)
    assert two.run.here.ring == 1  # not taken for one that falls into ring 2
    assert (two.run.leg.opening, two.run.leg.refused) == (None, None)


@pytest.mark.parametrize(("led", "ring"), [(1, 2), (2, 1)])
def test_another_goal_keeps_the_fall_of_the_ball_that_its_tree_leads(two, led, ring):
    two.see(at(1, 45.0), at(1, 60.0))
    two.once("LeadBall", ball=led, centre=5)
    two.run.leg.opening = MAZE.openings[0]
    two.run.leg.enter(two.run.here.ring, 2, two.run.now)
    before, two.run = two.run, Two().run
    two.run.carry_on(before)
    two.see(at(1, 45.0), at(1, 60.0), t=0.1)
    assert two.run.here.ring == ring
    assert (two.run.leg.falling is not None) is (led == 1)


def test_a_kept_ball_that_left_is_a_failure_once(two):
    two.see(at(5), at(2))
    two.once("LeadBall", ball=2, centre=5)
    assert two.once("BallsStay", centre=5) is Status.SUCCESS
    two.see(at(4, 180.0), at(2), t=0.1)
    assert two.once("BallsStay", centre=5) is Status.FAILURE
    assert two.failure() is FailureKind.LEFT_THE_CENTRE
    assert two.run.history.failures[-1].words == "ball 1 left ring 5 for ring 4"
    assert two.once("BallsStay", centre=5) is Status.SUCCESS
    assert len(two.run.history.failures) == 1


UNSEEN = replace(at(5), x=0.0, y=0.0, seen=False, lost=True)  # as the estimator has a ball before it is first seen


def chosen(two, *states):
    two.see(*states)
    leaf, numbers = two.leaf("ChooseBall", goal=5), []
    leaf.set = lambda port, value: numbers.append(value)
    leaf.execute()
    return leaf.status, numbers


def test_a_ball_that_was_not_seen_yet_is_not_in_the_centre(two):
    two.see(at(2), UNSEEN)
    two.once("LeadBall", ball=1, centre=5)
    assert two.run.balls.kept == frozenset()
    assert two.once("BallsStay", centre=5) is Status.SUCCESS
    two.see(at(2), at(1), t=0.1)
    assert two.once("BallsStay", centre=5) is Status.SUCCESS
    assert two.run.history.failures == []


def test_a_ball_that_is_first_seen_in_the_centre_is_kept_from_then_on(two):
    two.see(at(2), UNSEEN)
    two.once("LeadBall", ball=1, centre=5)
    two.see(at(2), at(5), t=0.1)
    assert two.once("BallsStay", centre=5) is Status.SUCCESS
    assert two.run.balls.kept == {2}
    two.see(at(2), at(4), t=0.2)
    assert two.once("BallsStay", centre=5) is Status.FAILURE
    assert two.failure() is FailureKind.LEFT_THE_CENTRE


def test_a_kept_ball_that_is_lost_is_watched_when_it_is_found(two):
    two.see(at(5), at(2))
    two.once("LeadBall", ball=2, centre=5)
    two.see(replace(at(4), seen=False, lost=True), at(2), t=0.1)  # in ring 4 only by the prediction
    assert two.once("BallsStay", centre=5) is Status.SUCCESS
    two.once("LeadBall", ball=2, centre=5)
    assert two.run.balls.kept == {1}
    two.see(at(4), at(2), t=0.2)
    assert two.once("BallsStay", centre=5) is Status.FAILURE
    assert two.run.history.failures[-1].words == "ball 1 left ring 5 for ring 4"


def test_a_lost_ball_is_chosen_after_all_seen_ones(two):
    lost = replace(at(4, 180.0), seen=False, lost=True)
    assert chosen(two, lost, at(1)) == (Status.SUCCESS, [2])
    assert chosen(two, at(5), lost) == (Status.SUCCESS, [2])
    assert chosen(two, at(5), UNSEEN) == (Status.SUCCESS, [2])
    assert chosen(two, lost, UNSEEN) == (Status.SUCCESS, [1])  # the ball that is led
    for opening in MAZE.openings_between(4, 5):
        two.run.graph.close(opening.name)
    assert chosen(two, UNSEEN, at(1)) == (Status.FAILURE, [])


def test_a_ball_that_there_is_not_is_named(two):
    two.see(at(1), at(1))
    with pytest.raises(TreeError, match="ball: got 3, expected 1 to 2"):
        two.once("LeadBall", ball=3, centre=5)
