"""The stage: its step response, its simulation, and its fit."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mazeplan.models.stage import StageAxis, fit_axis, simulate_axis, step_response

DT = 1.0 / 30.0


def integrated(axis, u, t_end):
    """Angle at multiples of DT, by an adaptive integrator piece by piece."""
    out, state = [], np.array([axis.gain * u[0] + axis.offset, 0.0])
    moments = [k * DT + late for k in range(len(u)) for late in (0.0, axis.dead_time)]
    edges = sorted({round(moment, 9) for moment in moments})
    edges = [e for e in edges if e <= t_end + 1e-8]
    out.append(state[0])
    for a, b in pairwise(edges):
        k = int(np.floor((a - axis.dead_time) / DT + 1e-6))
        command = u[max(k, 0)] if k >= 0 else u[0]
        w, z, target = axis.natural_frequency, axis.damping, axis.gain * command + axis.offset
        solution = solve_ivp(
            lambda _, x, w=w, z=z, target=target: [x[1], w * w * (target - x[0]) - 2 * z * w * x[1]],
            (a, b), state, rtol=1e-10, atol=1e-12,
        )  # fmt: skip
        state = solution.y[:, -1]
        if abs(b / DT - round(b / DT)) < 1e-6:
            out.append(state[0])
    return np.array(out)


@pytest.mark.parametrize("damping", [0.4, 0.9, 1.0, 1.7])
@pytest.mark.parametrize("dead_time", [0.0, 0.013, DT, 0.08])
def test_simulation_against_an_integrator(damping, dead_time):
    axis = StageAxis(1.1, 20.0, damping, dead_time, 0.004)
    u = 0.05 * np.sign(np.sin(1.1 * np.arange(40))) + 0.01
    n = 30
    assert np.allclose(simulate_axis(axis, u, DT)[:n], integrated(axis, u, (n - 1) * DT)[:n], atol=2e-6)


def test_step_response_starts_at_rest_and_ends_at_one():
    axis = StageAxis(damping=0.8)
    t = np.array([-0.1, 0.0, 1e-6, 2.0])
    assert step_response(axis, t) == pytest.approx([0.0, 0.0, 0.0, 1.0], abs=1e-6)


def test_fit_finds_the_axis_through_noise():
    rng = np.random.default_rng(0)
    t = np.arange(4000) * DT
    waves = [np.sin(f * t + p) for f, p in rng.uniform((0.3, 0.0), (9.0, 6.0), (12, 2))]
    u = np.clip(0.02 * np.sum(waves, axis=0), -0.087, 0.087)
    true = StageAxis(0.97, 23.0, 0.85, 0.021, 0.003)
    fit = fit_axis(u, simulate_axis(true, u, DT) + 9e-4 * rng.standard_normal(len(t)), DT)
    for name in ("gain", "natural_frequency", "damping", "dead_time", "offset"):
        error = abs(getattr(fit.axis, name) - getattr(true, name))
        assert error < 4.0 * fit.axis.stderr[name], name
    assert fit.axis.dead_time == pytest.approx(0.021, abs=5e-3)
    assert fit.axis.gain == pytest.approx(0.97, abs=5e-3)
    assert fit.rms == pytest.approx(9e-4, rel=0.05)


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


def test_poles_and_ranges():
    a, b = StageAxis(damping=0.5, natural_frequency=10.0).poles()
    assert a == pytest.approx(complex(-5.0, 8.660254))
    assert b == pytest.approx(a.conjugate())
    assert all(pole.imag == 0.0 and pole.real < 0.0 for pole in StageAxis(damping=2.0).poles())
    with pytest.raises(ValueError, match="damping"):
        StageAxis(damping=float("nan"))
