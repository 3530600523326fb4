"""Faults of the simulated machine: from its settings, and injected while it runs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from simulation import MAZE, drive, rig

from mazeplan.rigs.sim.settings import Fault


def test_a_ball_that_is_elsewhere_all_at_once():
    machine = rig(theta=0.3)
    drive(machine, 9 / 30.0, 0.02, -0.03)
    machine.inject(Fault(kind="teleport", at_s=0.0, ring=3, direction_deg=100.0))
    _, true = drive(machine, 3 / 30.0, 0.02, -0.03)
    assert math.hypot(*true[1, :2]) == pytest.approx(MAZE.track_radius(3), abs=1e-3)
    assert math.degrees(math.atan2(true[1, 1], true[1, 0])) == pytest.approx(100.0, abs=1.0)
    assert math.hypot(*true[1, 3:5]) < 0.02
    _, true = drive(machine, 30 / 30.0)  # once, not at every step
    assert math.hypot(*(true[-1, :2] - true[0, :2])) > 1e-3


def test_a_removed_ball_comes_back_where_it_was():
    machine = rig(theta=0.3, camera_delay_frames=2)
    drive(machine, 10 / 30.0)
    before = machine.truth()[:2]
    machine.inject(Fault(kind="removed", at_s=10 / 30, duration_s=0.5))
    seen, _ = drive(machine, 30 / 30.0, 0.03, 0.03)
    gone = [k for k, sample in enumerate(seen) if not sample.seen]
    assert gone == list(range(gone[0], gone[-1] + 1))
    assert gone[0] in (2, 3)  # the camera is late by two samples
    assert len(gone) == 15
    back = seen[gone[-1] + 1]
    assert (back.x, back.y) == pytest.approx(tuple(before), abs=2e-3)


def servo(machine, kind, **more):
    """Where the plate is after 14 samples of a command to (0.08, 0.08) with a fault that began before them."""
    machine.inject(Fault(kind=kind, at_s=0.4, duration_s=0.6, **more))
    _, true = drive(machine, 15 / 30.0)
    assert np.abs(true[:, 5:]).max() < 1e-3
    _, true = drive(machine, 15 / 30.0, 0.08, 0.08)
    _, after = drive(machine, 20 / 30.0, 0.08, 0.08)
    assert after[-1, 5:] == pytest.approx([0.08, 0.08], abs=2e-3)
    return true[-1, 5:]


def test_a_slow_servo_follows_at_its_speed():
    beta, gamma = servo(rig(theta=0.3), "slow_axis", axis="beta", slew_deg_s=5.0)
    assert math.radians(1.7) < beta < math.radians(2.4)  # 5 deg/s for 14 samples; the servo is a little behind
    assert gamma == pytest.approx(0.08, abs=2e-3)


def test_a_servo_beside_its_commands():
    machine = rig(theta=0.3)
    machine.inject(Fault(kind="offset_axis", axis="gamma", at_s=0.0, duration_s=1.0, offset_deg=-2.0))
    _, true = drive(machine, 30 / 30.0, 0.05, 0.05)
    assert true[-1, 5:] == pytest.approx([0.05, 0.05 - math.radians(2.0)], abs=2e-3)
    _, true = drive(machine, 30 / 30.0, 0.05, 0.05)
    assert true[-1, 5:] == pytest.approx([0.05, 0.05], abs=2e-3)


def test_without_current_the_plate_goes_to_its_middle():
    machine = rig(theta=0.3)
    drive(machine, 20 / 30.0, 0.05, -0.05)
    machine.inject(Fault(kind="brown_out", axis="both", at_s=0.0, duration_s=20 / 30 + 0.5))
    _, true = drive(machine, 14 / 30.0, 0.05, -0.05)
    assert np.abs(true[-1, 5:]).max() < 2e-3
    _, true = drive(machine, 20 / 30.0, 0.05, -0.05)
    assert true[-1, 5:] == pytest.approx([0.05, -0.05], abs=2e-3)


def test_a_stuck_ball_is_free_again():
    machine = rig(theta=0.0, faults=[{"kind": "stuck", "at_s": 0.2, "duration_s": 1.0}])
    _, true = drive(machine, 2.0, 0.0, -0.06)
    stuck = true[9:35]
    assert np.ptp(stuck[:, 0]) < 5e-4
    assert np.ptp(stuck[:, 1]) < 5e-4
    assert true[-1, 1] > true[35, 1] + 0.02


def test_blackout_and_dead_axis():
    seen, _ = drive(rig(faults=[{"kind": "blackout", "at_s": 0.5, "duration_s": 0.5}]), 1.5)
    assert [o.x is None for o in seen] == [15 <= k < 30 for k in range(45)]
    machine = rig(faults=[{"kind": "dead_axis", "axis": "gamma", "at_s": 0.0, "duration_s": 1.0}])
    _, true = drive(machine, 2.0, 0.05, 0.05)
    assert true[25, 5] == pytest.approx(0.05, abs=2e-3)
    assert abs(true[25, 6]) < 2e-3
    assert true[-1, 6] == pytest.approx(0.05, abs=2e-3)


def test_a_blocked_opening_opens_again():
    opening = MAZE.opening("1-2@45")
    fault = {"kind": "blocked", "opening": opening.name, "at_s": 0.0, "duration_s": 1.5}
    machine = rig(theta=opening.angle, faults=[fault])
    tilt = (-0.08 * math.cos(opening.angle), 0.08 * math.sin(opening.angle))
    _, true = drive(machine, 1.4, *tilt)
    assert MAZE.ring_at(math.hypot(*true[-1, :2])) == 1
    _, true = drive(machine, 1.0, *tilt)
    assert MAZE.ring_at(math.hypot(*true[-1, :2])) == 2
