"""Axes that follow at once, with a first-order lag, or as a second-order servo, with and without a limited rate."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from stage_kinds import DT, KINDS, jumps

from mazeplan.control.estimation.tilt_filter import servo_step
from mazeplan.physics.rig.stage import PROMPT, SUBSTEP, TYPICAL_RAD, StageAxis, fine_motion, simulate_axis

PER = 6  # moments of a sample
FREE = {name: replace(axis, rate_limit=math.inf) for name, axis in KINDS.items()}


@pytest.mark.parametrize("w", [3.0, 16.0, 40.0])
@pytest.mark.parametrize("dt", [0.0, 0.004, DT, 0.5])
def test_the_transition_is_that_of_the_equation(w, dt):
    """Only the present command moves an axis that follows at once: what was before is gone after any time."""
    assert np.array_equal(StageAxis.prompt().transition(dt), [[float(dt == 0.0), 0.0], [0.0, 0.0]])
    decay = math.exp(-w * dt)
    first = StageAxis(1.0, w, 1.0, order=1).transition(dt)
    np.testing.assert_allclose(first, [[decay, 0.0], [-w * decay, 0.0]], atol=1e-14)
    for zeta in (0.2, 1.0, 2.5):
        M = np.array([[0.0, 1.0], [-w * w, -2.0 * zeta * w]])
        axis = StageAxis(1.0, w, zeta)
        np.testing.assert_allclose(axis.transition(dt), expm(M * dt), rtol=1e-9, atol=1e-9)
        assert axis.acceleration(0.3, -0.7) == pytest.approx((M @ [0.3, -0.7])[1])


@pytest.mark.parametrize("name", FREE)
def test_fine_motion_is_the_simulation_between_the_samples(name):
    axis, u = FREE[name], jumps(1, 90)[:, 0]
    motion = fine_motion(axis, u, DT, PER)
    finer = simulate_axis(axis, np.repeat(u, PER * 10), DT / PER / 10)  # the closed form, at ten times as many moments
    jumps_at = np.flatnonzero(np.diff(u)) * DT + DT + axis.dead_time  # of angle or rate, where the order is below 2
    apart = np.min(np.abs(np.arange(len(motion))[:, None] * DT / PER - jumps_at), axis=1) > 2.0 * SUBSTEP
    jumped = ~apart & (axis.order < 2)
    late = axis.dead_time % SUBSTEP > 1e-9  # less than a step of dead time is interpolated, along the rate
    assert np.abs(motion[:, 0] - finer[::10])[~jumped].max() < (2e-5 if late else 1e-12)
    if axis.order:  # the others have no rate but in jumps
        slope = np.gradient(finer, DT / PER / 10)[::10]
        assert np.abs(motion[:, 1] - slope)[~jumped][1:-1].max() < 0.02 * np.abs(slope).max()
    assert np.any(motion[:, 2]) == (axis.order == 2)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_a_limited_rate_makes_a_step_take_its_time(order):
    """A quick axis turns evenly; both simulations of it agree."""
    axis = StageAxis(1.0, 400.0, 1.0, 0.05, order=order, rate_limit=0.5)
    u = np.where(np.arange(30) > 0, 0.1, 0.0)
    motion = fine_motion(axis, u, DT, PER)
    t = np.arange(len(motion)) * DT / PER - DT - axis.dead_time
    assert np.abs(motion[:, 0] - np.clip(0.5 * t, 0.0, 0.1)).max() < 3e-3
    assert motion[:, 1].max() == pytest.approx(0.5, abs=1e-9)
    np.testing.assert_allclose(simulate_axis(axis, u, DT), motion[::PER, 0], atol=1e-6)


@pytest.mark.parametrize("name", FREE)
def test_gears_behind_the_lag_hold_the_plate_while_the_servo_turns_in_them(name):
    """The plate is pushed by whichever end of the play the servo is at, and stands in between."""
    axis = replace(FREE[name], backlash=0.02, behind=True)
    u = jumps(3, 90)[:, 0]
    servo, plate = (fine_motion(one, u, DT, PER) for one in (replace(axis, backlash=0.0), axis))
    at = servo[0, 0]
    for i, angle in enumerate(servo[:, 0]):
        at = angle + 0.01 if at > angle + 0.01 else angle - 0.01 if at < angle - 0.01 else at
        assert plate[i, 0] == pytest.approx(at, abs=1e-12)
    moves = np.flatnonzero(np.diff(plate[:, 0])) + 1
    np.testing.assert_allclose(plate[moves, 1:], servo[moves, 1:])
    assert not np.any(np.delete(plate[:, 1:], moves, axis=0))
    assert np.abs(simulate_axis(axis, u, DT) - plate[::PER, 0]).max() < 2e-3


@pytest.mark.parametrize("axis", [*KINDS.values(), StageAxis(1.0, 20.0, 1.6, rate_limit=0.8)], ids=str)
def test_the_filter_of_the_plate_steps_as_the_simulation_does(axis):
    axis, u = replace(axis, dead_time=0.0), jumps(2, 60)[:, 0]
    state, angles = np.array([axis.offset, 0.0]), []
    for command in u:
        angles.append(state[0])
        state = servo_step(axis, state, float(command), DT)
    np.testing.assert_allclose(angles, simulate_axis(axis, u, DT), atol=1e-6)


@pytest.mark.parametrize(
    "axis", [StageAxis(1.0, 9.0, 1.0, order=1), StageAxis(1.0, 200.0, 3.0), StageAxis(1.0, 30.0, 1.4)], ids=str
)
def test_the_slow_pole_of_an_axis_stays_where_a_plan_takes_it_for_a_servo(axis):
    fastest = 120.0
    for w, zeta in (axis.second_order(fastest), axis.careful(fastest)):
        poles = np.sort(-np.roots([1.0, 2.0 * zeta * w, w * w]).real)
        assert poles[0] == pytest.approx(axis.slowest())
        assert poles[1] <= fastest * (1.0 + 1e-9)


def test_a_plan_counts_on_no_more_than_a_record_shows():
    assert StageAxis.prompt().second_order(120.0) == (120.0, 1.0)
    assert StageAxis.prompt().careful(120.0) == (PROMPT, 1.0)
    limited = replace(KINDS["limited"], rate_limit=0.4)
    w, zeta = limited.careful(120.0)
    t = np.linspace(0.0, 2.0, 2001)
    rate = np.gradient(TYPICAL_RAD * (1.0 - np.exp(-w * t) * (1.0 + w * t)), t)  # critically damped, over a wide step
    assert (zeta, rate.max()) == (1.0, pytest.approx(0.4, rel=1e-3))
    assert limited.lag > StageAxis.prompt().lag
