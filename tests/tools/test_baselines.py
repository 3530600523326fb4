"""The ways to correct a model that the benchmark sets beside the diagnosis."""

import bench_baselines_ways as ways
import numpy as np
import plant
import pytest
from bench_baselines import as_seen
from bench_plant import DECLARED, RADII
from scipy.integrate import solve_ivp

from mazeplan.core.maths.angles import difference
from mazeplan.diagnosis.coordinate.fit import Likelihood
from mazeplan.diagnosis.coordinate.kalman import NODES, roll_out
from mazeplan.diagnosis.ring.candidates import ring_library
from mazeplan.diagnosis.ring.scores import score_starts
from mazeplan.diagnosis.ring.system import RingSystem, Tilt

RADIUS, DT, SECONDS = RADII["1"], 1 / 30, 60.0
TRUE = {"gamma sin": 8.0, "v": -0.2}


def tilted(t):
    """Motion (n, 6) of a plate that swings along two axes."""
    columns = []
    for size, rate in ((0.05, 2.1), (0.04, 3.3)):
        columns += [size * np.sin(rate * t), size * rate * np.cos(rate * t), -size * rate**2 * np.sin(rate * t)]
    return np.column_stack(columns)


def missing(x, v, t, motion):
    known = ways.regressors(x, v, t, motion)
    return sum(size * known[name] for name, size in TRUE.items())


def rolled(force, n):
    """Angles and speeds (n, 2) of a ball along that plate."""

    def change(t, state):
        x, v, at = state[:1], state[1:], np.array([t])
        return np.concatenate([v, force(x, v, at, tilted(at))])

    t = DT * np.arange(n)
    return solve_ivp(change, (0.0, t[-1]), (0.5, 0.0), method="LSODA", t_eval=t, rtol=1e-8, atol=1e-9).y.T


@pytest.fixture(scope="module")
def ground():
    declared, n = ways.declared_model(RADIUS), round(SECONDS / DT)
    states = rolled(lambda *at: declared(*at) + missing(*at), n)
    t = DT * np.arange(n)
    motion = tilted((t[:, None] + DT * np.arange(NODES) / (NODES - 1)).ravel()).reshape(n, NODES, 6)
    first = np.arange(n) == 0
    seen, early, every = t < 0.7 * SECONDS, t < 0.5 * SECONDS, np.ones(n, dtype=bool)
    starts = [score_starts(rows, first, every) for rows in (~seen, seen & ~early)]
    theta = states[:, 0] + 2e-3 * np.random.default_rng(0).standard_normal(n)
    return ways.Ground(t, DT, theta, motion, declared, seen, early, states, *starts)


@pytest.mark.slow
def test_a_gaussian_process_takes_up_a_smooth_residual(ground):
    nothing = ways.Correction(lambda x, v, t, motion: np.zeros_like(x))
    before = ways.error_of(ground, nothing.force, ground.held_out)
    r = ways.residual(ground, ways.SMOOTHINGS[0])
    found = ways.gaussian_process(r, np.flatnonzero(r.known & ground.seen), trial=True)
    after = ways.error_of(ground, found.force, ground.held_out)
    assert after < 0.2 * before


def test_sparse_regression_finds_just_the_terms_that_are_missing(ground):
    pytest.importorskip("pysindy")
    found = ways.chosen(ground, ways.sparse_regression)
    assert set(found.kept) == set(TRUE)
    at = ground.states[:, 0], ground.states[:, 1], ground.t, ground.motion[:, 0]
    off = found.force(*at) - missing(*at)
    assert np.sqrt(np.mean(off**2)) < 0.05 * np.std(missing(*at))


def test_the_residual_of_a_wide_window_has_no_trace_of_the_declared_model(ground):
    widest = ways.SMOOTHINGS[-1]
    declared = rolled(ground.declared, len(ground.t))
    exact = ways.Ground(**{**vars(ground), "theta": declared[:, 0], "states": declared})
    averaged, usual = (ways.residual(exact, widest, how) for how in (True, False))
    assert np.nanstd(averaged.value) < 0.1 * np.nanstd(usual.value)


def test_roll_outs_are_those_of_the_diagnosis():
    columns = plant.play(seed=3, seconds=20.0)
    t, theta = columns["t"], np.unwrap(columns["theta"])
    tilt = Tilt(t, tilted(t), "")
    first = np.arange(len(t)) == 0
    system = RingSystem(t, theta, first, RADIUS, tilt, DECLARED)
    likelihood = Likelihood(system, ring_library(), np.ones(len(t), dtype=bool))
    states = likelihood.filtered({}, 1.0).copy()
    starts = score_starts(np.ones(len(t), dtype=bool), first, np.isfinite(theta))
    problem, p = system.build(likelihood.library, {})
    positions, _ = roll_out(problem, p, states, starts, 40)
    motion = tilt.at((t[:, None] + DT * np.arange(NODES) / (NODES - 1)).ravel()).reshape(len(t), NODES, 6)
    declared, every = ways.declared_model(RADIUS), np.ones(len(t), dtype=bool)
    ground = ways.Ground(t, system.dt, theta, motion, declared, every, every, states[:, :2], starts, starts)
    assert ways.roll_out(ground, declared, starts) == pytest.approx(positions[:, 40], abs=1e-6)


def test_states_as_a_camera_that_is_off_sees_them():
    t, offset = np.arange(0.0, 6.0, 0.001), (0.002, -0.001)
    seen = as_seen(np.column_stack([t, np.ones_like(t)]), RADIUS, offset)
    x, y = RADIUS * np.cos(t) + offset[0], RADIUS * np.sin(t) + offset[1]
    assert np.abs(difference(seen[:, 0], np.arctan2(y, x))).max() < 1e-12
    assert seen[1:-1, 1] == pytest.approx((seen[2:, 0] - seen[:-2, 0]) / 0.002, abs=1e-5)
