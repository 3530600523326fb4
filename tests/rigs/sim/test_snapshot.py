"""What only a simulation can do: come back to a moment, and put the ball where one likes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.sim.simulated import SimulatedRig

MAZE = load_map("cme")


def turning_rig():
    """A rig on its way: the plate turns, the ball rolls and spins at a wall, commands are still on their way."""
    rig = SimulatedRig(MAZE, {"wall_grip": 0.3, "command_delay_ms": 50.0, "backlash_deg": 0.3})
    rig.reset(ring=2, theta=0.4, rng=np.random.default_rng(0))
    for i in range(25):
        rig.observe()
        rig.command(0.07 * math.sin(0.7 * i), 0.07 * math.cos(0.4 * i))
    return rig


def follow(rig, samples):
    out = []
    for i in range(samples):
        rig.observe()
        out.append(rig.truth())
        rig.command(0.06 * math.cos(0.1 * i), -0.06 * math.sin(0.15 * i))
    return np.array(out)


def test_from_a_snapshot_everything_happens_again():
    rig = turning_rig()
    then = rig.snapshot()
    once = follow(rig, 40)
    rig.restore(then)
    assert np.array_equal(follow(rig, 40), once)
    assert np.ptp(once[:, 0]) > 0.02  # and something did happen


def test_commands_on_their_way_belong_to_the_moment():
    rig = turning_rig()
    rig.command(0.08, 0.08)
    then = rig.snapshot()
    once = follow(rig, 10)
    rig.restore(then)
    rig.level()  # drops them
    assert not np.array_equal(follow(rig, 10), once)


def test_the_ball_is_put_while_the_plate_turns():
    rig = turning_rig()
    before = rig.truth()
    assert np.any(np.abs(rig.machine.data.qvel[:2]) > 0.1)
    wanted = (np.array([0.03, -0.06, 0.00635]), np.array([0.1, 0.05, 0.0]), np.array([-7.9, 15.7, 3.0]))
    rig.set_ball(*wanted)
    for got, asked in zip(rig.ball(), wanted, strict=True):
        assert got == pytest.approx(asked, abs=1e-12)
    assert rig.truth()[5:] == pytest.approx(before[5:])  # the plate stays


def test_a_ball_that_rolls_is_said_to_roll():
    """Away from walls, without slipping: velocity = spin x R z, in the frame of the plate also while that turns."""
    rig = SimulatedRig(MAZE, {"rolling_friction_m": 0.0})
    rig.reset(ring=5, theta=0.0, rng=np.random.default_rng(0))
    for _ in range(7):
        rig.observe()
        rig.command(0.03, -0.05)
    _, velocity, spin = rig.ball()
    assert np.hypot(*velocity[:2]) > 0.02
    rolling = MAZE.ball.radius * np.array([spin[1], -spin[0]])
    assert rolling == pytest.approx(velocity[:2], abs=2e-3)
