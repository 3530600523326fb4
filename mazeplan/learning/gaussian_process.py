"""Exact Gaussian-process regression by Cholesky.

    y = phi(x) w + g(x) + e,   w ~ N(0, S) with S diagonal,   g ~ GP(0, k),   e ~ N(0, s^2), or one s for each row
    k(x, x') = sum of a^2 c(r),    r^2 = sum_d ((x_d - x'_d) / l_d)^2 over the columns of a term
    c(r) = exp(-r^2 / 2)      rbf: smooth
    c(r) = exp(-r)            exponential: continuous but rough, like forces at the edges of openings

Given y, with C = K + s^2 I:

    E[w] = S Phi' (C + Phi S Phi')^-1 y,   E[g(x)] = k(x, X) alpha,   alpha = C^-1 (y - Phi E[w])

Rasmussen, Williams, "Gaussian Processes for Machine Learning", 2006, sections 2.2 and 2.7. `gp_training` finds the
hyperparameters; `fast_gp` is the compiled predictor for control.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from mazeplan.core.errors import ModelError
from mazeplan.core.maths.exponential import exp_below
from mazeplan.core.records import Array

FAMILIES = ("rbf", "exponential")
BATCH = 512  # rows predicted at a time, to limit the memory
JITTER = 1e-10  # of amplitude^2, added to the diagonal against rounding


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
    """Add scale c(r) to C (N, K), or to its lower triangle; row by row, so that no second matrix is needed."""
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


@dataclass(frozen=True)
class KernelTerm:
    """One term of the kernel.

    columns:            the C inputs on which the term depends
    lengthscales (C,):  in the units of these inputs
    amplitude:          a, in units of y
    flip (C,):          1 or -1 for each column: makes the term odd under this reflection F,
                        a^2 (c(x, x') - c(x, F x')); empty for an ordinary term"""

    columns: tuple[int, ...]
    lengthscales: Array
    amplitude: float
    flip: tuple[float, ...] = ()

    def scaled(self, a: Array, b: Array) -> tuple[Array, list[tuple[float, Array]]]:
        """Scaled columns (C, N) of a (N, D); and, for b (K, D), pairs of a sign and scaled columns (C, K)."""
        x, z = (np.ascontiguousarray((rows[:, self.columns] / self.lengthscales).T) for rows in (a, b))
        return x, [(1.0, z), *([(-1.0, z * np.array(self.flip)[:, None])] if self.flip else [])]


@dataclass(frozen=True)
class Hyperparameters:
    """Hyperparameters of a Gaussian process. Raises ModelError for other numbers than finite ones > 0.

    terms:              terms of the kernel
    noise:              s, in units of y
    weight_sigma (M,):  square roots of S
    family:             correlation function of all terms: rbf or exponential"""

    terms: tuple[KernelTerm, ...]
    noise: float
    weight_sigma: Array
    family: str = "rbf"

    def __post_init__(self) -> None:
        positive = [self.noise, *(value for term in self.terms for value in (term.amplitude, *term.lengthscales))]
        if not (np.isfinite(positive).all() and min(positive) > 0.0 and self.family in FAMILIES):
            raise ModelError(f"expected finite numbers > 0, and the family {' or '.join(FAMILIES)}", key="kernel")

    @property
    def only(self) -> KernelTerm:
        """The single ordinary term. Raises ModelError for any other kernel."""
        if len(self.terms) != 1 or self.terms[0].flip:
            raise ModelError(f"got {len(self.terms)} terms, expected a plain kernel", key="kernel")
        return self.terms[0]


def kernel(a: Array, b: Array, h: Hyperparameters) -> Array:
    """k between inputs (N, D) and (K, D): (N, K)."""
    total = np.zeros((len(a), len(b)))
    _add_terms(a, b, h, False, total)
    return total


def _add_terms(a: Array, b: Array, h: Hyperparameters, lower: bool, C: Array) -> None:
    for term in h.terms:
        x, others = term.scaled(a, b)
        for sign, z in others:
            add(x, z, sign * term.amplitude**2, h.family == "rbf", lower, C)


@dataclass(frozen=True, eq=False)
class GaussianProcess:
    """A conditioned Gaussian process.

    inputs (N, D), features (N, M):  training rows
    alpha (N,):                      see above
    weights (M,):                    E[w]
    covariance (M, M):               of the weights"""

    hyper: Hyperparameters
    inputs: Array
    features: Array
    alpha: Array
    weights: Array
    covariance: Array

    def __len__(self) -> int:
        return len(self.alpha)

    @classmethod
    def condition(
        cls, hyper: Hyperparameters, inputs: Array, features: Array, y: Array, noise: Array | None = None
    ) -> GaussianProcess:
        """Condition on y (N,) at inputs (N, D) with features (N, M); M may be 0.

        noise (N,): standard deviation of each row; default: that of the hyperparameters. Raises ModelError if the
        covariance is not positive definite."""
        from scipy.linalg import cho_solve, cholesky  # slow to import; no run needs it

        n, S = len(y), hyper.weight_sigma**2
        C = (features * S) @ features.T  # only its lower triangle counts
        _add_terms(inputs, inputs, hyper, True, C)
        deviation, most = hyper.noise if noise is None else noise, max(term.amplitude for term in hyper.terms)
        C[np.diag_indices(n)] += deviation**2 + JITTER * most**2
        try:  # C.T is in LAPACK's order, so no copy is made
            factor = cholesky(C.T, lower=False, overwrite_a=True)
        except np.linalg.LinAlgError:
            raise ModelError("the covariance of the training rows is not positive definite") from None
        back = S[:, None] * features.T
        gain = cho_solve((factor, False), back.T)  # (N, M)
        weights = gain.T @ y
        covariance = np.diag(S) - back @ gain
        alpha = cho_solve((factor, False), y)  # = C^-1 (y - Phi w), by the matrix inversion lemma
        return cls(hyper, inputs, features, alpha, weights, covariance)

    def mean(self, inputs: Array, features: Array | None = None) -> Array:
        """E[f] (N,) at inputs (N, D); E[g] if no features are given."""
        parts = [inputs[i : i + BATCH] for i in range(0, len(inputs), BATCH)] or [inputs]
        out = np.concatenate([kernel(part, self.inputs, self.hyper) @ self.alpha for part in parts])
        return out if features is None else out + features @ self.weights
