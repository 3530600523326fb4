"""The fit of the stage."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from stage_kinds import DEGREE, DT, KINDS, jumps

from mazeplan.learning.axis_record import LIMITS, MIN_NOISE, STEADY_S
from mazeplan.learning.stage_fit import fit_axis
from mazeplan.physics.rig.stage import StageAxis, actuator_output, simulate_axis
from mazeplan.run.collect import multisine

NOISE = 9e-4  # rad, 0.05 deg
AXES = {
    "underdamped": StageAxis(0.97, 23.0, 0.85, 0.021, 0.003),
    "overdamped": StageAxis(1.05, 18.0, 1.5, 0.05, -0.004),
    "without dead time": StageAxis(1.0, 20.0, 0.7, 0.0, 0.0),
}
CLOSE = {"gain": 5e-3, "natural_frequency": 2.5, "damping": 0.12, "dead_time": 6e-3, "offset": 2e-4}


@pytest.mark.parametrize("name", AXES)
def test_fit_finds_the_axis_through_noise(name):
    """Commands that jump: slow ones do not tell the second order from the first with a longer dead time."""
    true, rng = AXES[name], np.random.default_rng(0)
    u = jumps(0, 3900)[:, 0]
    fit = fit_axis(u, simulate_axis(true, u, DT) + NOISE * rng.standard_normal(len(u)), DT)
    for parameter, close in CLOSE.items():
        error = abs(getattr(fit.axis, parameter) - getattr(true, parameter))
        assert error < 4.0 * fit.axis.stderr[parameter], parameter
        assert error < close, parameter
        assert fit.axis.stderr[parameter] < close, parameter
    assert fit.rms == pytest.approx(NOISE, rel=0.05)
    assert fit.samples == len(u) - 15  # the first half second is left out


@pytest.mark.parametrize("seed", range(4))
def test_a_doubtful_dead_time_is_none(seed):
    """Pictures at 15 Hz: a faster lag that starts later moves nearly alike."""
    true, rng = StageAxis(1.0, 31.4, 1.0, order=1), np.random.default_rng(seed)
    u = multisine(rng, 80.0, 15.0, 0.087)[:, 0]
    axis = fit_axis(u, simulate_axis(true, u, 1.0 / 15.0) + 5e-4 * rng.standard_normal(len(u)), 1.0 / 15.0).axis
    assert (axis.order, axis.dead_time) == (1, 0.0)
    assert axis.natural_frequency == pytest.approx(31.4, rel=0.03)
    assert 0.0 < axis.stderr["dead_time"] < 0.03


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


def test_a_pole_that_the_record_does_not_tell_is_left_out():
    """A pole at 224 rad/s behind one of 16 rad/s and a dead time, commands of 1.5 Hz."""
    true, rng = StageAxis(0.8, 60.0, 2.0, 0.2), np.random.default_rng(1)
    u = multisine(rng, 60.0, 30.0, 0.087)[:, 0]
    axis = fit_axis(u, simulate_axis(true, u, DT) + NOISE * rng.standard_normal(len(u)), DT).axis
    assert axis.order == 1
    seen = {"natural_frequency": true.slowest(), "dead_time": true.dead_time + 1.0 / 224.0, "gain": true.gain}
    for parameter, value in seen.items():
        assert abs(getattr(axis, parameter) - value) < 4.0 * axis.stderr[parameter], parameter


@pytest.mark.parametrize("seed", [1, 6, 7, 17])
def test_an_axis_that_follows_at_once_is_not_taken_for_a_fast_lag(seed):
    """Samples show only between which two of them it jumps: no lag that begins with the first of these is known."""
    true, rng = StageAxis.prompt(dead_time=0.06), np.random.default_rng(seed)
    u = multisine(rng, 60.0, 30.0, 0.087)[:, 0]
    axis = fit_axis(u, simulate_axis(true, u, DT) + NOISE * rng.standard_normal(len(u)), DT).axis
    assert axis.order == 0
    assert abs(axis.dead_time - true.dead_time) < 4.0 * axis.stderr["dead_time"]


def test_standard_errors_are_the_scatter_of_repeated_fits():
    true, rng = AXES["underdamped"], np.random.default_rng(5)
    scores = []
    for seed in range(8):
        u = jumps(seed, 1200)[:, 0]
        axis = fit_axis(u, simulate_axis(true, u, DT) + NOISE * rng.standard_normal(len(u)), DT).axis
        scores.append([(getattr(axis, p) - getattr(true, p)) / axis.stderr[p] for p in ("gain", "damping", "offset")])
    assert 0.5 < np.std(scores) < 1.7


def test_fit_respects_breaks_and_says_what_is_missing():
    axis, u = StageAxis(), jumps(2, 900)[:, 0]
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
    u = jumps(7, 1800)[:, 0]
    fit = fit_axis(u, simulate_axis(true, u, DT) + 1e-5 * rng.standard_normal(len(u)), DT)
    assert fit.rms == pytest.approx(1e-5, rel=0.1)
    assert fit.axis.dead_time == pytest.approx(0.1, abs=1e-3)


PLAY = replace(KINDS["first order"], backlash=0.15 * DEGREE)
BEHIND = replace(KINDS["springy"], backlash=0.3 * DEGREE, behind=True)
BOTH = replace(KINDS["first order"], backlash=0.3 * DEGREE, behind=True, rate_limit=0.4)
TOLD = {  # and its resolution
    **{name: (axis, 0.0) for name, axis in KINDS.items()}, "backlash": (PLAY, 0.1 * DEGREE),
    "gears behind the lag": (BEHIND, 0.0), "limited rate and gears": (BOTH, 0.0),
}  # fmt: skip


@pytest.mark.parametrize("noise", [0.0, NOISE])
@pytest.mark.parametrize("name", TOLD)
def test_the_kind_of_an_axis_is_found_with_its_numbers(name, noise):
    (true, step), rng = TOLD[name], np.random.default_rng(3)
    u = jumps(3, 2400)[:, 0]
    tilt = simulate_axis(true, actuator_output(u, true), DT) + noise * rng.standard_normal(len(u))
    fit = fit_axis(u, np.round(tilt / step) * step if step else tilt, DT)
    axis = fit.axis
    assert axis.order == true.order
    assert math.isfinite(axis.rate_limit) == math.isfinite(true.rate_limit)
    assert (axis.backlash > 0.0, axis.behind, axis.resolution) == (true.backlash > 0.0, true.behind, 0.0)
    for parameter, stderr in axis.stderr.items():
        value, (low, high) = getattr(axis, parameter), LIMITS[parameter]
        assert abs(value - getattr(true, parameter)) < 4.0 * stderr, parameter
        assert low < value < high, parameter
    assert fit.times_noise < 1.1
    # with more unknowns than gain and offset, they are less certain than these
    floor = max(MIN_NOISE, step / math.sqrt(12.0)) * math.sqrt(STEADY_S / DT / fit.samples)
    assert axis.stderr["gain"] > 0.9 * floor / np.std(u)
    assert axis.stderr["offset"] > 0.99 * floor
