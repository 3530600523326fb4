"""What is special about records of navigation: many positions near openings, roll-outs that lose the ball, a likelihood
that is no parabola."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from mazeplan.control.estimation.rigid_body_filter import BodyModel
from mazeplan.control.estimation.rigid_body_fit import value_of
from mazeplan.core.errors import TableError
from mazeplan.diagnosis.rig.candidates import CANDIDATES
from mazeplan.diagnosis.rig.fitting import fit_start
from mazeplan.diagnosis.rig.scores import AHEAD, LOST, HeldOut
from mazeplan.diagnosis.rig.starts import FEWEST, check_map
from mazeplan.maze.mapfile import load_map

MAZE = load_map("cme")


def in_channels(maze, count, rng):
    """Positions (count, 2), m, somewhere in the channels of the rings, all but a few along their walls."""
    channels = [(ring.inner_radius, ring.outer_radius) for ring in maze.rings if not ring.is_disc]
    low, high = np.array(channels)[rng.integers(len(channels), size=count)].T
    at = np.clip(rng.uniform(-1.0, 2.0, count), 0.0, 1.0)
    r = low + maze.ball.radius + at * (high - low - 2.0 * maze.ball.radius)
    theta = rng.uniform(-math.pi, math.pi, count)
    return np.column_stack([r * np.cos(theta), r * np.sin(theta)])


def body_of(y):
    return SimpleNamespace(pictures=SimpleNamespace(y=y), walls=SimpleNamespace(radius=MAZE.ball.radius))


def in_openings(maze, each):
    """Positions in the middle of all openings, m, so many in each."""
    r, theta = np.array([[maze.threshold_radius(opening), opening.angle] for opening in maze.openings]).T
    return np.repeat(np.column_stack([r * np.cos(theta), r * np.sin(theta)]), each, axis=0)


def test_a_ball_that_lies_in_openings_is_on_the_map():
    y = np.concatenate([in_channels(MAZE, 300, np.random.default_rng(0)), in_openings(MAZE, 100)])
    check_map(body_of(y), MAZE, "a.csv")
    y[300:] = [0.5 * (MAZE.ring(1).outer_radius + 0.13), 0.0]  # outside of all rings
    with pytest.raises(TableError, match=r"a\.csv: away from openings, .* in no ring .* in [0-9]+% .* --map"):
        check_map(body_of(y), MAZE, "a.csv")


def test_a_ball_that_lies_in_openings_all_the_time_says_nothing_about_the_map():
    few = in_channels(load_map("seven"), FEWEST // 2, np.random.default_rng(0))
    check_map(body_of(np.concatenate([few, in_openings(MAZE, 100)])), MAZE, None)


def held(before, plain, after):
    """Mean errors given half way and at the end."""
    rows = [np.repeat([half, end], AHEAD // 2)[:, None] * np.ones((1, 3)) for half, end in (before, plain, after)]
    return HeldOut(np.arange(3), rows[0], rows[2], np.ones(2), rows[1])


def test_errors_of_roll_outs_that_have_lost_the_ball_do_not_decide():
    lost = held((0.2, 1.0), (0.18, 1.05), (0.13, 1.1))
    assert lost.ahead == AHEAD // 2
    assert lost.better
    assert lost.ball_effects_not_worse()
    assert not held((0.2, 1.0), (0.2, 1.0), (0.25, 0.9)).better


def test_errors_of_near_roll_outs_decide_if_far_ones_are_worse():
    near = held((0.2, LOST - 0.1), (0.18, LOST - 0.1), (0.13, LOST - 0.05))
    assert near.ahead == AHEAD // 2
    assert near.better
    assert near.ball_effects_not_worse()
    assert held((0.2, 0.4), (0.2, 0.4), (0.25, 0.3)).ahead == AHEAD
    worse = held((0.2, 0.4), (0.2, 0.4), (0.25, 0.45))
    assert worse.ahead == AHEAD
    assert not worse.better
    assert not worse.ball_effects_not_worse()


@pytest.mark.parametrize("lean", [(0.0, 0.016), (-0.006, 0.0), (0.004, -0.004)])
def test_a_fit_of_a_lean_may_start_far_off_in_any_direction(lean):
    class Body:  # its likelihood falls in a straight line towards the lean
        def innovations(self, model):
            at = np.array([value_of(model, "tilt_beta"), value_of(model, "tilt_gamma")])
            return SimpleNamespace(minus2=1e4 * float(np.hypot(*(at - lean))))

    (candidate,) = [c for c in CANDIDATES if c.effect == "tilt_offset"]
    minus2, model = fit_start(Body(), BodyModel(), candidate, {})
    start = np.array([value_of(model, "tilt_beta"), value_of(model, "tilt_gamma")])
    assert np.hypot(*(start - lean)) < 0.5 * np.hypot(*lean)
    assert minus2 == pytest.approx(1e4 * np.hypot(*(start - lean)))


@pytest.mark.parametrize("other", ["seven", "lopsided"])  # the first has openings at other places, in the same rings
def test_runs_on_another_map_are_seen(other):
    y = np.concatenate([in_channels(MAZE, 600, np.random.default_rng(0)), in_openings(MAZE, 20)])
    check_map(body_of(y), MAZE, None)
    with pytest.raises(TableError, match="in no ring of the map"):
        check_map(body_of(y), load_map(other), None)
