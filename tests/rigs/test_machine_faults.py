"""What can be made to go wrong inside the simulated rig while it runs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mazeplan.errors import RigError, SettingsError
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.settings import Fault
from mazeplan.rigs.simulated import SimulatedRig

MAZE = load_map("cme")


def placed(theta=0.3, **settings):
    machine = SimulatedRig(MAZE, settings)
    machine.reset(ring=1, theta=theta, rng=np.random.default_rng(0))
    return machine


def driven(machine, samples, u_beta=0.0, u_gamma=0.0):
    seen, true = [], []
    for _ in range(samples):
        seen.append(machine.observe())
        true.append(machine.truth())
        machine.command(u_beta, u_gamma)
    return seen, np.array(true)


def test_a_ball_that_is_elsewhere_all_at_once():
    machine = placed()
    driven(machine, 9, 0.02, -0.03)
    machine.inject(Fault(kind="teleport", at_s=0.0, ring=3, direction_deg=100.0))
    _, true = driven(machine, 3, 0.02, -0.03)
    assert math.hypot(*true[1, :2]) == pytest.approx(MAZE.track_radius(3), abs=1e-3)
    assert math.degrees(math.atan2(true[1, 1], true[1, 0])) == pytest.approx(100.0, abs=1.0)
    assert math.hypot(*true[1, 3:5]) < 0.02
    _, true = driven(machine, 30)  # once, not at every step
    assert math.hypot(*(true[-1, :2] - true[0, :2])) > 1e-3


def test_a_ball_that_is_taken_out_is_not_seen_and_comes_back_where_it_was():
    machine = placed(camera_delay_frames=2)
    driven(machine, 10)
    before = machine.truth()[:2]
    machine.inject(Fault(kind="removed", at_s=10 / 30, duration_s=0.5))
    seen, _ = driven(machine, 30, 0.03, 0.03)
    gone = [k for k, sample in enumerate(seen) if not sample.seen]
    assert gone == list(range(gone[0], gone[-1] + 1))
    assert gone[0] in (2, 3)  # the camera is late by two samples
    assert len(gone) == 15
    back = seen[gone[-1] + 1]
    assert (back.x, back.y) == pytest.approx(tuple(before), abs=2e-3)


def servo(machine, kind, **more):
    """Where the plate is after 14 samples of a command to (0.08, 0.08) with a fault that began before them."""
    machine.inject(Fault(kind=kind, at_s=0.4, duration_s=0.6, **more))
    _, true = driven(machine, 15)
    assert np.abs(true[:, 5:]).max() < 1e-3
    _, true = driven(machine, 15, 0.08, 0.08)
    _, after = driven(machine, 20, 0.08, 0.08)
    assert after[-1, 5:] == pytest.approx([0.08, 0.08], abs=2e-3)
    return true[-1, 5:]


def test_a_slow_servo_follows_at_its_speed():
    beta, gamma = servo(placed(), "slow_axis", axis="beta", slew_deg_s=5.0)
    assert math.radians(1.7) < beta < math.radians(2.4)  # 5 deg/s for 14 samples; the servo is a little behind
    assert gamma == pytest.approx(0.08, abs=2e-3)


def test_a_servo_beside_its_commands():
    machine = placed()
    machine.inject(Fault(kind="offset_axis", axis="gamma", at_s=0.0, duration_s=1.0, offset_deg=-2.0))
    _, true = driven(machine, 30, 0.05, 0.05)
    assert true[-1, 5:] == pytest.approx([0.05, 0.05 - math.radians(2.0)], abs=2e-3)
    _, true = driven(machine, 30, 0.05, 0.05)
    assert true[-1, 5:] == pytest.approx([0.05, 0.05], abs=2e-3)


def test_without_current_the_plate_goes_to_its_middle():
    machine = placed()
    driven(machine, 20, 0.05, -0.05)
    machine.inject(Fault(kind="brown_out", axis="both", at_s=0.0, duration_s=20 / 30 + 0.5))
    _, true = driven(machine, 14, 0.05, -0.05)
    assert np.abs(true[-1, 5:]).max() < 2e-3
    _, true = driven(machine, 20, 0.05, -0.05)
    assert true[-1, 5:] == pytest.approx([0.05, -0.05], abs=2e-3)


def test_both_axes_can_be_dead():
    assert servo(placed(), "dead_axis", axis="both") == pytest.approx([0.0, 0.0], abs=1e-3)


def test_what_cannot_be_injected():
    machine = placed()
    with pytest.raises(SettingsError, match=r"opening: got '9-9@1', expected one of 1-2@45"):
        machine.inject(Fault(kind="blocked", opening="9-9@1", at_s=0.0))
    with pytest.raises(SettingsError, match="ring: got 6, expected 1 to 5"):
        machine.inject(Fault(kind="teleport", ring=6, at_s=0.0))
    with pytest.raises(RigError, match="before reset"):
        SimulatedRig(MAZE, {}).inject(Fault(kind="stuck", at_s=0.0))
