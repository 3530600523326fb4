"""Trying commands before an opening: the compiled law, the time to pass, and what is chosen."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from planar_rig import PATIENT, PlanarRig, known

from mazeplan.control.opening import opening_command
from mazeplan.control.opening_rollout import TICK, OpeningRollout, law_command, passing_time
from mazeplan.control.tilt import Plate
from mazeplan.core.constants import FREE_ROLLING, GRAVITY
from mazeplan.core.errors import SettingsError
from mazeplan.core.records import State
from mazeplan.learning.modelfile import load_model
from mazeplan.maze.mapfile import load_map
from mazeplan.run.assembly import rollout_of
from mazeplan.run.execution import run_job
from mazeplan.run.settings import load_settings
from mazeplan.run.specification import Job, Setup

MAZE = load_map("cme")
PLATE = Plate(MAZE.tilt_limit, 0.004, -0.006)
GATE, ROLLOUT = load_settings().leaves.gate, load_settings().leaves.rollout
PLANAR = known(MAZE).planar(MAZE)
BIAS = np.array([known(MAZE).ball(1).parameter("tilt_offset", axis, 0.0) for axis in ("beta", "gamma")])  # rad


def rollout(**options):
    return OpeningRollout(MAZE, PLANAR, PLATE, GATE, replace(ROLLOUT, **options))


def beside(name, across, across_speed=0.0, tilt=(0.0, 0.0)):
    """The ball at the inner wall of an opening's outer ring, off to a side (m, m/s)."""
    o = MAZE.opening(name)
    along = MAZE.ring(o.outer).inner_radius + MAZE.ball.radius
    c, s = math.cos(o.angle), math.sin(o.angle)
    x, y = c * along - s * across, s * along + c * across
    return State(0.0, x, y, -s * across_speed, c * across_speed, tilt[0], 0.0, tilt[1], 0.0, o.outer)


def vector(state):
    return np.array([state.x, state.y, state.vx, state.vy, state.beta, 0.0, state.gamma, 0.0])


def gap(name, sign=-1.0):
    o = MAZE.opening(name)
    wall = next(w for w in MAZE.walls if o in w.openings)
    return np.array([math.cos(o.angle), math.sin(o.angle), sign, 0.5 * (wall.inner_radius + wall.outer_radius)])


@pytest.mark.parametrize("name", ["1-2@45", "2-3@180", "4-5@180"])
@pytest.mark.parametrize("outwards", [False, True])
def test_the_compiled_law_is_that_of_the_gate(name, outwards):
    opening, rng = MAZE.opening(name), np.random.default_rng(4)
    law = rollout()._law.copy()
    law[2] = 0.0  # without the look ahead, which the gate has from the caller
    target = opening.outer if outwards else opening.inner
    for _ in range(40):
        state = beside(name, *rng.uniform(-0.015, 0.015, 1), *rng.uniform(-0.15, 0.15, 1))
        out = np.empty(2)
        law_command(vector(state), gap(name, 1.0 if outwards else -1.0), law, out)
        expected = opening_command(state, opening, target, PLATE, GATE)
        assert out == pytest.approx((expected.u_beta, expected.u_gamma), abs=1e-12)


@pytest.mark.parametrize("steps", [5, 10])
def test_a_ball_in_front_falls_through_as_gravity_has_it(steps):
    tilt = math.radians(4.0)
    plate = np.array([tilt / math.sqrt(2), -tilt / math.sqrt(2)])  # the opening at 225 degrees: inwards is +x, +y
    state = beside("1-2@225", 0.0, tilt=tuple(plate - BIAS))
    z, where = vector(state), gap("1-2@225")
    time = passing_time(z, plate - BIAS, 100, where, rollout()._law, (1.0, steps, TICK), *PLANAR)
    pull = FREE_ROLLING * GRAVITY * math.sqrt(2) * math.sin(tilt / math.sqrt(2))
    assert time == pytest.approx(math.sqrt(2 * (state.r - where[3]) / pull), rel=0.04)
    assert math.hypot(z[0], z[1]) == pytest.approx(where[3], abs=2e-3)


def test_a_ball_that_stays_is_later_than_the_horizon():
    held = np.array([-MAZE.tilt_limit, MAZE.tilt_limit])  # outwards at 225 degrees
    time = passing_time(
        vector(beside("1-2@225", 0.0)), held, 100, gap("1-2@225"), rollout()._law, (0.4, 10, TICK), *PLANAR
    )
    assert time > 0.4


def test_the_chosen_command_is_sooner_by_the_margin():
    law, none, chosen = rollout()._law, np.zeros(2), 0
    options = replace(ROLLOUT, doubt_mm=0.0, doubt_m_s=0.0)
    tries, span = OpeningRollout(MAZE, PLANAR, PLATE, GATE, options), (0.5, options.substeps, TICK)
    for across in np.linspace(-0.012, 0.012, 13):
        state = beside("2-3@90", across, -8.0 * across, (0.0, -0.05))
        command = tries.improved_command(state, MAZE.opening("2-3@90"), 3)
        by_law = passing_time(vector(state), none, 0, gap("2-3@90"), law, span, *PLANAR)
        if command is None:
            continue
        chosen += 1
        u = np.array([command.u_beta, command.u_gamma])
        assert np.abs(u).max() <= MAZE.tilt_limit
        best = min(passing_time(vector(state), u, n, gap("2-3@90"), law, span, *PLANAR) for n in (1, 2, 4))
        assert best < by_law - options.margin_s
    assert chosen >= 3


def test_too_few_steps_are_refused():
    with pytest.raises(SettingsError, match="got 3, expected 4 to 40"):
        replace(ROLLOUT, substeps=3)
    held = np.array([-MAZE.tilt_limit, MAZE.tilt_limit])
    for speed in (0.2, 0.5, 0.8):  # beside the opening at 225 degrees, towards the wall
        z = vector(beside("1-2@225", 0.03))
        z[2:4] = -speed * z[:2] / math.hypot(z[0], z[1])
        assert passing_time(z, held, 100, gap("1-2@225"), rollout()._law, (0.2, 4, TICK), *PLANAR) > 0.2


def test_what_is_not_known_of_the_ball_counts():
    """A command that only an exact ball could follow is not chosen where a start beside it fares badly."""
    differs = 0
    for across in np.linspace(-0.012, 0.012, 13):
        state = beside("3-4@45", across, -6.0 * across)
        opening = MAZE.opening("3-4@45")
        differs += rollout(doubt_mm=0.0, doubt_m_s=0.0).improved_command(state, opening, 4) != rollout(
            doubt_mm=2.0, doubt_m_s=0.05
        ).improved_command(state, opening, 4)
    assert differs >= 2
    starts = replace(ROLLOUT, doubt_mm=2.0, doubt_m_s=0.05).starts()
    assert np.ptp(starts, axis=0) == pytest.approx([0.004, 0.1])


def test_through_openings_it_saves_time():
    """On the planar rig, whose physics the rollouts know: the mean of a few whole runs, with and without."""
    without = PATIENT.with_values({"rollout": {"margin_s": 1e3}})
    times = [
        [
            run_job(PlanarRig(MAZE), Setup(MAZE, known(MAZE), settings=s), Job(1, 5, None, seed)).time_s
            for seed in range(6)
        ]
        for s in (PATIENT, without)
    ]
    assert np.mean(times[0]) < np.mean(times[1]) - 0.015
    assert all(mine <= other + 1e-9 for mine, other in zip(*times, strict=True))


@pytest.mark.parametrize("wrong", [{"grid": 0}, {"margin_s": -0.1}, {"horizon_s": 0.0}])
def test_options_that_make_no_sense(wrong):
    with pytest.raises(SettingsError, match=next(iter(wrong))):
        replace(ROLLOUT, **wrong)


@pytest.mark.parametrize(("late_s", "bead", "body"), [(0.07, True, True), (0.12, False, True), (0.2, False, False)])
def test_a_rigid_ball_allows_a_longer_delay(late_s, bead, body):
    toy, options = load_model("toy"), load_settings().leaves
    tried = [rollout_of(MAZE, model, options, late_s) is not None for model in (replace(toy, body=None), toy)]
    assert tried == [bead, body]
