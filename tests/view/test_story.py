"""From messages to moments: what is shown of a run is what the run told."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mazeplan.apps.view.story import TRAIL_S, BallShown, Story, TreeShown, moments
from mazeplan.core.logs.run_log_reader import read_messages
from mazeplan.maze.mapfile import dump_map, load_map
from mazeplan.run.execution import navigate

MAZE = load_map("cme")
HEADER = {"map": dump_map(MAZE), "goal_ring": 5, "replay": {"rate_hz": 30.0, "closed": ["1-2@45"]}}


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """One run: what went to the live page, and what its log has."""
    live, path = [], tmp_path_factory.mktemp("story") / "run.mcap"
    navigate(2, 5, rig="toy", seed=4, log=path, feed=lambda topic, t, document: live.append((topic, document)))
    return live, read_messages(path)[1]


def tick(k, x=0.089, y=0.0, **more):
    t = k / 30.0
    estimate = {"estimate_t": t + 0.1, "estimate_x": x, "estimate_y": y}
    return "/tick", {"t": t, "x": x, "y": y, "beta": 0.01, "gamma": 0.02, "u_beta": 0.03, "u_gamma": 0.04, "ring": 1,
                     **estimate, **more}  # fmt: skip


def plan(t0, theta, end):
    return "/plan", {"t0": t0, "dt": 1 / 30, "theta": np.linspace(theta, end, 41).tolist()}


def after(*messages):
    story = Story()
    for topic, document in (("/header", HEADER), *messages):
        story.take(topic, document)
    return story.moment


def test_live_and_recorded_a_run_shows_the_same(told):
    live, recorded = (moments(messages) for messages in told)
    assert len(live) == len(recorded) > 20
    for a, b in zip(live, recorded, strict=True):
        assert (a.t, a.ring, a.goal, a.leaf, a.opening, a.closed) == (b.t, b.ring, b.goal, b.leaf, b.opening, b.closed)
        assert (a.tree.statuses, a.tree.active) == (b.tree.statuses, b.tree.active)
        np.testing.assert_allclose(a.trail, b.trail, atol=1e-9)
        assert (a.plan is None) == (b.plan is None)


def test_each_moment_has_the_tick_it_is_of(told):
    shown, ticks = moments(told[1]), [document for topic, document in told[1] if topic == "/tick"]
    assert [m.t for m in shown] == [document["t"] for document in ticks]
    for moment, document in zip(shown, ticks, strict=True):
        assert moment.ball == BallShown(document["estimate_x"], document["estimate_y"], "x" in document)
        assert moment.tilt == (document["beta"], document["gamma"])
        # a plan is shown where one is followed, and it is the one: it leads through what the tick says
        assert (moment.plan is not None) == ("planned_theta" in document)
        if moment.plan is not None:
            off = np.arctan2(moment.plan[:, 1], moment.plan[:, 0]) - document["planned_theta"]
            assert np.abs(np.angle(np.exp(1j * off))).min() < 1e-5
    assert shown[-1].result is not None
    assert shown[-1].result["reason"] == "arrived"
    assert shown[-2].result is None


def test_of_several_plans_the_one_that_is_followed_is_shown():
    radius = MAZE.track_radius(1)
    east, north = plan(0.1, 0.0, 0.1), plan(0.1, 0.0, math.pi / 2)
    moment = after(east, north, tick(0, planned_theta=0.0, goal_theta=0.1, opening="1-2@45"))
    np.testing.assert_allclose(moment.plan[[0, -1]], [[radius, 0.0], [radius * math.cos(0.1), radius * math.sin(0.1)]])
    moment = after(east, north, tick(0, planned_theta=0.0, goal_theta=math.pi / 2, opening="1-2@45"))
    np.testing.assert_allclose(moment.plan[-1], [0.0, radius], atol=1e-12)
    assert after(east, tick(0)).plan is None  # nothing is followed


def test_openings_are_told_with_what_is_known_of_them():
    moment = after(tick(0, opening="2-3@0"))
    assert moment.opening == "2-3@0"
    assert "1-2@45" in moment.closed  # by the command that began the run
    assert "2-3@0" not in moment.closed


def test_the_last_failure_has_its_reason_and_its_recovery():
    failure = {"kind": "missed_opening", "where": "PassOpening", "detail": "2-3@0 did not take the ball"}
    messages = [tick(0), ("/event", {"t": 1.0, "kind": "failure", "detail": failure})]
    assert after(*messages).failure.recovery is None
    moment = after(*messages, ("/event", {"t": 1.0, "kind": "recovery", "detail": {"recovery": "replan"}}))
    told = (str(moment.failure.kind), moment.failure.where, moment.failure.recovery)
    assert told == ("missed_opening", "PassOpening", "replan")


def test_a_new_tree_and_a_new_run_begin_anew():
    tree = {"t": 0.0, "paths": ["a", "a/b"], "kinds": ["Sequence", "B"], "names": ["a", "b"], "parents": [-1, 0]}
    story = Story()
    for topic, document in (("/header", HEADER), ("/tree", tree), tick(0), ("/status", {"t": 0.0, "nodes": "RR"})):
        story.take(topic, document)
    first = story.moment
    assert (first.run, first.tree.number, first.tree.active) == (1, 1, (0, 1))
    story.take("/tree", {**tree, "paths": ["c"], "kinds": ["C"], "names": ["c"], "parents": [-1]})
    second = story.moment
    assert second.tree == TreeShown(2, second.tree.nodes)
    assert len(second.tree.nodes) == 1
    story.take("/header", HEADER)
    third = story.moment
    assert (third.run, third.tick, len(third.trail), third.ball, third.tree) == (2, 0, 0, None, TreeShown())


def test_a_long_run_keeps_its_last_seconds():
    moment = after(*(tick(k, x=0.08 + 1e-6 * k) for k in range(400)))
    kept = round(TRAIL_S * 30)
    assert kept <= len(moment.trail) <= kept + 1
    assert moment.trail[-1, 0] == pytest.approx(0.08 + 1e-6 * 399)
