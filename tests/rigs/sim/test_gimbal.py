"""A rig whose model has only the walls near the ball is the rig with all of them, to the last bit."""

import mujoco
import numpy as np
import pytest

from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.registry import make_rig
from mazeplan.rigs.sim.gimbal import Gimbal
from mazeplan.rigs.sim.machine import CHUNKS
from mazeplan.rigs.sim.mjcf import SUBSTEPS, mjcf
from mazeplan.rigs.sim.settings import SimulatedSettings
from mazeplan.rigs.sim.simulated import SimulatedRig

CME = load_map("cme")
TOY = make_rig("toy", CME).settings  # pyright: ignore[reportAttributeAccessIssue]


def whole(maze, settings):
    """The rig with all its walls."""
    model = mujoco.MjModel.from_xml_string(mjcf(maze, settings))
    return SimulatedRig(maze, settings, lambda: Gimbal(model, SUBSTEPS // CHUNKS))


def same_way(maze, settings, ring, theta, commands):
    """Contacts at most, in one of CHUNKS, of both rigs, which must go the same way."""
    rigs, touched = [whole(maze, settings), SimulatedRig(maze, settings)], []
    for rig in rigs:
        rig.reset(ring=ring, theta=theta, rng=np.random.default_rng(3))
    for command in commands:
        one, other = (rig.observe() for rig in rigs)
        assert one == other
        first, second = (rig.machine.gimbal.data for rig in rigs)
        np.testing.assert_array_equal(first.qpos, second.qpos)
        np.testing.assert_array_equal(first.qvel, second.qvel)
        assert first.ncon == second.ncon
        touched.append(second.ncon)
        for rig in rigs:
            rig.command(*command)
    assert rigs[1].machine.gimbal.data.model.ngeom < 0.3 * rigs[0].machine.gimbal.data.model.ngeom
    return max(touched)


def drawn(maze, samples, seed=0):
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-1.0, 1.0, (samples // 5, 2)) * maze.tilt_limit, 5, axis=0)


@pytest.mark.parametrize("ring", [1, 3, 5])
def test_it_goes_the_same_way(ring):
    assert same_way(CME, TOY, ring, 0.4, drawn(CME, 60)) >= 2  # the floor, and a wall


def test_it_goes_the_same_way_among_radial_walls():
    maze = load_map("detour")
    settings = SimulatedSettings(magnet_m_s2=0.5, magnet_mm=(40.0, 20.0), contact_damping_ratio=0.5)
    assert same_way(maze, settings, 2, 1.0, drawn(maze, 60, 1)) >= 2
