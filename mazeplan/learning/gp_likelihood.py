"""Log marginal likelihood of a Gaussian process and its derivatives by the hyperparameters, compiled.

    L = -y' C^-1 y / 2 - log det C / 2 - n log(2 pi) / 2
    dL/dp = sum_ij W_ij dC_ij/dp,   W = (a a' - C^-1) / 2,   a = C^-1 y

Rasmussen, Williams, "Gaussian Processes for Machine Learning", 2006, section 5.4.1. Exact, by Cholesky. Automatic
differentiation through the factor takes five times as long.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.linalg import get_lapack_funcs

from mazeplan.core.errors import ModelError
from mazeplan.core.maths.exponential import exp_below
from mazeplan.core.records import Array
from mazeplan.learning.gaussian_process import Hyperparameters, add, squares

TINY = 1e-150  # minimum divisor r of a slope


@dataclass(frozen=True)
class Slopes:
    """Derivatives of the log likelihood.

    lengthscales:    by the length scales, an array (C,) for each term
    variances (T,):  by amplitude^2 of each term
    weights (M,):    by the variances of the weights
    noise:           by the noise variance"""

    lengthscales: tuple[Array, ...]
    variances: Array
    weights: Array
    noise: float


def log_likelihood(h: Hyperparameters, inputs: Array, features: Array, y: Array) -> tuple[float, Slopes]:
    """Value and derivatives for inputs (N, D), features (N, M) and values y (N,).

    Raises ModelError if the covariance is not positive definite."""
    n, rbf = len(y), h.family == "rbf"
    wide = np.ascontiguousarray(features * h.weight_sigma)
    C = (wide @ wide.T).T  # in LAPACK's order; it is symmetric
    C[np.diag_indices(n)] += h.noise**2
    pairs = [term.scaled(inputs, inputs) for term in h.terms]
    for term, (x, others) in zip(h.terms, pairs, strict=True):
        for sign, z in others:
            add(x, z, sign * term.amplitude**2, rbf, True, C.T)
    potrf, potrs, potri = get_lapack_funcs(("potrf", "potrs", "potri"), (C,))
    factor, info = potrf(C, lower=0, overwrite_a=1)
    if info:
        raise ModelError("the covariance of the training rows is not positive definite")
    a, _ = potrs(factor, y, lower=0)
    log_det = 2.0 * float(np.sum(np.log(np.diag(factor))))
    value = -0.5 * (float(y @ a) + log_det + n * math.log(2.0 * math.pi))
    inverse, _ = potri(factor, lower=0, overwrite_c=1)
    W = inverse.T  # rows of its lower triangle
    _weigh(a, W)
    lengths, variances = [], np.zeros(len(h.terms))
    for t, (term, (x, others)) in enumerate(zip(h.terms, pairs, strict=True)):
        by = np.zeros(1 + len(x))
        for sign, z in others:
            _project(x, z, sign, rbf, W, by)
        variances[t] = by[0]
        lengths.append(term.amplitude**2 * by[1:] / term.lengthscales)
    by_weight = np.array([_quadratic(W, np.ascontiguousarray(column)) for column in features.T])
    return value, Slopes(tuple(lengths), variances, by_weight, float(np.trace(W)))


@njit(cache=True, error_model="numpy", fastmath=True)
def _weigh(a, W):
    """Turn the lower triangle W of C^-1 into that of (a a' - C^-1) / 2, with elements off the diagonal doubled."""
    for i in range(len(a)):
        row = W[i]
        for j in range(i):
            row[j] = a[i] * a[j] - row[j]
        row[i] = 0.5 * (a[i] * a[i] - row[i])


@njit(cache=True, error_model="numpy", fastmath=True)
def _project(x, z, sign, rbf, W, out):
    """Add sign sum W c to out[0], sign sum W dc/dlog(l_d) to out[1 + d]."""
    n = len(W)
    gaps, part = np.empty(n), np.empty(n)
    for i in range(n):
        squares(x, z, i, i + 1, gaps)
        row, total = W[i], 0.0
        if rbf:
            for j in range(i + 1):
                part[j] = row[j] * exp_below(max(-0.5 * gaps[j], -700.0))
                total += part[j]
        else:
            for j in range(i + 1):
                r = math.sqrt(gaps[j])
                c = row[j] * exp_below(max(-r, -700.0))
                total += c
                part[j] = c / max(r, TINY)
        out[0] += sign * total
        for d in range(len(x)):
            column, here, along = z[d], x[d, i], 0.0
            for j in range(i + 1):
                gap = here - column[j]
                along += part[j] * gap * gap
            out[1 + d] += sign * along


@njit(cache=True, error_model="numpy", fastmath=True)
def _quadratic(W, phi):
    """Sum of W phi phi' over the lower triangle."""
    total = 0.0
    for i in range(len(phi)):
        row, along = W[i], 0.0
        for j in range(i + 1):
            along += row[j] * phi[j]
        total += phi[i] * along
    return total
