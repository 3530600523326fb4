"""Recover the samples of the circular-maze rig between the published ones, and the breaks of its recording.

Only every `step`-th sample was published, at 30 Hz. Two identities hold for every sample k (measured on the one ring
that was published whole, to 1e-8):

    v[k] = a v[k-1] + b v[k-2] + 30 c (x[k] - x[k-1])    rates of each axis: (a, b, c) = FILTER
    y[k] = 900 sum_j ACCELERATION[j] x[k+j]              acceleration of theta, j = -3 .. 3

Every published row has x and v of each axis, and y of theta. Among all paths x that fulfil these identities, the
recovered path has the smallest third differences. With step 2 it is nearly unique, except for the tilt at the end of a
segment. With steps 3 and 4 it is not unique.

The minimum sum of squares of third differences also measures how unlikely it is that one published row follows another
after `step` samples. `segment_starts` puts a break where this is cheaper than going on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.lib.stride_tricks import sliding_window_view
from scipy.sparse.linalg import spsolve

from mazeplan.core.records import Array

AXES = ("theta", "beta", "gamma")
RATE_HZ = 30.0  # of camera and tilt sensor
FILTER = (1.21647638, -0.42187148, 0.2053951)  # v_k = a v_{k-1} + b v_{k-2} + c (x_k - x_{k-1}) / dt; the rig's own
ACCELERATION = np.array([5, 0, -3, -4, -3, 0, 5]) / 42.0  # Savitzky-Golay, 7 samples, order 2: per sample^2
RATE = np.arange(-3, 4) / 28.0  # the same window, first derivative: per sample
EDGE = 3  # samples on either side of the middle of this window
MAX_STEP = 8  # samples from one published row to the next; 1 to 4 occur
MEMORY = 6  # earlier published rows that predict a row
# Cost of a break, against log(1 + surprise) of going on, summed over the axes. On the ring published whole, the first
# 70 % have 67 breaks (by the filter). A cost of 15 finds 17 false breaks, too; costs of 30 to 40 find exactly the 67.
BREAK_COST = 30.0
SLACK = 1e-4  # rad of error in the identities counts as much as 1 rad of third difference, in the search for breaks
LEAST_SURPRISE = 1e-12  # rad^2; a recording smoother than a microradian counts as smooth
EXACT = 1e-6  # rad; as SLACK, in the recovery itself
TIE = 1e-8  # weight of first against third differences: a tie-break, in segments of two rows


@dataclass(frozen=True)
class Published:
    """Published rows in order of time. Axes are theta, beta, gamma.

    angles (N, 3):    rad, wrapped or not
    rates (N, 3):     rad/s
    theta_ddot (N,):  rad/s^2"""

    angles: Array
    rates: Array
    theta_ddot: Array

    def __len__(self) -> int:
        return len(self.theta_ddot)

    def __getitem__(self, rows: slice) -> Published:
        return Published(self.angles[rows], self.rates[rows], self.theta_ddot[rows])

    def unwrapped(self) -> Array:
        """The angles (N, 3), rad; theta continuous, beginning in 0 <= theta < 2 pi."""
        turned = np.unwrap(self.angles[:, 0])
        return np.column_stack([turned - turned[0] + turned[0] % (2.0 * np.pi), self.angles[:, 1:]])


def _system(m: int, step: int, acceleration: bool) -> tuple[Any, Any, Any]:
    """Least squares for one axis of m published rows, sparse: `smooth` z small, subject to `exact` z = `given` d.

    z: positions from EDGE samples before to EDGE samples after, then rates from one sample before on
    d: published positions, rates and, for theta, accelerations, (m,) each, see `_data`

    Units are rad and samples. The rows of `exact` are those of d, then those of the filter.
    """
    samples = (m - 1) * step + 1
    places, rates = samples + 2 * EDGE, samples + 1
    width = places + rates
    published, between = np.arange(m)[:, None] * step, np.arange(samples - 1)[:, None]
    a, b, c = FILTER
    exact = [_rows(published + EDGE, (1.0,), width), _rows(places + published + 1, (1.0,), width)]
    if acceleration:
        exact.append(_rows(published + np.arange(2 * EDGE + 1), ACCELERATION, width))
    known = len(exact) * m
    filtered = np.hstack([places + between + [0, 1, 2], EDGE + between + [0, 1]])
    exact.append(_rows(filtered, (-b, -a, 1.0, c, -c), width))
    third = _rows(np.arange(places - 3)[:, None] + [0, 1, 2, 3], (-1.0, 3.0, -3.0, 1.0), width)
    first = _rows(np.arange(places - 1)[:, None] + [0, 1], (-(TIE**0.5), TIE**0.5), width)
    given: Any = sparse.eye_array(known + samples - 1, known, format="csr")
    return sparse.vstack([third, first], format="csr"), sparse.vstack(exact, format="csr"), given


def _rows(columns: Any, values: Sequence[float] | Array, width: int) -> Any:
    """A sparse matrix (n, width) with `values` (k,) in each row, at `columns` (n, k)."""
    n, k = columns.shape
    entries = (np.tile(np.asarray(values), n), (np.repeat(np.arange(n), k), columns.ravel()))
    return sparse.csr_array(entries, shape=(n, width))


def _data(positions: Array, rates: Array, theta_ddot: Array | None) -> Array:
    """d of `_system`, (..., 2 m or 3 m), relative to the first position, from arrays (..., m)."""
    parts = [positions - positions[..., :1], rates / RATE_HZ]
    if theta_ddot is not None:
        parts.append(theta_ddot / RATE_HZ**2)
    return np.concatenate(parts, axis=-1)


def recover(rows: Published, step: int) -> Array:
    """Angles of all samples of one uninterrupted segment of m published rows: ((m - 1) step + 1, 3)."""
    m, known = len(rows), rows.unwrapped()
    if m == 1:  # nothing to recover
        return known
    samples = (m - 1) * step + 1
    angles = np.empty((samples, 3))
    for axis in range(3):
        acceleration = rows.theta_ddot if axis == 0 else None
        smooth, exact, given = _system(m, step, axis == 0)
        right = given @ _data(known[:, axis], rows.rates[:, axis], acceleration)
        squares: Any = smooth.T @ smooth
        slack = -(EXACT**2) * sparse.eye_array(len(right))
        lagrange = sparse.block_array([[squares, exact.T], [exact, slack]], format="csc")
        z = np.asarray(spsolve(lagrange, np.concatenate([np.zeros(squares.shape[0]), right])))
        angles[:, axis] = known[0, axis] + z[EDGE : EDGE + samples]
        angles[::step, axis] = known[:, axis]
    return angles


def sampling_step(rows: Published) -> int:
    """Number of samples from one published row to the next: weighted median of angle difference over rate."""
    gone = np.diff(rows.unwrapped(), axis=0)
    went = 0.5 * (rows.rates[1:] + rows.rates[:-1]) / RATE_HZ
    weight = np.abs(went).ravel()
    ratio = gone.ravel() / np.where(weight > 0.0, went.ravel(), 1.0)
    order = np.argsort(ratio)
    half = np.searchsorted(np.cumsum(weight[order]), 0.5 * weight.sum())
    return int(np.clip(round(float(ratio[order][half])), 1, MAX_STEP))


def segment_starts(rows: Published, step: int) -> Array:
    """First rows of the uninterrupted segments; the first is 0."""
    surprise = _surprise(rows, step)
    typical = np.median(surprise[:, MEMORY, MEMORY:], axis=1)
    cost = np.log1p(surprise / np.maximum(typical, LEAST_SURPRISE)[:, None, None]).sum(axis=0)
    return _cheapest(cost)


@lru_cache(maxsize=256)
def _surprise_factor(m: int, step: int, acceleration: bool) -> Array:
    """R such that |R d|^2 is the minimum sum of squares, rad^2, of m rows with the data d (see `_system`)."""
    smooth, exact, given = (part.toarray() for part in _system(m, step, acceleration))
    matrix = np.vstack([smooth, exact / SLACK])
    right = np.vstack([np.zeros((len(smooth), given.shape[1])), given / SLACK])
    left, singular, _ = np.linalg.svd(matrix, full_matrices=True)
    rank = int(np.sum(singular > singular[0] * 1e-12))
    return np.asarray(np.linalg.qr(left[:, rank:].T @ right, mode="r"))


def _surprise(rows: Published, step: int) -> Array:
    """Growth of the minimum sum of squares, (3, MEMORY + 1, N), rad^2, if row k joins the L rows before it."""
    known, out = rows.unwrapped(), np.zeros((3, MEMORY + 1, len(rows)))
    for axis in range(3):
        least = []
        for m in range(1, MEMORY + 2):
            published = (known[:, axis], rows.rates[:, axis], rows.theta_ddot)
            windows = [sliding_window_view(column, m) for column in published]
            data = _data(windows[0], windows[1], windows[2] if axis == 0 else None)
            least.append(np.sum((data @ _surprise_factor(m, step, axis == 0).T) ** 2, axis=1))
        for before in range(1, MEMORY + 1):
            out[axis, before, before:] = np.maximum(least[before] - least[before - 1][:-1], 0.0)
    return out


def _cheapest(cost: Array) -> Array:
    """Starts of the segments with the minimum cost, by dynamic programming over the rows since the last break.

    cost (MEMORY + 1, N): cost of row k if L rows of its segment come before it; L = MEMORY also stands for more rows.
    """
    memory, count = MEMORY, cost.shape[1]
    so_far = np.full(memory + 1, np.inf)  # by number of rows in the segment, including the present one
    so_far[1] = 0.0
    before = np.zeros((count, memory + 1), dtype=int)
    for k in range(1, count):
        joined = so_far + cost[:, k]
        new = np.full(memory + 1, np.inf)
        before[k, 2:], new[2:] = np.arange(1, memory), joined[1:memory]
        if joined[memory] < new[memory]:
            before[k, memory], new[memory] = memory, joined[memory]
        before[k, 1] = int(np.argmin(so_far))
        new[1] = so_far[before[k, 1]] + BREAK_COST
        so_far = new
    starts, rows_in = [0], int(np.argmin(so_far))
    for k in range(count - 1, 0, -1):
        if rows_in == 1:
            starts.append(k)
        rows_in = before[k, rows_in]
    return np.array(sorted(starts))
