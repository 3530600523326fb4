"""A delay that nobody identified is found out while the ball rolls."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from strange_rigs import StrangeRig

from mazeplan.control.estimation.delay_bank import DelayBank, estimator_for
from mazeplan.control.estimation.estimator import Estimator
from mazeplan.core.records import Command
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.sim.simulated import SimulatedRig
from mazeplan.run.resolve import resolve_model

MAZE = load_map("cme")
NOMINAL = RigModel.nominal(MAZE)


def simulated(**settings):
    return SimulatedRig(MAZE, {"wall_grip": 0.3, "rolling_friction_m": 5e-5, **settings})


def driven(bank, rig, seconds=3.0):
    """Delays believed, one a sample, while the plate of a rig is swayed."""
    rig.reset(ring=1, theta=0.4, rng=np.random.default_rng(1))
    believed = []
    for i in range(round(30 * seconds)):
        seen = rig.observe()
        bank.update(seen)
        u = Command(0.08 * math.sin(0.35 * i), 0.08 * math.cos(0.27 * i))
        rig.command(u.u_beta, u.u_gamma)
        bank.sent(u, seen.t)
        believed.append(bank.current.camera_delay)
    return np.array(believed)


@pytest.mark.parametrize("frames", [0, 1, 2, 3])
def test_the_delay_is_found_and_kept(frames):
    believed = driven(DelayBank(MAZE, NOMINAL), simulated(camera_delay_frames=frames, camera_noise_mm=0.5))
    assert np.abs(believed[45:] * 30.0 - frames).max() <= 1.0
    assert np.ptp(believed[60:]) <= 1.0 / 30.0 + 1e-9


@pytest.mark.parametrize("late_ms", [0.0, 33.0, 67.0])
def test_a_picture_may_be_earlier_than_the_tilt(late_ms):
    axes = {name: replace(getattr(NOMINAL.stage, name), dead_time=1e-3 * late_ms) for name in ("beta", "gamma")}
    bank = DelayBank(MAZE, replace(NOMINAL, stage=replace(NOMINAL.stage, **axes)))
    believed = driven(bank, StrangeRig(MAZE, {"tilt_late_ms": late_ms}))
    assert np.abs(believed[45:] + 1e-3 * late_ms).max() <= 1.0 / 30.0
    assert believed.min() >= -1e-3 * late_ms


def test_while_the_ball_stands_nothing_is_concluded():
    rig = SimulatedRig(MAZE, {"camera_delay_frames": 3, "camera_noise_mm": 1.0})
    rig.reset(ring=2, theta=0.0, rng=np.random.default_rng(2))
    bank = DelayBank(MAZE, NOMINAL)
    for _ in range(60):
        bank.update(rig.observe())
        rig.command(0.0, 0.0)
    assert bank.current.camera_delay == 0.0


def test_it_speaks_as_the_estimator_it_believes():
    bank, alone = DelayBank(MAZE, NOMINAL), Estimator(MAZE, NOMINAL)
    rig = SimulatedRig(MAZE, {})
    rig.reset(ring=1, theta=0.4, rng=np.random.default_rng(1))
    for i in range(20):
        seen = rig.observe()
        assert bank.update(seen) == alone.update(seen)
        assert bank.filtered == alone.filtered
        assert bank.current.innovation == alone.innovation
        u = Command(0.05 * math.sin(0.2 * i), 0.0)
        for one in (rig.command, lambda a, b, s=seen: [e.sent(Command(a, b), s.t) for e in (bank, alone)]):
            one(u.u_beta, u.u_gamma)
        assert bank.ahead(0.1) == alone.ahead(0.1)


def test_who_has_a_model_keeps_its_delay():
    assert isinstance(estimator_for(MAZE, NOMINAL), DelayBank)
    assert isinstance(estimator_for(MAZE, resolve_model("ideal", None, MAZE)), Estimator)
    assert isinstance(estimator_for(MAZE, resolve_model("toy", None, MAZE)), Estimator)
