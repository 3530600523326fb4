"""Blocks in time: nothing leaks over their borders, shares are kept, intervals cover."""

from __future__ import annotations

import numpy as np
import pytest

from mazeplan.core.errors import TableError
from mazeplan.learning.split import block_bootstrap, block_split, uniform_downsample

DT = 1.0 / 30.0


@pytest.mark.parametrize("guard", [0, 3, 7])
@pytest.mark.parametrize("share", [0.1, 0.25, 0.3, 0.5, 0.7])
def test_no_row_is_near_the_other_set(guard, share):
    split = block_split(np.zeros(9000), DT, test_share=share, guard=guard)
    assert not np.any(split.train & split.test)
    used = np.flatnonzero(split.train | split.test)
    apart = np.diff(used)[np.diff(split.test[used])]
    assert apart.min() == 2 * guard + 1  # windows of 2 guard + 1 around one and the other share no sample
    borders = len(apart)
    assert np.count_nonzero(~split.train & ~split.test) == 2 * guard * borders
    assert np.count_nonzero(split.test) == pytest.approx(share * 9000, abs=2 * guard * borders + 300)  # whole blocks


def test_short_records_get_shorter_blocks_or_are_refused():
    split = block_split(np.zeros(120), DT, block_s=10.0, test_share=0.3)
    assert len(np.unique(split.block[split.test])) >= 2
    for n in (0, 1, 5):
        with pytest.raises(TableError, match=rf"got {n} rows .* too short, none is left to"):
            block_split(np.zeros(n), DT)


@pytest.mark.parametrize(("n", "most"), [(10, 3), (1000, 999), (1000, 7), (5, 5), (3, 10), (0, 4), (7, 1)])
def test_downsampling_is_even(n, most):
    rows = uniform_downsample(n, most)
    assert len(rows) == min(n, most)
    if n > 0:
        gaps = np.diff(np.concatenate([[-0.5 * n / len(rows)], rows, [n - 1 + 0.5 * n / len(rows)]]))
        assert rows.min() >= 0
        assert rows.max() < n
        assert np.all(np.diff(rows) >= 1)
        assert np.all(np.abs(gaps - n / len(rows)) <= 1.0)


def ar1(rng, n, phi=0.8):
    noise = rng.standard_normal(n)
    out = np.empty(n)
    out[0] = noise[0] / np.sqrt(1.0 - phi**2)
    for k in range(1, n):
        out[k] = phi * out[k - 1] + noise[k]
    return out


@pytest.mark.slow
def test_bootstrap_of_correlated_rows_covers_the_truth_when_it_draws_blocks():
    rng, rounds, n = np.random.default_rng(0), 200, 1500
    hits = {50: 0, 1: 0}
    for _ in range(rounds):
        x = ar1(rng, n)
        for length in hits:
            low, high = block_bootstrap(x, np.arange(n) // length, np.mean, rng, 100 if length > 1 else 30)
            hits[length] += low < 0.0 < high
    assert 0.88 < hits[50] / rounds < 0.98
    assert hits[1] / rounds < 0.6  # drawing rows: the interval is three times too narrow


def test_bootstrap_keeps_blocks_whole_and_takes_columns():
    rng = np.random.default_rng(1)
    blocks = rng.integers(0, 12, 240)  # rows of a block need not be neighbours
    values = np.stack([blocks, rng.standard_normal(240)], axis=1)
    count = np.bincount(blocks, minlength=12)
    seen = []

    def statistic(rows):
        counts = np.bincount(rows[:, 0].astype(int), minlength=12)
        seen.append(np.all(counts % count == 0) and np.sum(counts // count) == 12)
        return np.mean(rows[:, 1])

    low, high = block_bootstrap(values, blocks, statistic, rng, 50)
    assert all(seen)
    assert len(seen) == 50
    assert low < np.mean(values[:, 1]) < high
