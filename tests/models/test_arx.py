"""Stage identification by ARX: on axes that are known, through sensor noise."""

from __future__ import annotations

import cmath
import json
import math
from dataclasses import replace

import numpy as np
import pytest

from mazeplan.data.excitation import multisine
from mazeplan.models import arx as arx_module
from mazeplan.models.arx import fit_arx, fit_arx_alone, mean_lag, second_order
from mazeplan.models.output_error import (
    Stretch,
    jacobian,
    kept,
    least_squares_arx,
    refine,
    regressors,
    simulate,
    stable,
    z_poles,
)
from mazeplan.models.stage import StageAxis, axis_from_arx, fit_axis, simulate_axis, step_response

DT = 1.0 / 30.0
NOISE = 8e-4  # rad, of the tilt sensor
PARAMETERS = ("gain", "natural_frequency", "damping", "dead_time")
BETA, GAMMA = StageAxis(0.97, 20.0, 0.8, 0.03, 0.004), StageAxis(1.05, 9.0, 0.6, 0.075, -0.002)


def record(seconds=200.0, seed=0, noise=NOISE, beta=BETA, gamma=GAMMA, cross=0.0):
    """Commands (N, 2), and angles (N, 2) of both axes, gamma's with `cross` times what beta does."""
    rng = np.random.default_rng(seed)
    u = multisine(rng, seconds, 30.0, 0.087)
    y = np.stack([simulate_axis(axis, u[:, i], DT) for i, axis in enumerate((beta, gamma))], axis=1)
    y[:, 1] += cross * (y[:, 0] - beta.offset)
    return u, y + noise * rng.standard_normal(y.shape)


@pytest.fixture(scope="module")
def coupled():
    u, y = record(cross=0.03)
    return u, y, fit_arx(u, y, DT)


def test_poles_come_back_through_noise_and_plain_arx_does_not_bring_them(coupled):
    u, y, fit = coupled
    for true, axis, angle, command in ((BETA, fit.beta, y[:, 0], u[:, 0]), (GAMMA, fit.gamma, y[:, 1], u[:, 1])):
        assert axis.order == 2
        for name, close in (("gain", 0.005), ("natural_frequency", 3.0), ("damping", 0.05), ("dead_time", 0.02)):
            value, error = getattr(axis, name)
            assert abs(value - getattr(true, name)) < min(4.0 * error, close), name
        refined = max(abs(found - pole) for found, pole in zip(axis.poles, true.poles(), strict=True))
        every = np.arange(len(angle))
        (stretch,) = [Stretch(command, angle, np.zeros((0, len(every))), every < 0, every)]
        plain = [cmath.log(z) / DT for z in z_poles(least_squares_arx([stretch], 2, axis.delay)[:2])]
        assert refined < 0.4 * max(abs(found - pole) for found, pole in zip(plain, true.poles(), strict=True))


def test_coupling_is_found_where_it_is_and_nowhere_else(coupled):
    fit = coupled[2]
    assert fit.gamma.coupled
    value, error = fit.gamma.cross_gain
    assert abs(value - 0.03) < 4.0 * error
    assert error < 0.002
    assert not fit.beta.coupled
    assert abs(fit.beta.cross_gain[0]) < 0.003


def test_one_command_for_both_axes_tells_nothing_of_coupling():
    u, y = record(60.0, 3)
    u[:, 0] = u[:, 1]
    y[:, 0] = y[:, 1]
    fit = fit_arx(u, y, DT)
    assert len(fit.beta.c) == len(fit.gamma.c) == 0
    assert fit.document()["beta"]["cross_gain"] is None
    assert "coupled" not in fit.lines()[0]
    assert not fit.beta.coupled


def test_both_identifications_agree_within_errors(coupled):
    u, y, fit = coupled
    for i, (found, cross) in enumerate(((fit.beta, 0.0), (fit.gamma, 0.03))):
        own = y[:, i] - cross * (y[:, 0] - BETA.offset)
        axis = fit_axis(u[:, i], own, DT).axis
        for name in PARAMETERS:
            value, error = getattr(found, name)
            assert abs(value - getattr(axis, name)) < 3.0 * math.hypot(error, axis.stderr[name]), name
        start = axis_from_arx(found)
        assert start.natural_frequency == found.natural_frequency[0]
        spread = np.std(simulate_axis(start, u[:, i], DT) - simulate_axis(axis, u[:, i], DT))
        assert spread < 0.3 * NOISE


def test_fits_in_percent_are_of_what_was_held_out(coupled):
    _, y, fit = coupled
    for i, axis in enumerate((fit.beta, fit.gamma)):
        best = 100.0 * (1.0 - NOISE / y[:, i].std())
        assert axis.simulation == pytest.approx(best, abs=0.5)
        assert axis.one_step < axis.simulation + 0.2
        assert axis.simulation_plain < axis.simulation
        assert axis.rms == pytest.approx(NOISE, rel=0.1)
        assert axis.samples == pytest.approx(0.8 * len(y), abs=40)


def test_held_out_blocks_take_no_part():
    """What is false in the blocks that are held out changes the scores and nothing else."""
    u, y = record(60.0, 2)
    wrong = y.copy()
    length = min(round(arx_module.BLOCK_S / DT), len(y) // (4 * arx_module.HELD_OUT))
    held_out = (np.arange(len(y)) // length) % arx_module.HELD_OUT == arx_module.HELD_OUT - 1
    wrong[held_out] += 0.05 * np.sin(np.arange(len(y)))[held_out, None]
    one, other = (fit_arx_alone(u[:, 0], angle[:, 0], DT, orders=(2,)) for angle in (y, wrong))
    assert other.delay == one.delay
    assert abs(other.gain[0] - one.gain[0]) < 0.05 * one.gain[1]
    assert abs(other.natural_frequency[0] - one.natural_frequency[0]) < 0.2 * one.natural_frequency[1]
    assert other.simulation < one.simulation - 20.0


@pytest.mark.parametrize("dead_time", [0.0, 0.05, 0.15])
def test_dead_time_is_chosen_from_the_data(dead_time):
    u, y = record(120.0, 5, beta=StageAxis(1.0, 12.0, 0.7, dead_time))
    found = fit_arx_alone(u[:, 0], y[:, 0], DT)
    value, error = found.dead_time
    assert abs(value - dead_time) < 4.0 * error
    assert error < 0.02
    assert found.delay * DT < dead_time + 1.5 * DT


def test_order_three_is_chosen_where_there_are_three_poles():
    """A lag of 3 rad/s behind a servo that rings."""
    u, y = record(200.0, 7, noise=0.0, beta=StageAxis(1.0, 8.0, 0.2))
    lag = math.exp(-3.0 * DT)
    late = np.zeros(len(u))
    for k in range(1, len(u)):
        late[k] = lag * late[k - 1] + (1.0 - lag) * y[k - 1, 0]
    late += 3e-4 * np.random.default_rng(0).standard_normal(len(u))
    found = fit_arx_alone(u[:, 0], late, DT)
    assert found.order == 3
    poles = [pole for pole in found.poles if pole is not None]
    assert min(poles, key=lambda pole: abs(pole.imag)) == pytest.approx(-3.0, abs=0.1)
    assert max(pole.imag for pole in poles) == pytest.approx(8.0 * math.sqrt(1.0 - 0.04), abs=0.1)


def test_errors_that_last_do_not_buy_poles():
    """Errors with a memory of a second: BIC that took them for white would buy a third pole, at 1 rad/s."""
    u, y = record(200.0, 2)
    rng, memory = np.random.default_rng(2), 0.97
    lasting = np.zeros(len(u))
    kick = 2e-3 * math.sqrt(1.0 - memory**2) * rng.standard_normal(len(u))
    for k in range(1, len(u)):
        lasting[k] = memory * lasting[k - 1] + kick[k]
    found = fit_arx_alone(u[:, 0], y[:, 0] + lasting, DT)
    assert found.order <= 2
    assert all(pole is not None and pole.real < -5.0 for pole in found.poles)


def test_segments_start_afresh_and_missing_rows_break():
    u, y = record(120.0, 4)
    segment = (np.arange(len(u)) >= 1700).astype(float)
    u[1700:], y[1700:] = record((len(u) - 1700) / 30.0, 9)
    y[900:905, 0], u[2500, 1] = np.nan, np.nan
    fit = fit_arx(u, y, DT, segment)
    for true, axis in ((BETA, fit.beta), (GAMMA, fit.gamma)):
        assert axis.rms == pytest.approx(NOISE, rel=0.12)
        assert abs(axis.dead_time[0] - true.dead_time) < 4.0 * axis.dead_time[1]
    stretches = arx_module.cut(u, y, DT, segment)[0]
    assert [len(s.y) for s in stretches] == [900, 795, 800, 1099]


def test_standard_errors_are_the_scatter_of_repeated_fits():
    scores = []
    for seed in range(12):
        u, y = record(60.0, 20 + seed)
        found = fit_arx_alone(u[:, 1], y[:, 1], DT, orders=(2,), delays=(2,))
        scores.append(
            [(getattr(found, name)[0] - getattr(GAMMA, name)) / getattr(found, name)[1] for name in PARAMETERS]
        )
    assert 0.8 < np.sqrt(np.mean(np.square(scores))) < 1.5


def test_document_is_plain_and_lines_name_what_matters(coupled):
    fit = coupled[2]
    document = json.loads(json.dumps(fit.document()))
    assert document == fit.document()
    assert document["gamma"]["coupled"] is True
    assert document["gamma"]["cross_gain"]["value"] == pytest.approx(0.03, abs=0.003)
    assert document["beta"]["order"] == len(document["beta"]["poles_rad_s"]) == len(document["beta"]["a"]) == 2
    beta, gamma = fit.lines()
    assert beta.startswith("ARX beta ")
    assert "(not coupled)" in beta
    assert "(coupled)" in gamma
    assert f"{fit.gamma.simulation:.1f} %" in gamma


def test_a_pole_that_no_continuous_system_has_is_none(coupled):
    axis = replace(coupled[2].beta, a=np.array([0.2, 0.15]))  # z = 0.5, -0.3
    assert axis.poles == (pytest.approx(math.log(0.5) / DT), None)
    assert axis.document()["poles_rad_s"][1] is None
    assert "none" in axis.line()


def test_what_cannot_be_fitted_is_said():
    u, y = record(10.0)
    with pytest.raises(ValueError, match=r"got commands \(300, 1\) and angles \(300, 2\)"):
        fit_arx(u[:, :1], y, DT)
    with pytest.raises(ValueError, match="got 100 samples in uninterrupted stretches, expected at least 150"):
        fit_arx(u[:100], y[:100], DT)
    with pytest.raises(ValueError, match="got 0 samples"):
        fit_arx(u, y * np.nan, DT)
    with pytest.raises(ValueError, match="got an angle that is the same all the time"):
        fit_arx(u, np.full_like(y, 0.01), DT)
    u[:, 1] = 0.01
    with pytest.raises(ValueError, match="got a command over 0 rad"):
        fit_arx(u, y, DT)


def test_second_order_and_mean_lag_against_the_exact_discretisation():
    frequency, damping = 15.0, 0.7
    axis = StageAxis(1.0, frequency, damping)
    p, q = (cmath.exp(pole * DT) for pole in axis.poles())
    a = np.array([(p + q).real, -(p * q).real])
    response = np.diff(step_response(axis, np.arange(400) * DT))  # h_1, h_2, ...
    b = np.array([response[0], response[1] - a[0] * response[0], 0.0])
    assert second_order(a, DT) == pytest.approx((frequency, damping))
    assert mean_lag(a, b, 0, DT) == pytest.approx(DT * np.arange(1, 400) @ response / response.sum())
    assert mean_lag(a, b, 2, DT) == pytest.approx(2.0 * DT + 2.0 * damping / frequency + 0.5 * DT, abs=1e-4)
    assert second_order(np.array([0.8]), DT) == pytest.approx((-2.0 * math.log(0.8) / DT, 1.0))
    assert second_order(np.array([-0.8]), DT) == pytest.approx((math.pi / DT, 1.0))


def small_stretch():
    rng = np.random.default_rng(0)
    u, extra = rng.standard_normal(200), rng.standard_normal((2, 200))
    every = np.arange(200)
    return Stretch(u, rng.standard_normal(200), extra, every % 5 == 4, every // 20)


def test_simulation_is_the_formula():
    s, x, n, d = small_stretch(), np.array([1.2, -0.5, 0.3, 0.1, -0.2, 0.4, 0.05, 0.7]), 2, 3
    before = s.y[:3].mean() - x[5:7] @ s.extra[:, 0] - x[7]
    w = np.full(len(s.u), np.nan)
    for k in range(len(w)):
        past = [w[k - i] if k >= i else before for i in (1, 2)]
        commands = [s.u[max(k - d - j, 0)] for j in (1, 2, 3)]
        w[k] = x[:2] @ past + x[2:5] @ commands
    np.testing.assert_allclose(simulate(s, x, n, d), w + x[5:7] @ s.extra + x[7], atol=1e-12)
    rows = regressors(s, n, d)
    expected = [s.y[59], s.y[58], s.u[56], s.u[55], s.u[54], *s.extra[:, 60], 1.0]
    assert rows[60] == pytest.approx(np.array(expected))


def test_jacobian_against_finite_differences():
    s, x = small_stretch(), np.array([1.2, -0.5, 0.3, 0.1, -0.2, 0.4, 0.05, 0.7])
    keep = [kept(s, 10)]
    J = jacobian([s], x, 2, 3, keep)
    for i, step in enumerate(1e-6 * np.eye(8)):
        slope = (simulate(s, x + step, 2, 3) - simulate(s, x - step, 2, 3)) / 2e-6
        np.testing.assert_allclose(J[:, i], slope[keep[0]], atol=1e-6)


def test_refinement_ends_where_no_step_lowers_the_error():
    s, rng = small_stretch(), np.random.default_rng(1)
    true = np.array([1.2, -0.5, 0.3, 0.1, -0.2, 0.4, 0.05, 0.7])
    s = Stretch(s.u, simulate(s, true, 2, 3) + 0.1 * rng.standard_normal(200), s.extra, s.held_out, s.block)
    x = refine([s], 2, 3, DT)
    keep = kept(s, 15)

    def cost(x):
        return float(np.sum((s.y - simulate(s, x, 2, 3))[keep] ** 2))

    steps = [size * row for row in np.eye(8) for size in (-2e-3, 2e-3)]
    assert all(cost(x + step) > cost(x) for step in steps)
    assert cost(x) < cost(true)
    np.testing.assert_allclose(x, true, atol=0.06)


def test_stable_mirrors_what_is_outside_and_leaves_the_rest():
    inside = np.array([1.2, -0.5])
    np.testing.assert_allclose(stable(inside), inside, atol=1e-12)
    assert z_poles(stable(np.array([2.0]))) == (pytest.approx(0.5),)
    outside = np.array([2.5 * math.cos(0.3), -(1.25**2)])
    assert z_poles(stable(outside))[0] == pytest.approx(0.8 * cmath.exp(0.3j))
    assert abs(z_poles(stable(np.array([1.0])))[0]) < 1.0
    assert z_poles(np.zeros(2)) == (0.0, 0.0)
