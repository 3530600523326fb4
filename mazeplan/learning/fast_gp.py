"""The mean of a Gaussian process and its derivatives, compiled for control; exact up to TOLERANCE. And the dynamics of
a ring with it.

Rows are sorted by angle into BINS bins. For each bin of a query, a table lists the ranges of rows that matter. The part
of the kernel in sin and cos of theta decides: all other rows together change the mean by less than TOLERANCE. This is
fast if the Gaussian process is rough in theta. Low-rank approximations fail there.

One float64 vector holds everything, so that the solver can pass it on. Rows are stored by column and centred, in units
in which the kernel is a power of two. Each row also stores -|x|^2 / 2. So a row costs one multiplication per column:

    exp(-|d|^2 / 2 l^2) = 2^(-|x - z|^2 / 2),   -|x - z|^2 / 2 = -|x|^2 / 2 + x z - |z|^2 / 2,   x, z in l sqrt(ln 2)

The power is a polynomial without a call, so that the compiler can vectorise the loop over the rows.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numba import njit

from mazeplan.core.errors import ModelError
from mazeplan.core.maths.compiled import CALLEE, KERNEL
from mazeplan.core.maths.exponential import exp2_below
from mazeplan.core.records import Array, IntArray
from mazeplan.learning.gaussian_process import GaussianProcess
from mazeplan.physics.dynamics import ring_dynamics
from mazeplan.physics.dynamics.ring_parameters import BY_ANGLE, BY_RATE, EXTRA, PROCESS, RingParameters

TOLERANCE = 2e-7  # rad/s^2: bound on the error of culling, of the mean and of scaled derivatives
BINS = 180  # of 2 degrees
RANGES = 8  # maximum number of ranges of rows for one bin; if there are more, the closest are joined
D = 9
_COUNT, _AMPLITUDE, _SCALES, _CENTRE, _TABLE = 0, 1, 2, 2 + D, 2 + 2 * D
HEAD = _TABLE + BINS * (1 + 2 * RANGES)
COLUMNS = D + 2  # of a row: inputs, alpha, -|x|^2 / 2
SCRATCH = 2 * D
LN2 = math.log(2.0)
UNIT = math.sqrt(LN2)  # unit of the inputs, in length scales
_packed: WeakKeyDictionary[GaussianProcess, Array] = WeakKeyDictionary()  # packing takes .05 s


def pack(gp: GaussianProcess) -> Array:
    """The vector for the compiled functions: head, rows by column, scratch space; a new copy for each caller.

    Raises ModelError for a kernel other than rbf."""
    packed = _packed.get(gp)
    if packed is None:
        packed = _packed[gp] = _pack(gp)
    return packed.copy()


def _pack(gp: GaussianProcess) -> Array:
    h = gp.hyper
    if h.family != "rbf":
        raise ModelError(f"got a kernel {h.family}, expected rbf: planning needs derivatives", key="family")
    term = h.only
    bins = _bin_of(np.arctan2(gp.inputs[:, 3], gp.inputs[:, 4]))
    order = np.argsort(bins, kind="stable")
    scales = np.full(D, np.inf)  # infinite for inputs that the kernel does not use
    scales[list(term.columns)] = term.lengthscales * UNIT
    rows, alpha, n = gp.inputs[order] / scales, gp.alpha[order], len(gp)
    starts = np.searchsorted(bins[order], np.arange(BINS + 1)).astype(np.int64)
    weights = np.add.reduceat(np.append(np.abs(alpha), 0.0), np.minimum(starts[:-1], n)) * (np.diff(starts) > 0)
    head = np.zeros(HEAD)
    head[_COUNT], head[_AMPLITUDE], head[_SCALES:_CENTRE] = n, term.amplitude**2, scales
    head[_CENTRE:_TABLE] = centre = rows.mean(axis=0)
    rows = rows - centre  # or the squares would lose digits
    reach = _reach(scales[3:5] / UNIT, term.amplitude, weights)
    for i in range(BINS):
        ranges = _joined(reach[i], starts)
        at = _TABLE + i * (1 + 2 * RANGES)
        head[at] = len(ranges)
        head[at + 1 : at + 1 + 2 * len(ranges)] = np.array(ranges, dtype=float).ravel()
    return np.concatenate([head, rows.T.ravel(), alpha, -0.5 * np.sum(rows**2, axis=1), np.zeros(SCRATCH)])


def _bin_of(angle: Array) -> IntArray:
    return np.minimum(((angle + math.pi) * (BINS / (2.0 * math.pi))).astype(np.int64), BINS - 1)


def _reach(lengthscales: Array, amplitude: float, weights: Array) -> np.ndarray:
    """Which bins of rows (columns) matter for which bin of queries (rows), (BINS, BINS) bool.

    lengthscales: of sine and cosine of theta; weights (BINS,): sums of |alpha|."""
    edge, fine = 2.0 * math.pi / BINS, np.linspace(0.0, 1.0, 5)
    at = -math.pi + edge * (np.arange(BINS)[:, None] + fine)  # (BINS, 5): points across each bin
    points = np.stack([np.sin(at), np.cos(at)], axis=-1) / lengthscales
    # an angle is at most an eighth of a bin from one of the points: two angles may be nearer than points by twice that
    slack = 2.0 * edge / 8.0 / lengthscales.min()
    x, y = points.reshape(-1, 2).T
    square = (x[:, None] - x) ** 2 + (y[:, None] - y) ** 2  # of the distances between points
    nearest = np.maximum(np.sqrt(square.reshape(BINS, 5, BINS, 5).min(axis=(1, 3))) - slack, 0.0)
    most = amplitude**2 * np.exp(-0.5 * nearest**2) * np.maximum(nearest, 1.0) * weights[None]
    order = np.argsort(most, axis=1)
    tail = np.cumsum(np.take_along_axis(most, order, axis=1), axis=1)
    needed = np.zeros((BINS, BINS), dtype=bool)
    np.put_along_axis(needed, order, tail > TOLERANCE, axis=1)
    return needed


def _joined(needed: np.ndarray, starts: IntArray) -> list[tuple[int, int]]:
    """Ranges of rows of the bins needed, at most RANGES; the closest are joined."""
    ranges: list[tuple[int, int]] = []
    for i in np.flatnonzero(needed).tolist():
        first, last = int(starts[i]), int(starts[i + 1])
        if first == last:
            continue
        if ranges and ranges[-1][1] == first:
            ranges[-1] = (ranges[-1][0], last)
        else:
            ranges.append((first, last))
    while len(ranges) > RANGES:
        gaps = [b[0] - a[1] for a, b in pairwise(ranges)]
        i = int(np.argmin(gaps))
        ranges[i : i + 2] = [(ranges[i][0], ranges[i + 1][1])]
    return ranges


def _loop(nine: bool) -> Any:
    """The sum over rows, compiled for all nine inputs or without the cosines of the tilt (6 and 8).

    The inputs are written out: an inner loop over them would not be vectorised."""

    @njit(cache=True, error_model="numpy", fastmath=True)
    def rows(p, base, size, lo, hi, z, gradient):
        x0, x1, x2 = p[base + lo : base + hi], p[base + size + lo : base + size + hi], p[base + 2 * size + lo :]
        x3, x4, x5 = p[base + 3 * size + lo :], p[base + 4 * size + lo :], p[base + 5 * size + lo :]
        x6, x7, x8 = p[base + 6 * size + lo :], p[base + 7 * size + lo :], p[base + 8 * size + lo :]
        alpha, half = p[base + D * size + lo :], p[base + (D + 1) * size + lo :]
        z0, z1, z2, z3, z4, z5, z6, z7, z8 = z[0], z[1], z[2], z[3], z[4], z[5], z[6], z[7], z[8]
        c = -0.5 * (z0 * z0 + z1 * z1 + z2 * z2 + z3 * z3 + z4 * z4 + z5 * z5 + z6 * z6 + z7 * z7 + z8 * z8)
        total = 0.0
        g0 = g1 = g2 = g3 = g4 = g5 = g6 = g7 = g8 = 0.0
        for j in range(hi - lo):
            e = c + half[j] + x0[j] * z0 + x1[j] * z1 + x2[j] * z2 + x3[j] * z3 + x4[j] * z4
            e += x5[j] * z5 + x7[j] * z7
            if nine:
                e += x6[j] * z6 + x8[j] * z8
            v = alpha[j] * exp2_below(max(e, -1000.0))
            total += v
            g0 += v * x0[j]
            g1 += v * x1[j]
            g2 += v * x2[j]
            g3 += v * x3[j]
            g4 += v * x4[j]
            g5 += v * x5[j]
            g7 += v * x7[j]
            if nine:
                g6 += v * x6[j]
                g8 += v * x8[j]
        for d, g in enumerate((g0, g1, g2, g3, g4, g5, g6, g7, g8)):
            gradient[d] += g
        return total

    return rows


_rows, _rows_without_cosines = _loop(True), _loop(False)


@njit(**CALLEE)
def _some_rows(p, at, lo, hi, z, gradient):
    """Sum over the rows lo:hi of alpha c. Adds the sum of alpha c times the inputs to gradient (D,)."""
    base, size = at + HEAD, int(p[at + _COUNT])
    if p[at + _SCALES + 6] == math.inf and p[at + _SCALES + 8] == math.inf:
        return _rows_without_cosines(p, base, size, lo, hi, z, gradient)
    return _rows(p, base, size, lo, hi, z, gradient)


@njit(**CALLEE)
def _place(p, at, s, z):
    """Write the scaled inputs of the state s into z (D,). Returns its bin."""
    st, ct = math.sin(s[0]), math.cos(s[0])
    z[0], z[1], z[2], z[3], z[4] = s[1], s[3], s[5], st, ct
    z[5], z[6], z[7], z[8] = math.sin(s[2]), math.cos(s[2]), math.sin(s[4]), math.cos(s[4])
    for d in range(D):
        z[d] = z[d] / p[at + _SCALES + d] - p[at + _CENTRE + d]
    return min(int((math.atan2(st, ct) + math.pi) * (BINS / (2.0 * math.pi))), BINS - 1)


@njit(**CALLEE)
def _sum(p, at, s, z, gradient):
    """Sum of alpha c over the rows that matter at s. Writes scaled inputs into z (D,), sums of rows into gradient."""
    if not math.isfinite(s[0] + s[1] + s[2] + s[3] + s[4] + s[5]):  # no bin, and the sums below assume finite numbers
        gradient[:D] = math.nan
        return math.nan
    here = _place(p, at, s, z)
    gradient[:D] = 0.0
    table, total = at + _TABLE + here * (1 + 2 * RANGES), 0.0
    for r in range(int(p[table])):
        lo, hi = int(p[table + 1 + 2 * r]), int(p[table + 2 + 2 * r])
        total += _some_rows(p, at, lo, hi, z, gradient)
    return total


@njit(**CALLEE)
def _scratch(p, at):
    """Scratch space after the rows: for scaled inputs (D,), and for sums (D,)."""
    begin = at + HEAD + int(p[at + _COUNT]) * COLUMNS
    return p[begin : begin + D], p[begin + D : begin + 2 * D]


@njit(**KERNEL)
def mean_and_gradient(p, at, s, by_state):
    """Mean of g at the state s (6,); writes its derivatives by s into by_state (6,).

    The Gaussian process is packed in p from index `at` on."""
    z, gradient = _scratch(p, at)
    total = _sum(p, at, s, z, gradient)
    a2 = p[at + _AMPLITUDE]
    for d in range(D):
        gradient[d] = LN2 * a2 * (gradient[d] - total * z[d]) / p[at + _SCALES + d]
    by_state[0] = gradient[3] * math.cos(s[0]) - gradient[4] * math.sin(s[0])
    by_state[1], by_state[3], by_state[5] = gradient[0], gradient[1], gradient[2]
    by_state[2] = gradient[5] * math.cos(s[2]) - gradient[6] * math.sin(s[2])
    by_state[4] = gradient[7] * math.cos(s[4]) - gradient[8] * math.sin(s[4])
    return a2 * total


def pack_with_process(parameters: RingParameters, part: GaussianProcess) -> Array:
    """The vector of parameters of `linearise`: those of `RingParameters.pack`, then the Gaussian process."""
    return np.concatenate([parameters.pack(), pack(part)])


@njit(**KERNEL)
def linearise(s, u, p, out, A, B):
    """The state one dt later, into out (6,), and its derivatives by s and u, into A (6, 6) and B (6, 2).

    The dynamics are those of `ring_dynamics` and the Gaussian process, which is evaluated once a step, at its
    beginning, and held over the step like the command. Numba caches this function by the date of this file alone:
    change this file, too, if you change `ring_dynamics`."""
    by_state = np.empty(6)
    p[EXTRA] = mean_and_gradient(p, np.int64(p[PROCESS]), s, by_state)
    ring_dynamics.linearise(s, u, p, out, A, B)
    for j in range(6):
        A[0, j] += p[BY_ANGLE] * by_state[j]
        A[1, j] += p[BY_RATE] * by_state[j]
