"""The fit of the stage."""

from __future__ import annotations

import numpy as np
import pytest

from mazeplan.learning.stage_fit import fit_axis
from mazeplan.physics.rig.stage import StageAxis
from mazeplan.physics.rig.stage_simulation import simulate_axis
from mazeplan.run.excitation import multisine

DT = 1.0 / 30.0


NOISE = 9e-4  # rad, 0.05 deg
AXES = {
    "underdamped": StageAxis(0.97, 23.0, 0.85, 0.021, 0.003),
    "overdamped": StageAxis(1.05, 18.0, 1.5, 0.05, -0.004),
    "without dead time": StageAxis(1.0, 20.0, 0.7, 0.0, 0.0),
}
CLOSE = {"gain": 5e-3, "natural_frequency": 2.5, "damping": 0.12, "dead_time": 6e-3, "offset": 2e-4}


@pytest.mark.parametrize("name", AXES)
def test_fit_finds_the_axis_through_noise(name):
    true, rng = AXES[name], np.random.default_rng(0)
    u = multisine(rng, 130.0, 30.0, 0.087)[:, 0]
    fit = fit_axis(u, simulate_axis(true, u, DT) + NOISE * rng.standard_normal(len(u)), DT)
    for parameter, close in CLOSE.items():
        error = abs(getattr(fit.axis, parameter) - getattr(true, parameter))
        assert error < 4.0 * fit.axis.stderr[parameter], parameter
        assert error < close, parameter
        assert fit.axis.stderr[parameter] < close, parameter
    assert fit.rms == pytest.approx(NOISE, rel=0.05)
    assert fit.samples == len(u) - 15  # the first half second is left out


HARD = {
    "slow and late": StageAxis(1.0, 4.0, 0.7, 0.15, 0.002),
    "slow, late, overdamped": StageAxis(1.3, 4.0, 2.0, 0.15, 0.003),
    "ringing and late": StageAxis(0.5, 8.0, 0.2, 0.2, 0.0),
}


@pytest.mark.parametrize("name", HARD)
def test_hard_axes_are_found_as_easy_ones_are(name):
    true, rng = HARD[name], np.random.default_rng(1)
    u = multisine(rng, 100.0, 30.0, 0.087)[:, 0]
    angle = simulate_axis(true, u, DT) + NOISE * rng.standard_normal(len(u))
    textbook = float(np.std(simulate_axis(StageAxis(1.0, 20.0, 0.9, 0.1), u, DT) - angle))
    assert textbook > 6.0 * NOISE  # a search that started there would have far to go
    fit = fit_axis(u, angle, DT)
    assert fit.rms == pytest.approx(NOISE, rel=0.05)
    for parameter in CLOSE:
        error = abs(getattr(fit.axis, parameter) - getattr(true, parameter))
        assert error < 4.0 * fit.axis.stderr[parameter], parameter


def test_a_slow_axis_that_starts_elsewhere_is_waited_for():
    """Level at first, where the command is not: that takes longer to die away than half a second."""
    true = StageAxis(1.0, 4.0, 1.5, 0.1)
    u = multisine(np.random.default_rng(3), 60.0, 30.0, 0.087)[:, 0]
    u[:2] = 0.0  # simulated from level ...
    angle = simulate_axis(true, u, DT)
    fit = fit_axis(u[5:], angle[5:], DT)  # ... and logged from a moment when it moves
    assert fit.samples < len(u) - 5 - 30
    assert fit.axis.natural_frequency == pytest.approx(4.0, abs=0.02)
    assert fit.axis.dead_time == pytest.approx(0.1, abs=2e-3)


def test_what_the_record_does_not_tell_has_a_large_standard_error():
    """A pole at 224 rad/s behind one of 16 rad/s and a dead time, commands of 1.5 Hz."""
    rng = np.random.default_rng(1)
    u = multisine(rng, 60.0, 30.0, 0.087)[:, 0]
    angle = simulate_axis(StageAxis(0.8, 60.0, 2.0, 0.2), u, DT) + NOISE * rng.standard_normal(len(u))
    axis = fit_axis(u, angle, DT).axis
    assert axis.stderr["natural_frequency"] > 5.0
    assert axis.stderr["gain"] < 0.01


def test_standard_errors_are_the_scatter_of_repeated_fits():
    true, rng = AXES["underdamped"], np.random.default_rng(5)
    scores = []
    for _ in range(8):
        u = multisine(rng, 40.0, 30.0, 0.087)[:, 0]
        axis = fit_axis(u, simulate_axis(true, u, DT) + NOISE * rng.standard_normal(len(u)), DT).axis
        scores.append([(getattr(axis, p) - getattr(true, p)) / axis.stderr[p] for p in ("gain", "damping", "offset")])
    assert 0.5 < np.std(scores) < 1.7


def test_fit_respects_breaks_and_says_what_is_missing():
    axis, t = StageAxis(), np.arange(900) * DT
    u = 0.05 * np.sin(4.0 * t)
    angle = np.concatenate([simulate_axis(axis, u[:450], DT), simulate_axis(axis, u[450:], DT)])
    breaks = np.zeros(900, dtype=bool)
    breaks[[0, 450]] = True
    assert fit_axis(u, angle, DT, breaks).rms < 1e-6
    with pytest.raises(ValueError, match="got 30 samples"):
        fit_axis(u[:30], angle[:30], DT)
    with pytest.raises(ValueError, match="0 rad"):
        fit_axis(np.zeros(900), angle, DT)


def test_an_axis_beyond_the_grid_is_found():
    """Faster than any pole of the grid, ringing, and late; a fit from too slow a start ends at another minimum."""
    true, rng = StageAxis(1.4, 110.0, 0.36, 0.1), np.random.default_rng(7)
    u = multisine(rng, 60.0, 30.0, 0.087)[:, 0]
    fit = fit_axis(u, simulate_axis(true, u, DT) + 1e-5 * rng.standard_normal(len(u)), DT)
    assert fit.rms == pytest.approx(1e-5, rel=0.1)
    assert fit.axis.dead_time == pytest.approx(0.1, abs=1e-3)
