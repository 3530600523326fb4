"""Servos of every kind are known by the first second of their motion, and so are mistakes in the wiring."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from stage_kinds import DEGREE, KINDS, jumps

from mazeplan.control.estimation.fit_watch import LEARNED_OFF, OFF, StageWatch
from mazeplan.core.records import Command, Observation
from mazeplan.physics.rig.stage import StageAxis, StageModel, simulate_axis

PLAIN = {name: replace(axis, gain=1.0, offset=0.0) for name, axis in KINDS.items()}
PLAIN["first order"] = StageAxis(1.0, 9.0, 1.0, 1.0 / 30.0, order=1)  # one of 16 rad/s is much like a textbook servo
RIGHT = np.eye(2)


def watched(axis, *, seed=0, rate_hz=30.0, seconds=1.0, wiring=RIGHT, noise=0.0, off=OFF):
    """What a watch of the textbook stage says of a rig's tilts, and the last stage that a run would adopt."""
    n, rng, said, adopted = round(seconds * rate_hz), np.random.default_rng(seed), list[str](), None
    u = jumps(seed, n, bang=True)
    tilts = np.stack([simulate_axis(axis, u[:, i], 1.0 / rate_hz) for i in (0, 1)], axis=1) @ np.transpose(wiring)
    tilts += noise * rng.standard_normal(tilts.shape)
    watch = StageWatch(StageModel(), rate_hz)
    for k in range(n):
        watch.update(Observation(k / rate_hz, 0.0, 0.0, *map(float, tilts[k])))
        words, stage = watch.judge(off)
        said += [words] if words else []
        if stage is not None:
            adopted = stage
            if math.isfinite(stage.beta.rate_limit):
                break
            watch.adopt(stage)
        elif words:
            break
        watch.sent(Command(*map(float, u[k])))
    return said, adopted


@pytest.mark.parametrize("rate_hz", [30.0, 60.0])
@pytest.mark.parametrize("name", PLAIN)
def test_the_kind_of_a_servo_is_found_within_a_second(name, rate_hz):
    true = PLAIN[name]
    for seed in range(3):
        _, stage = watched(true, seed=seed, rate_hz=rate_hz)
        found = stage.beta
        assert stage.gamma == found
        assert math.isfinite(found.rate_limit) == math.isfinite(true.rate_limit)
        assert found.order == true.order
        assert found.dead_time == pytest.approx(true.dead_time, abs=0.02)
        if true.order:
            assert found.natural_frequency == pytest.approx(true.natural_frequency, rel=0.25)
            assert found.damping == pytest.approx(true.damping, abs=0.2)
        elif math.isfinite(true.rate_limit):
            assert found.rate_limit == pytest.approx(true.rate_limit, rel=0.3)


@pytest.mark.parametrize(
    ("wiring", "named"),
    [
        (np.diag([-1.0, 1.0]), "beta"),
        (np.diag([1.0, -1.0]), "gamma"),
        (np.diag([-1.0, -1.0]), "beta and gamma"),
        (np.array([[0.0, 1.0], [1.0, 0.0]]), "exchanged"),
    ],
)
def test_wrong_signs_and_exchanged_axes_are_named(wiring, named):
    for seed in range(3):
        said, stage = watched(StageAxis(), seed=seed, wiring=wiring)
        assert named in said[-1]
        assert stage is None


@pytest.mark.parametrize("gain", [0.6, 1.5])
def test_another_gain_is_adopted_and_no_other_servo(gain):
    for seed in range(3):
        _, stage = watched(StageAxis(gain), seed=seed, seconds=2.0)
        for axis in (stage.beta, stage.gamma):
            assert axis.gain == pytest.approx(gain, rel=0.1)
            assert axis.lag == pytest.approx(StageAxis().lag, abs=0.02)


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_of_a_healthy_stage_nothing_is_said(noise):
    for seed in range(20):
        assert watched(StageAxis(), seed=seed, seconds=4.0, noise=noise) == ([], None)


def test_a_plate_that_hardly_moves_shows_nothing():
    watch = StageWatch(StageModel(), 30.0)
    for k in range(60):
        watch.update(Observation(k / 30.0, 0.0, 0.0, 0.05 * DEGREE, -0.05 * DEGREE))
        watch.sent(Command(0.3 * DEGREE * math.sin(0.5 * k), 0.3 * DEGREE * math.cos(0.5 * k)))
        assert watch.judge() == ("", None)


def test_a_learned_stage_gets_a_limited_rate_that_explains_all_of_it_only():
    limited, other = replace(StageAxis(), rate_limit=math.radians(50.0)), StageAxis(1.0, 16.0, 1.0)
    for seed in range(5):
        _said, stage = watched(limited, seed=seed, seconds=2.0, off=LEARNED_OFF)
        assert stage.beta.rate_limit == pytest.approx(limited.rate_limit)
        assert watched(limited, seed=seed, seconds=2.0, noise=0.4 * DEGREE, off=LEARNED_OFF)[1] is None
        assert watched(other, seed=seed, seconds=2.0, off=LEARNED_OFF) == ([], None)
