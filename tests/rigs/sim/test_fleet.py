"""Many simulated rigs at once are what each of them is alone, and walls near the ball are all that it can touch."""

import math

import mujoco
import numpy as np
import pytest

from mazeplan.core.errors import RigError, SettingsError
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.registry import make_rig
from mazeplan.rigs.sim.fleet import Fleet, fits
from mazeplan.rigs.sim.mjcf import mjcf
from mazeplan.rigs.sim.nearwalls import FREE, near_walls
from mazeplan.rigs.sim.settings import Fault
from mazeplan.rigs.sim.simulated import SimulatedRig

MAZE = load_map("cme")
TOY = make_rig("toy", MAZE).settings  # pyright: ignore[reportAttributeAccessIssue]
ODD = TOY.model_copy(
    update={
        "command_delay_ms": 45.0, "camera_late_ms": 21.0, "backlash_deg": 0.5, "backlash_axis": "gamma",
        "deadband_deg": 0.2, "outlier_probability": 0.1, "camera_rotation_deg": 2.0, "camera_offset_mm": (1.0, 2.0),
        "ball_lost_probability": 0.1, "camera_delay_frames": 3,
    }
)  # fmt: skip
RINGS, THETAS = [1, 3, 4], [0.1, 2.0, -1.0]
ALL = np.arange(3)


def told(sample):
    unseen = math.nan
    return [sample.t, unseen if sample.x is None else sample.x, unseen if sample.y is None else sample.y,
            sample.beta, sample.gamma]  # fmt: skip


def rngs(seed=0):
    return [np.random.default_rng(seed + i) for i in ALL]


@pytest.mark.parametrize(("settings", "steps"), [(TOY, 40), (ODD, 25)])
def test_a_fleet_measures_and_moves_as_its_rigs_do_alone(settings, steps):
    rigs = [SimulatedRig(MAZE, settings) for _ in ALL]
    fleet, drawn, seen = Fleet(MAZE, settings, 3, threads=2), np.random.default_rng(5), 0
    got = fleet.reset(ALL, RINGS, THETAS, rngs())
    for rig, ring, theta, rng in zip(rigs, RINGS, THETAS, rngs(), strict=True):
        rig.reset(ring=ring, theta=theta, rng=rng)
    command = np.zeros((3, 2))
    for step in range(steps):
        alone = np.array([told(rig.observe()) for rig in rigs])
        np.testing.assert_allclose(np.column_stack([got.t, got.x, got.y, got.beta, got.gamma]), alone, atol=1e-14)
        seen += np.isfinite(alone[:, 1]).sum()
        for row, rig in enumerate(rigs):
            positions, velocities = fleet.state(row)
            np.testing.assert_array_equal(positions, rig.machine.data.qpos)  # to the last bit
            np.testing.assert_array_equal(velocities, rig.machine.data.qvel)
            np.testing.assert_allclose(fleet.pictured(row), rig.pictured(), atol=1e-14)
        if step % 4 == 0:
            command = drawn.uniform(-1.0, 1.0, (3, 2)) * MAZE.tilt_limit
        for rig, one in zip(rigs, command, strict=True):
            rig.command(*one)
        got = fleet.step(ALL, command)
    assert seen > 0
    assert settings is TOY or seen < 3 * steps  # some of them were lost, in both alike
    fleet.close()


def test_some_of_a_fleet_go_on_while_others_begin_anew():
    fleet, other = Fleet(MAZE, ODD, 3, threads=1), Fleet(MAZE, ODD, 1, threads=1)
    push = np.full((3, 2), MAZE.tilt_limit)
    fleet.reset(ALL, RINGS, THETAS, rngs())
    for _ in range(5):
        fleet.step(ALL, push)
    before = fleet.state(0)[0]
    again = fleet.reset(ALL[1:2], [2], [0.5], [np.random.default_rng(9)])
    fresh = other.reset(ALL[:1], [2], [0.5], [np.random.default_rng(9)])
    np.testing.assert_array_equal(before, fleet.state(0)[0])
    for _ in range(5):
        np.testing.assert_array_equal([again.x, again.beta], [fresh.x, fresh.beta])  # nothing is left of before
        again, fresh = fleet.step(ALL[1:2], push[:1]), other.step(ALL[:1], push[:1])
    np.testing.assert_array_equal(fleet.state(1)[0], other.state(0)[0])


@pytest.mark.parametrize("rate", [30.0, 10.0])
def test_a_ball_thrown_across_the_maze_meets_the_same_walls(rate):
    settings = TOY.model_copy(update={"rate_hz": rate})
    whole = mujoco.MjModel.from_xml_string(mjcf(MAZE, settings))
    near = near_walls(MAZE, settings)
    one, other = mujoco.MjData(whole), mujoco.MjData(near.any)
    for data in (one, other):
        data.qpos[2:6] = MAZE.track_radius(2), 0.0, MAZE.ball.radius, 1.0
        data.qvel[2:4] = 0.9, 1.2  # m/s: 2.5 mm a step of MuJoCo, 10 a chunk, against FREE
    mujoco.mj_forward(whole, one)
    mujoco.mj_forward(near.at(*other.qpos[2:4]), other)
    touched = 0
    for _ in range(round(40 * rate / 30.0)):
        mujoco.mj_step(whole, one, nstep=4)
        near.step(other, 4)
        np.testing.assert_array_equal(one.qpos, other.qpos)
        touched += one.ncon > 1
    assert touched >= 3
    assert 1.5 * 4.0 * whole.opt.timestep > FREE
    assert near.slots < 0.25 * whole.ngeom


def test_a_fleet_refuses_what_it_cannot_do():
    blocked = TOY.model_copy(update={"faults": (Fault(kind="blocked", at_s=0.0, opening="1-2@45"),)})
    magnet = TOY.model_copy(update={"magnet_m_s2": 0.3})
    seeing = TOY.model_copy(update={"sense": "camera"})
    assert fits(TOY, MAZE)
    assert not any(fits(settings, MAZE) for settings in (blocked, magnet, seeing))
    with pytest.raises(SettingsError, match="faults"):
        Fleet(MAZE, blocked, 1)
    fleet = Fleet(MAZE, TOY, 1)
    with pytest.raises(RigError, match="reset"):
        fleet.step(ALL[:1], np.zeros((1, 2)))
    fleet.reset(ALL[:1], [1], [0.0], [np.random.default_rng(0)])
    for wrong in (np.full((1, 2), math.nan), np.full((1, 2), 2.0 * MAZE.tilt_limit)):
        with pytest.raises(RigError, match="expected at most"):
            fleet.step(ALL[:1], wrong)
