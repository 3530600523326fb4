"""Comparing kinds of models: known balls on two tracks, so that it is known what must come out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ring_record import DT, RADII, Ball, columns, ring_table

from mazeplan.core.errors import InputError, TableError
from mazeplan.core.logs.table import Table, read_table
from mazeplan.learning import comparison
from mazeplan.learning.comparison import MIN_TRAINED, PREDICTED, ROLLED, SPLIT, CompareOptions, best_lag, compare
from mazeplan.learning.fitting import FitOptions
from mazeplan.learning.gp_training import TrainingOptions
from mazeplan.learning.samples import SampleOptions, ring_samples
from mazeplan.learning.smoothing import Smoothing
from mazeplan.maze.mapfile import load_map

MAZE = load_map("cme")
TRAINING = TrainingOptions(first=100, rows=150, starts=1, iterations=30, refinement=15)
GUARD = SPLIT["guard"]
QUICK = CompareOptions(Smoothing("rts", model="snap"), delay=0.0, fit=FitOptions(most=250, training=TRAINING))
ONE = replace(QUICK, kinds=("p", "pi"))  # where processes are not what is looked at


@pytest.fixture(autouse=True, scope="module")
def one_thread():
    torch = pytest.importorskip("torch")
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="module", autouse=True)
def short_training_of_the_map():
    """The discrete map is trained as shortly as the others."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mazeplan.learning.fitting.TrainingOptions", lambda **more: replace(TRAINING, **more))
        yield


@pytest.fixture(autouse=True)
def few_draws(monkeypatch):
    """100 draws of a bootstrap are enough for tests."""
    whole = comparison.block_bootstrap
    monkeypatch.setattr(comparison, "block_bootstrap", lambda *a: whole(*a, draws=100))


def first_rows(table, n):
    """The beginning of a table."""
    return Table({name: column[:n] for name, column in table.columns.items()})


@pytest.fixture(scope="module")
def table():
    return ring_table((2, 3), 45.0)


@pytest.fixture(scope="module")
def scores(table):
    return compare([table], [], MAZE, QUICK)


# --- what the figures must be


@pytest.mark.slow
def test_each_ring_is_scored(scores):
    assert list(scores) == [2, 3]
    for s in scores.values():
        assert s["rates"] == "delayed"  # the angle is clean
        assert s["signs"] == {"beta": 1, "gamma": 1}
        assert s["n_train"] == 250
        assert 250 < s["n_test"] < 340
        assert s["windows"] > 10
        assert tuple(s["nrmse_train"]) == tuple(s["nrmse_test"]) == PREDICTED
        assert tuple(s["rollout"]) == ROLLED


def test_roll_outs_grow_and_the_discrete_map_is_the_worst_process(scores):
    for s in scores.values():
        for errors in s["rollout"].values():
            assert 0.0 < errors["20"] < errors["40"]
        assert s["rollout"]["sp"]["40"] < 0.5 * min(s["rollout"]["npd"]["40"], s["rollout"]["pi"]["40"])
        assert s["rollout"]["sp"]["40"] < 0.05


# --- which rows are whose


@pytest.mark.parametrize("rates", ["smoothed", "delayed"])
def test_no_row_is_trained_and_tested_on_and_the_guard_is_kept(table, rates):
    for samples in ring_samples(table, MAZE, QUICK.smoothing, SampleOptions(rates=rates)).values():
        data = comparison.prepare(samples, None, QUICK)
        assert data.test is data.train
        assert len(data.train_rows) >= 700
        assert len(data.test_rows) >= 200
        apart = np.abs(data.train_rows[:, None] - data.test_rows[None, :]).min(axis=0)
        assert apart.min() > GUARD
        # the smoothing of a target, and the rate before it, reach from one to the other nowhere
        assert GUARD >= 7
        assert samples.good[data.train_rows].all()
        assert samples.good[data.test_rows].all()


def test_what_is_fitted_sees_no_test_row(table, monkeypatch):
    seen = []

    def spy(kind, samples, rows, *a, **more):
        seen.append(rows)
        return fit(kind, samples, rows, *a, **more)

    fit = comparison.fit_kind
    monkeypatch.setattr(comparison, "fit_kind", spy)
    compare([table], [], MAZE, replace(ONE, samples=SampleOptions(ring=2), rates="smoothed"))
    samples = ring_samples(table, MAZE, QUICK.smoothing, SampleOptions(ring=2))[2]
    held = comparison.prepare(samples, None, QUICK).test_rows
    assert len(seen) == len(ONE.kinds)
    for rows in seen:
        assert not set(rows.tolist()) & set(held.tolist())


@pytest.mark.slow
def test_accelerations_are_predicted_by_the_mean_and_roll_outs_by_what_is_typical(table, monkeypatch):
    def still(k):
        """A ball that nothing moves."""
        return np.zeros(len(k.theta))

    fit = comparison.fit_kind

    def other(*fitted, **more):
        return replace(fit(*fitted, **more), typical=still)

    plain = compare([table], [], MAZE, ONE)
    monkeypatch.setattr(comparison, "fit_kind", other)
    moved = compare([table], [], MAZE, ONE)
    for before, after in zip(plain.values(), moved.values(), strict=True):
        assert after["nrmse_test"] == before["nrmse_test"]
        assert after["rollout"]["pi"]["40"] > 2.0 * before["rollout"]["pi"]["40"]


@pytest.mark.slow
def test_test_logs_are_what_is_scored(table):
    """With a test log of rubbish the test scores are rubbish and the training scores are not."""
    rng = np.random.default_rng(0)
    part = first_rows(table, 900)
    steps = 0.05 * rng.standard_normal(900)
    rubbish = Table({**part.columns, "theta": np.cumsum(steps - steps.mean()) % 6.0 - 3.0})
    options = replace(ONE, rates="smoothed")
    good = compare([table], [ring_table((2, 3), 30.0, seed=1)], MAZE, options)
    bad = compare([table], [rubbish], MAZE, options)
    assert list(good) == [2, 3]
    assert list(bad) == [2]  # only what both have
    assert good[2]["nrmse_test"]["pi"] < 0.4
    assert bad[2]["nrmse_test"]["pi"] > 0.9
    assert bad[2]["nrmse_train"] == good[2]["nrmse_train"]
    assert bad[2]["n_train"] == good[2]["n_train"] == 250
    assert good[2]["n_test"] > 850  # all of it
    assert bad[2]["rollout"]["pi"]["40"] > 3.0 * good[2]["rollout"]["pi"]["40"]


# --- what is found out about the data


@pytest.mark.slow
@pytest.mark.parametrize("signs", [(-1, 1), (1, -1)])
def test_a_tilt_counted_the_other_way_round_is_turned_and_told(table, signs):
    table = first_rows(table, 1350)
    turned = {"beta": signs[0] * table["beta"], "gamma": signs[1] * table["gamma"]}
    plain = compare([table], [], MAZE, ONE)
    found = compare([Table({**table.columns, **turned})], [], MAZE, ONE)
    for a, b in zip(plain.values(), found.values(), strict=True):
        assert b["signs"] == {"beta": signs[0], "gamma": signs[1]}
        assert b["nrmse_test"] == pytest.approx(a["nrmse_test"])
    # a test log is turned as the others are
    held = compare([Table({**table.columns, **turned})], [Table({**table.columns, **turned})], MAZE, ONE)
    assert held[2]["nrmse_test"]["p"] == pytest.approx(plain[2]["nrmse_test"]["p"], rel=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.0, 0.04, 0.1])
def test_the_delay_of_the_ball_is_found(delay):
    ball = Ball(RADII[2], viscous=0.3, dry=0.3)
    part = columns(ball, 40.0, seed=5, noise=2e-4, delay=delay)
    late = Table({**part, "ring": np.full(len(part["t"]), 2.0)})
    options = replace(ONE, delay=None)
    assert best_lag([late], MAZE, options) == pytest.approx(delay, abs=0.006)
    s = compare([late], [], MAZE, options)[2]
    assert s["delay_s"] == pytest.approx(delay, abs=0.006)
    known = compare([late], [], MAZE, replace(ONE, delay=0.02))[2]
    assert known["delay_s"] == 0.02
    own = Table({**late.columns, "theta_dot": np.zeros(len(late)), "theta_ddot": np.zeros(len(late))})
    assert best_lag([own], MAZE, options) == 0.0  # they have been brought together already


def test_a_ring_that_the_ball_only_passes_through_is_left_out(table):
    told = []
    first = first_rows(table, 1350)
    ring = first["ring"].copy()
    ring[100:150] = 4.0
    ring[200:210] = 3.0
    options = replace(ONE, delay=None)
    far = []
    found = compare(
        [Table({**first.columns, "ring": ring})], [], MAZE, options,
        left_out=told.append, advance=lambda done, total: far.append(done / total),
    )  # fmt: skip
    assert far == sorted(far)
    assert 0.0 < far[0] < 0.5
    assert list(found) == [2]
    assert any("ring 4 is left out" in text for text in told)


def test_too_little_is_said(table):
    for rows in (9, 30, MIN_TRAINED):
        few = first_rows(table, rows)
        with pytest.raises(InputError, match="no ring has samples both to train and to test on; ring 2"):
            compare([few], [], MAZE, ONE)
    rest = Table({name: column[1350:] for name, column in table.columns.items()})
    with pytest.raises(InputError, match="no ring has samples both"):
        compare([first_rows(table, 1350)], [rest], MAZE, ONE)
    with pytest.raises(InputError, match="got 0 rows to train"):  # the tilt is later than the record is long
        compare([table], [], MAZE, replace(ONE, delay=100.0))
    with pytest.raises(TableError, match="the ring of a row is unknown"):
        compare([Table({name: table[name] for name in ("t", "theta", "beta", "gamma")})], [], MAZE, ONE)


# --- measured data


def measured(name):
    """A table of the measured rig, or skip."""
    root = Path(__file__).resolve().parents[2]
    for home in (root, root.parent):
        if (path := home / "shared" / "data" / name).is_file():
            return read_table(path)
    return pytest.skip(f"the measured data {name} are not here")


def test_on_the_measured_rig_the_process_beats_the_linear_model():
    table = measured("cme-rig/ring3.csv")
    training = TrainingOptions(first=150, rows=300, starts=1, iterations=30, refinement=15, family="exponential")
    options = replace(QUICK, kinds=("pi", "sp"), fit=FitOptions(most=600, training=training))
    found = compare([table], [], MAZE, options)
    assert list(found) == [3]
    s = found[3]
    assert s["rates"] == "delayed"
    assert abs(s["n_test"] - 0.25 * len(table)) < 0.1 * len(table)
    assert s["nrmse_test"]["sp"] < min(0.6, 0.9 * s["nrmse_test"]["pi"])
    assert s["rollout"]["sp"]["40"] < s["rollout"]["pi"]["40"] + 0.05
    assert RADII[3] == pytest.approx(MAZE.track_radius(3))
    assert table.dt == pytest.approx(DT, rel=1e-3)
