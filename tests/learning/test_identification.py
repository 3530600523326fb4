"""Identification on motions that are known, integrated here by other means."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mazeplan.core.logs.table import Table
from mazeplan.learning.identification import fit_rig
from mazeplan.learning.weak_form import find_windows, ridge, weak_function, window_of
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.rig.stage import StageAxis, simulate_axis
from mazeplan.run.collect import multisine

MAZE = load_map("cme")
DT, FINE = 1.0 / 30.0, 10
TRUE = {"factor": 0.6, "viscous": 0.3, "dry": 0.3, "beta": 0.004, "gamma": -0.003, "delay": 0.067, "coupling": 0.04}


def record(ring, seconds, seed):
    """A ball held on the track of a ring, Runge-Kutta at 1/300 s, seen through noise and late."""
    rng = np.random.default_rng(seed)
    radius, axis = MAZE.track_radius(ring), StageAxis(1.0, 26.0, 0.9)
    u = multisine(rng, seconds, 1.0 / DT, MAZE.tilt_limit)
    held = np.repeat(u + TRUE["coupling"] * u[:, ::-1], FINE, axis=0)
    tilt = np.stack([simulate_axis(axis, held[:, i], DT / FINE) for i in range(2)], axis=1)
    rates = np.gradient(tilt, DT / FINE, axis=0)
    accelerations = np.gradient(rates, DT / FINE, axis=0)

    def rate(x, k):
        (b, c), (bd, cd), bdd = tilt[k], rates[k], accelerations[k, 0]
        s, o = math.sin(x[0]), math.cos(x[0])
        pull = math.sin(b + TRUE["beta"]) * s + math.sin(c + TRUE["gamma"]) * math.cos(b + TRUE["beta"]) * o
        dd = bdd * math.sin(c) - bd**2 * s * o * math.cos(c) ** 2 + 2 * bd * cd * math.cos(c) * s**2 + cd**2 * s * o
        dd += -TRUE["factor"] * 9.81 / radius * pull - TRUE["viscous"] * x[1] - TRUE["dry"] * math.tanh(x[1] / 0.02)
        return np.array([x[1], dd])

    x, h, path = np.array([rng.uniform(-3, 3), 0.0]), 2 * DT / FINE, []
    for k in range(0, len(tilt) - 2, 2):
        path.append(x[0])
        k1 = rate(x, k)
        k2 = rate(x + 0.5 * h * k1, k + 1)
        k3 = rate(x + 0.5 * h * k2, k + 1)
        x = x + h / 6.0 * (k1 + 2 * k2 + 2 * k3 + rate(x + h * k3, k + 2))
    t_fine = np.arange(len(path)) * h
    t = np.arange(len(u) - 2) * DT
    theta = np.interp(t - TRUE["delay"], t_fine, path)
    x_, y_ = (radius * f(theta) + 0.5e-3 * rng.standard_normal(len(t)) for f in (np.cos, np.sin))
    seen = tilt[::FINE][: len(t)] + math.radians(0.05) * rng.standard_normal((len(t), 2))
    return {
        "t": t,
        "x": x_,
        "y": y_,
        "beta": seen[:, 0],
        "gamma": seen[:, 1],
        "u_beta": u[: len(t), 0],
        "u_gamma": u[: len(t), 1],
    }


def table(rings=(1, 2), seconds=240.0):
    parts = []
    for segment, ring in enumerate(rings):
        part = record(ring, seconds, segment)
        part["segment"] = np.full(len(part["t"]), float(segment))
        parts.append(part)
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    columns["theta"], columns["r"] = np.arctan2(columns["y"], columns["x"]), np.hypot(columns["x"], columns["y"])
    return Table(columns)


@pytest.fixture(scope="module")
def fitted():
    return fit_rig(table(), MAZE)


@pytest.mark.slow
def test_what_was_put_in_is_found(fitted):
    for ring in (1, 2):
        ball = fitted.model.ball(ring)
        assert ball.parameter("rolling_inertia", "factor", 0.0) == pytest.approx(TRUE["factor"], rel=0.04)
        assert ball.parameter("viscous_friction", "coefficient", 0.0) == pytest.approx(TRUE["viscous"], abs=0.12)
        assert ball.parameter("dry_friction", "coefficient", 0.0) == pytest.approx(TRUE["dry"], abs=0.2)
        assert ball.parameter("tilt_offset", "beta", 0.0) == pytest.approx(TRUE["beta"], abs=1e-3)
        assert ball.parameter("tilt_offset", "gamma", 0.0) == pytest.approx(TRUE["gamma"], abs=1e-3)
    assert fitted.windows[1] > 100


@pytest.mark.slow
def test_the_delay_is_found_although_the_track_here_has_no_play(fitted):
    assert fitted.model.camera_delay == pytest.approx(TRUE["delay"], abs=0.012)
    assert 0.0 < fitted.model.camera_delay_stderr < 0.02


@pytest.mark.slow
def test_the_stage_is_found(fitted):
    for axis in (fitted.model.stage.beta, fitted.model.stage.gamma):
        assert axis.gain == pytest.approx(1.0, abs=0.01)
        assert axis.natural_frequency == pytest.approx(26.0, rel=0.15)
        assert axis.dead_time < 0.012
        assert axis.coupling == pytest.approx(TRUE["coupling"], abs=0.003)


@pytest.mark.slow
def test_rings_without_data_take_the_nearest_and_the_disc_rolls_freely(fitted):
    model = fitted.model
    assert model.ball(4).parameter("rolling_inertia", "factor", 0.0) == model.ball(2).parameter(
        "rolling_inertia", "factor", 0.0
    )
    assert model.ball(5).parameter("rolling_inertia", "factor", 0.0) == pytest.approx(5 / 7)
    assert set(model.scores["weak_nrmse_test"]) == {"ring1", "ring2"}
    assert model.scores["weak_nrmse_test"]["ring1"] < 0.5


def test_windows_leave_out_gaps_other_rings_and_a_ball_that_stands():
    whole = table((1,), 60.0)
    everything = find_windows(whole, MAZE)[0]
    assert len(everything.start) > 50
    assert len(find_windows(whole, MAZE)[1].start) == 0
    columns = dict(whole.columns)
    columns["theta"] = columns["theta"].copy()
    columns["theta"][900:910] = np.nan
    holed = find_windows(Table(columns), MAZE)[0].start
    assert not np.any((holed > 887) & (holed < 910))
    assert np.any((everything.start > 887) & (everything.start < 910))
    still = {**whole.columns, "theta": np.full(len(whole), 0.3)}
    assert len(find_windows(Table(still), MAZE)[0].start) == 0


def test_missing_columns_and_balls_are_said():
    columns = dict(table((1,), 60.0).columns)
    with pytest.raises(ValueError, match="u_beta"):
        fit_rig(Table({k: v for k, v in columns.items() if k != "u_beta"}), MAZE)
    columns["r"] = np.full_like(columns["r"], 0.5)
    with pytest.raises(ValueError, match=r"hardly ever seen .* got \d+ windows .*, expected at least 8 in one ring"):
        fit_rig(Table(columns), MAZE)


def test_at_a_low_rate_windows_are_as_long_as_usual():
    whole = table((1,), 120.0)
    half = Table({name: column[::2] for name, column in whole.columns.items()})
    assert [window_of(1.0 / rate) for rate in (10.0, 15.0, 20.0, 30.0, 60.0)] == [7, 7, 9, 13, 13]
    assert len(find_windows(half, MAZE)[0].start) > 0.4 * len(find_windows(whole, MAZE)[0].start)
    ball = fit_rig(half, MAZE).model.ball(1)
    assert ball.parameter("rolling_inertia", "factor", 0.0) == pytest.approx(TRUE["factor"], rel=0.06)
    assert ball.parameter("viscous_friction", "coefficient", 0.0) == pytest.approx(TRUE["viscous"], abs=0.15)


def test_at_a_low_rate_the_delay_is_found():
    whole = table((1,), 120.0)
    half = {name: column[::2] for name, column in whole.columns.items()}
    late = Table(half | {name: np.roll(half[name], 2) for name in ("beta", "gamma")})  # by two samples
    assert fit_rig(late, MAZE).model.camera_delay == pytest.approx(TRUE["delay"] - 4.0 * DT, abs=0.02)


def test_a_record_with_few_windows_is_enough():
    short = table((1,), 6.0)  # 14 windows to train on
    factor = fit_rig(short, MAZE).model.ball(1).parameter("rolling_inertia", "factor", 0.0)
    assert factor == pytest.approx(0.61, abs=0.1)


def test_weak_function_integrates_by_parts():
    phi, slope, curve = weak_function(DT, 31)
    t = (np.arange(31) - 15) * DT
    f, df, ddf = np.sin(2 * t), 2 * np.cos(2 * t), -4 * np.sin(2 * t)
    g, ddg = t**2, np.full_like(t, 2.0)
    assert phi @ ddf == pytest.approx(curve @ f, abs=1e-6)
    assert phi @ ddg == pytest.approx(curve @ g, rel=1e-3)
    assert phi @ df == pytest.approx(-slope @ f, rel=1e-3)
    assert [curve.sum() * DT, slope.sum() * DT] == pytest.approx([0.0, 0.0], abs=1e-3)


def test_ridge_is_the_posterior_mean_and_forgives_outliers():
    rng = np.random.default_rng(0)
    X, w = rng.standard_normal((400, 3)), np.array([1.0, -2.0, 0.5])
    y = X @ w + 0.1 * rng.standard_normal(400)
    y[::25] += 50.0
    block = np.arange(400) // 10
    found, variance, _ = ridge(X, y, np.zeros(3), np.full(3, 10.0), block)
    assert np.all(np.abs(found - w) < 5 * np.sqrt(variance))
    assert found == pytest.approx(w, abs=0.03)
    held, _, _ = ridge(X, y, np.array([3.0, 3.0, 3.0]), np.full(3, 1e-6), block)
    assert held == pytest.approx([3.0, 3.0, 3.0], abs=1e-3)
