"""Sums of kernels between rows, compiled: row by row, so that nothing as large as the matrix is needed beside it."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from mazeplan.maths.exponential import exp_below


@njit(cache=True, error_model="numpy", fastmath=True)
def squares(x, z, i, count, out):
    """|x_i - z_j|^2 of scaled columns x (C, N), z (C, K) for the first `count` j."""
    out[:count] = 0.0
    for d in range(len(x)):
        row, here = z[d], x[d, i]
        for j in range(count):
            gap = here - row[j]
            out[j] += gap * gap


@njit(cache=True, error_model="numpy", fastmath=True)
def add(x, z, scale, rbf, lower, C):
    """Add scale c(r) to C (N, K), or, if so asked, to its lower triangle alone."""
    gaps = np.empty(C.shape[1])
    for i in range(len(C)):
        count = i + 1 if lower else C.shape[1]
        squares(x, z, i, count, gaps)
        row = C[i]
        if rbf:
            for j in range(count):
                row[j] += scale * exp_below(max(-0.5 * gaps[j], -700.0))
        else:
            for j in range(count):
                row[j] += scale * exp_below(max(-math.sqrt(gaps[j]), -700.0))
