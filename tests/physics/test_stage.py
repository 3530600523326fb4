"""The stage: its step response and its simulation."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import TransferFunction
from scipy.signal import step as unit_step

from mazeplan.physics.rig.stage import StageAxis, simulate_axis, step_response
from mazeplan.run.collect import multisine

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


@pytest.mark.parametrize("damping", [0.05, 0.7, 1.0 - 1e-8, 1.0, 1.0 + 1e-8, 1.6, 10.0])
def test_step_response_against_the_transfer_function(damping):
    w, t = 17.0, np.linspace(0.0, 1.5, 151)
    # poles apart by a rounding error are no use to scipy; the response is continuous in the damping
    z = 1.0 + 1e-6 if abs(damping - 1.0) < 1e-6 else damping
    _, expected = unit_step(TransferFunction([w * w], [1.0, 2.0 * z * w, w * w]), T=t)
    np.testing.assert_allclose(step_response(StageAxis(1.0, w, damping), t), expected, atol=2e-6)


def test_simulation_starts_at_rest_and_is_linear_in_the_command():
    axis = StageAxis(0.9, 25.0, 0.7, 0.02, 0.005)
    held = simulate_axis(axis, np.full(90, 0.04), DT)
    assert held == pytest.approx(np.full(90, 0.9 * 0.04 + 0.005), abs=1e-12)
    assert len(simulate_axis(axis, np.full(3, 0.04), DT)) == 3  # shorter than the response
    u = multisine(np.random.default_rng(1), 10.0, 30.0, 0.08)
    both = simulate_axis(axis, u[:, 0] + 2.0 * u[:, 1], DT) - axis.offset
    apart = simulate_axis(axis, u[:, 0], DT) + 2.0 * simulate_axis(axis, u[:, 1], DT) - 3.0 * axis.offset
    np.testing.assert_allclose(both, apart, atol=1e-12)


def test_poles():
    a, b = StageAxis(damping=0.5, natural_frequency=10.0).poles()
    assert a == pytest.approx(complex(-5.0, 8.660254))
    assert b == pytest.approx(a.conjugate())
    slow, fast = StageAxis(damping=2.0, natural_frequency=10.0).poles()
    assert slow + fast == pytest.approx(-40.0)
    assert slow * fast == pytest.approx(100.0)
    assert slow.imag == fast.imag == 0.0


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("gain", 0.05, 20.0),
        ("natural_frequency", 0.5, 500.0),
        ("damping", 0.02, 20.0),
        ("dead_time", 0.0, 1.0),
        ("offset", -0.5, 0.5),
    ],
)
def test_each_parameter_of_an_axis_has_a_range(name, low, high):
    for value in (low, high):
        assert getattr(StageAxis(**{name: value}), name) == value
    for value in (low - 1e-6, high + 1e-6, float("nan"), float("inf")):
        with pytest.raises(ValueError, match=f"^{name}: got .*, expected {low} to {high}( rad| s| rad/s)?$"):
            StageAxis(**{name: value})
