"""Both axes of a stage together."""

from __future__ import annotations

import math

import numpy as np
import pytest
from stage_kinds import DT, jumps

from mazeplan.learning.stage_fit import fit_axes
from mazeplan.physics.rig.stage import StageAxis, simulate_axis
from mazeplan.run.collect import multisine

N, NOISE, FINE = 3000, 5e-4, 20


def tilts(axis, u, lag_s=0.0):
    """Measured angles: of the axis, through the low pass of a sensor."""
    angle, h = simulate_axis(axis, np.repeat(u, FINE), DT / FINE), DT / FINE
    for i in range(1, len(angle) if lag_s else 0):
        angle[i] = angle[i - 1] + h / lag_s * (angle[i] - angle[i - 1])
    return angle[::FINE]


def fitted(pair, u, lag_s=0.0, share=0.0):
    mixed, noise = u + share * u[:, ::-1], np.random.default_rng(1).normal(0.0, NOISE, (N, 2))
    angles = np.column_stack([tilts(axis, mixed[:, i], lag_s) for i, axis in enumerate(pair)]) + noise
    return fit_axes(u, angles, DT, np.arange(N) == 0)


def test_each_axis_has_its_share_of_the_other_command():
    pair = StageAxis(0.95, 31.0, 1.0, 0.025, order=1), StageAxis(1.05, 31.0, 1.0, 0.025, order=1)
    for fit, true in zip(fitted(pair, jumps(1, N), share=0.03), pair, strict=True):
        assert fit.axis.coupling == pytest.approx(0.03, abs=3e-3)
        assert fit.axis.natural_frequency == pytest.approx(31.0, rel=0.05)
        assert fit.axis.gain == pytest.approx(true.gain, abs=5e-3)
        assert fit.times_noise < 1.1


def test_servos_of_one_kind_are_of_one_order_though_one_has_play():
    """With play and a slow sensor, a late first-order axis fits as well, unless one looks at the other axis."""
    plain = StageAxis(1.0, 22.0, 0.7)
    loose = StageAxis(1.0, 22.0, 0.7, backlash=0.0044, behind=True)
    u = multisine(np.random.default_rng(1), N * DT + 1.0, 1.0 / DT, math.radians(5.0))[:N]
    beta, gamma = fitted((plain, loose), u, lag_s=0.025)
    assert beta.axis.order == gamma.axis.order == 2
    assert gamma.axis.natural_frequency == pytest.approx(beta.axis.natural_frequency, rel=0.05)
    assert gamma.axis.backlash == pytest.approx(0.0044, rel=0.15)


def test_servos_that_surely_differ_keep_their_own_order():
    beta, gamma = fitted((StageAxis(1.0, 12.0, 0.3), StageAxis(1.0, 12.0, 1.0, order=1)), jumps(3, N))
    assert (beta.axis.order, gamma.axis.order) == (2, 1)
