"""Play between servo and plate, from commands and tilt."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from contactrig import Axis, Rig, record
from plant import commands

from mazeplan.core.logs.table import Table
from mazeplan.diagnosis.record import record_of
from mazeplan.learning.stage_fit import fit_axis
from mazeplan.physics.rig.stage import StageAxis

DT = 1.0 / 30.0


def plate(u, play, rng):
    """Tilt (N,) of a servo with play, in small steps, and noise of 0.05 deg."""
    out, at, angle, rate, h = np.empty(len(u)), 0.0, 0.0, 0.0, DT / 20
    for k, value in enumerate(u):
        out[k] = angle
        at = at + max(value - 0.5 * play - at, 0.0) - max(at - value - 0.5 * play, 0.0)
        for _ in range(20):
            rate += h * (400.0 * (at - angle) - 36.0 * rate)
            angle += h * rate
    return out + math.radians(0.05) * rng.standard_normal(len(u))


@pytest.mark.slow
@pytest.mark.parametrize("play", [0.0, 0.006, 0.0175])
def test_play_is_found_to_within_its_error(play):
    rng = np.random.default_rng(3)
    u = commands(rng, 1200)[:, 0]
    found = fit_axis(u, plate(u, play, rng), DT, kind=StageAxis()).axis
    if not play:
        assert found.backlash == 0.0
        return
    assert found.backlash == pytest.approx(play, abs=max(5.0 * found.stderr["backlash"], 3e-4))
    assert found.gain == pytest.approx(1.0, abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("band", [0.0, 0.004, 0.01])
def test_a_dead_band_is_found_and_is_no_play(band):
    rng = np.random.default_rng(4)
    u = commands(rng, 1200)[:, 0]
    at, kept = u[0], np.empty(1200)
    for k, value in enumerate(u):
        at = value if abs(value - at) >= band else at
        kept[k] = at
    angle = plate(kept, 0.0, rng)
    found = fit_axis(u, angle, DT, kind=StageAxis()).axis
    assert found.backlash == 0.0
    assert found.deadband == pytest.approx(band, rel=0.05, abs=1e-9)


@pytest.mark.slow
def test_play_is_no_dead_band():
    rng = np.random.default_rng(5)
    u = commands(rng, 1200)[:, 0]
    angle = plate(u, 0.0175, rng)
    found = fit_axis(u, angle, DT, kind=StageAxis()).axis
    assert found.deadband == 0.0
    assert found.backlash > 0.015


@pytest.mark.slow
def test_a_dead_band_of_another_rigs_servo_is_not_called_play():
    axis = Axis(deadband=math.radians(0.6))
    table = Table(record(replace(Rig(), beta=axis), 200.0, 2))
    rows = np.ones(len(table), dtype=bool)
    seen = record_of(table, rows)
    found = fit_axis(seen.u[:, 0], seen.beta, seen.dt, seen.begins.astype(float), kind=StageAxis()).axis
    assert found.backlash == 0.0
    assert found.deadband == pytest.approx(axis.deadband, rel=0.02)
