from __future__ import annotations

import math

import numpy as np
import pytest

from mazeplan.control.tilt import (
    Plate,
    deviation,
    finished,
    follow_gains,
    off_plan,
    pd_to_angle,
    plan_step,
)
from mazeplan.core.constants import GRAVITY
from mazeplan.core.records import Plan, State, StopReason
from mazeplan.run.settings import load_settings

PLATE = Plate(limit=0.0873)
RADIUS, TRACKING = 0.07, load_settings().leaves.tracking
STEPS = 10


def make_plan(theta0: float = 3.0) -> Plan:
    states = np.zeros((STEPS + 1, 6))
    states[:, 0] = theta0 + 0.05 * np.arange(STEPS + 1)
    states[:, 1] = 1.5
    controls = np.tile([0.02, -0.01], (STEPS, 1))
    gains = np.zeros((STEPS, 2, 6))
    gains[:, 0, 0], gains[:, 1, 1] = -0.5, 0.1
    return Plan(states, controls, gains, 1.0, StopReason.CONVERGED, 3, 0.5, t0=2.0)


def on_plan(plan: Plan, k: int, theta_error: float = 0.0, rate_error: float = 0.0) -> State:
    theta, rate = plan.states[k, 0] + theta_error, plan.states[k, 1] + rate_error
    return State(
        plan.t0 + k * plan.dt, RADIUS * math.cos(theta), RADIUS * math.sin(theta), -RADIUS * rate * math.sin(theta),
        RADIUS * rate * math.cos(theta), 0.0, 0.0, 0.0, 0.0, ring=2,
    )  # fmt: skip


@pytest.mark.parametrize("k", [0, 4, 9])
def test_on_the_plan_the_command_is_the_plans(k):
    plan = make_plan()  # theta runs through pi, where atan2 jumps
    state = on_plan(plan, k)
    assert np.allclose(deviation(plan, state), 0.0, atol=1e-12)
    command = follow_gains(plan, state, PLATE)
    assert (command.u_beta, command.u_gamma) == pytest.approx((0.02, -0.01))


def test_gains_correct_the_command():
    plan = make_plan()
    command = follow_gains(plan, on_plan(plan, 5, theta_error=0.02, rate_error=0.1), PLATE)
    assert (command.u_beta, command.u_gamma) == pytest.approx((0.02 - 0.5 * 0.02, -0.01 + 0.1 * 0.1))


def test_commands_are_limited():
    plan = make_plan()
    command = follow_gains(plan, on_plan(plan, 5, theta_error=-1.0, rate_error=-5.0), PLATE)
    assert (command.u_beta, command.u_gamma) == (PLATE.limit, -PLATE.limit)


def test_steps_belong_to_rig_time():
    plan = make_plan()
    assert [plan_step(plan, 2.0 + dt) for dt in (-1.0, 0.0, 0.06, 5.0)] == [0, 0, 2, STEPS - 1]
    assert not finished(plan, 2.0 + 9 / 30)
    assert finished(plan, 2.0 + 10 / 30)


def test_off_plan_by_angle_or_by_speed():
    plan, options = make_plan(), TRACKING
    assert not off_plan(plan, on_plan(plan, 2, 0.9 * options.replan_theta), options)
    assert off_plan(plan, on_plan(plan, 2, 1.1 * options.replan_theta), options)
    assert off_plan(plan, on_plan(plan, 2, 0.0, -1.1 * options.replan_speed), options)


def test_pd_without_a_plan_turns_brakes_and_leans():
    def pull(turn, speed, lean=0.0):
        theta = 0.7
        state = State(0.0, RADIUS * math.cos(theta), RADIUS * math.sin(theta), -speed * math.sin(theta),
                      speed * math.cos(theta), 0.0, 0.0, 0.0, 0.0, ring=2)  # fmt: skip
        command = pd_to_angle(state, turn, PLATE, TRACKING, RADIUS, lean)
        ax, ay = 9.81 * command.u_beta, -9.81 * command.u_gamma
        return -ax * math.sin(theta) + ay * math.cos(theta), ax * math.cos(theta) + ay * math.sin(theta)

    options = TRACKING
    along, outwards = pull(0.05, 0.02)
    assert along == pytest.approx((options.kp * 0.05 - options.kd * 0.02 / RADIUS) * RADIUS)
    assert outwards == pytest.approx(0.0, abs=1e-12)
    assert pull(0.0, 0.02, lean=-0.02)[1] == pytest.approx(-9.81 * math.sin(0.02))
    assert pull(2.0, 0.0)[0] == -pull(-2.0, 0.0)[0] > 0.4  # at its limits far away


LEANING = Plate(limit=math.radians(5.0), offset_beta=0.004, offset_gamma=-0.002)


def test_command_gives_the_wanted_acceleration_on_a_leaning_table():
    command = LEANING.command(0.3, -0.2)
    beta, gamma = command.u_beta + LEANING.offset_beta, command.u_gamma + LEANING.offset_gamma
    assert GRAVITY * beta == pytest.approx(0.3)
    assert -GRAVITY * gamma == pytest.approx(-0.2)


def test_commands_stay_inside_the_limit():
    command = LEANING.command(50.0, 50.0)
    assert (command.u_beta, command.u_gamma) == (LEANING.limit, -LEANING.limit)


SHARE = (0.08 - 0.5 / GRAVITY) / (2.0 / GRAVITY)  # of the second acceleration that the limit allows


@pytest.mark.parametrize(
    ("first", "then", "command"),
    [
        ((0.5, 0.0), (2.0, 0.3), (0.08, -SHARE * 0.3 / GRAVITY)),
        ((0.1, 0.1), (0.2, -0.3), (0.3 / GRAVITY, 0.2 / GRAVITY)),
        ((5.0, 0.0), (1.0, 1.0), (0.08, 0.0)),
    ],
    ids=["keeps its direction", "whole", "no room"],
)
def test_a_second_acceleration_never_changes_the_first(first, then, command):
    both = Plate(limit=0.08).command_along(first, then)
    assert (both.u_beta, both.u_gamma) == pytest.approx(command)
