"""Pixels in the loop of a simulated rig."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scenes import MAZE

from mazeplan.core.errors import SettingsError
from mazeplan.rigs.registry import make_rig
from mazeplan.rigs.sim.settings import settings_from
from mazeplan.rigs.sim.simulated import SimulatedRig


def rig(seed=0, **settings):
    machine = SimulatedRig(MAZE, settings)
    machine.reset(ring=1, theta=0.7, rng=np.random.default_rng(seed))
    return machine


def test_the_ball_is_found_where_the_late_picture_shows_it():
    machine = rig(sense="camera", camera_delay_frames=2)
    true, seen = [], []
    for _ in range(12):
        seen.append(machine.observe())
        true.append(machine.truth())
        machine.command(0.085, 0.085)
    for before, now in zip(true[:-2], seen[2:], strict=True):
        assert now.x is not None
        assert now.y is not None
        assert math.hypot(now.x - before[0], now.y - before[1]) < 0.0005
    # it moved meanwhile: a picture of now would have been another one
    assert math.hypot(*(true[-1][:2] - true[-3][:2])) > 0.002


def test_errors_of_pixels_take_the_place_of_noise():
    machine = rig(sense="camera", camera_noise_mm=20.0, outlier_probability=1.0, outlier_mm=100.0)
    got = machine.observe()
    true = machine.truth()
    assert got.x is not None
    assert 0.0 < math.hypot(got.x - true[0], (got.y or 0.0) - true[1]) < 0.0005


def test_what_else_is_drawn_stays_the_same():
    plain, pixels = (rig(sense=sense, tilt_noise_deg=0.1, ball_lost_probability=0.3) for sense in ("ideal", "camera"))
    for _ in range(8):
        one, two = plain.observe(), pixels.observe()
        assert (one.beta, one.gamma, one.seen) == (two.beta, two.gamma, two.seen)


def test_a_ball_taken_out_is_not_seen():
    machine = rig(sense="camera", faults=({"kind": "removed", "at_s": 0.05, "duration_s": 10.0},))
    sights = [machine.observe().seen for _ in range(6)]
    assert sights[0]
    assert not any(sights[3:])


def test_sense_is_a_setting_and_an_argument():
    assert make_rig("toy", MAZE).settings.sense == "ideal"  # type: ignore[attr-defined]
    assert make_rig("toy", MAZE, "camera").settings.sense == "camera"  # type: ignore[attr-defined]
    with pytest.raises(SettingsError, match="expected one of ideal, camera"):
        make_rig("toy", MAZE, "eyes")
    with pytest.raises(SettingsError, match="expected a rig whose pictures are simulated"):
        make_rig("planar_rig:PlanarRig", MAZE, "camera")
    with pytest.raises(SettingsError, match="sense"):
        settings_from({"sense": "eyes"})
