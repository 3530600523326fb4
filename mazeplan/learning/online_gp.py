"""An online Gaussian process: it takes a few rows at a time, forgets old ones, and keeps a bounded number of rows.

    f(x, t) = g(x, t) + phi(x) w(t)      t: time of a row, by a clock that advances from run to run
    cov(g(x, t), g(x', t')) = k(x, x') (1 + q m)        m = min(t, t'): the changes are a random walk
    cov(w(t), w(t'))        = diag(S) m                 w(0) = 0: the walk begins at the fitted model
    y = f(x, t) + e,   e ~ N(0, s^2);      C = cov of all rows + s^2 I = L L'

So old rows count less. Without new rows nothing changes. C does not depend on the present time, so its Cholesky factor
is updated from run to run:

    rows added      L21' = L11^-1 C12,  L22 L22' = C22 - L21 L21'
    rows removed    In the remaining rows of L, T has the columns that stay and B those that go. The new factor R' has
                    R'R = T T' + B B', by Householder's reflections of [T'; B'] (LAPACK tpqrt)

`novelty` chooses the rows to remove: those whose loss adds least to the variance of f now, at places p of old and new
rows. Removing row i adds

    sum_p (K_pi)^2 / (C^-1)_ii,   K = cov(f(x_p, now), rows) C^-1

Rows are removed one after the other; each changes K and C^-1 by one column. A row is still needed if the others predict
it well: samples are noisy, and an estimate of friction needs many similar samples.

Rasmussen, Williams, "Gaussian Processes for Machine Learning", 2006, sections 2.2 and A.3; novelty: Csato, Opper,
"Sparse on-line Gaussian processes", Neural Computation 14, 2002; the walk in time: Van Vaerenbergh, Lazaro-Gredilla,
Santamaria, "Kernel recursive least-squares tracker for time-varying regression", 2012.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_solve, cholesky, get_lapack_funcs, solve_triangular

from mazeplan.core.errors import ModelError
from mazeplan.core.records import Array, IntArray
from mazeplan.learning.gaussian_process import JITTER, GaussianProcess, Hyperparameters, kernel, prior_variance

PROBES = 256  # places p of the variance
PANEL = 32  # columns of a reflection at a time
MORE_JITTER = (1.0, 1e2, 1e4, 1e6)  # times JITTER, tried in turn against negative pivots by rounding


@dataclass(frozen=True)
class Walk:
    """Random walk in a unit of t.

    process:       q, relative growth of the variance of g
    weights (M,):  standard deviations of the weights, the roots of S"""

    process: float
    weights: Array


@dataclass(frozen=True)
class OnlineProcess:
    """N rows and the Cholesky factor of their covariance.

    inputs (N, D), features (N, M), y (N,):  the rows
    age (N,):                                t of each row
    factor (N, N):                           L"""

    hyper: Hyperparameters
    walk: Walk
    inputs: Array
    features: Array
    y: Array
    age: Array
    factor: Array

    def __len__(self) -> int:
        return len(self.y)

    @classmethod
    def begin(cls, hyper: Hyperparameters, walk: Walk, inputs: int = 9) -> OnlineProcess:
        """An online Gaussian process without rows; inputs: D."""
        m = len(walk.weights)
        none = np.zeros(0)
        return cls(hyper, walk, np.zeros((0, inputs)), np.zeros((0, m)), none, none, np.zeros((0, 0)))

    def cross_covariance(
        self, inputs: Array, features: Array, age: Array, other: tuple[Array, Array, Array] | None = None
    ) -> Array:
        """Covariance (K, N) of f between K places and other places.

        other: inputs, features and age of N other places; None: the rows."""
        x, phi, t = other or (self.inputs, self.features, self.age)
        shared = np.minimum(age[:, None], t[None])
        out = kernel(inputs, x, self.hyper) * (1.0 + self.walk.process * shared)
        if len(self.walk.weights):
            out += (features * self.walk.weights**2) @ phi.T * shared
        return out

    def _jitter(self, age: Array) -> Array:
        most = max(term.amplitude for term in self.hyper.terms)
        return JITTER * most**2 * (1.0 + self.walk.process * age)

    def added(self, inputs: Array, features: Array, y: Array, age: Array) -> OnlineProcess:
        """A copy with additional rows. Raises ModelError for values that are not finite, or if no jitter helps."""
        if not all(np.isfinite(part).all() for part in (inputs, features, y, age)):
            raise ModelError("got a row that is not finite, expected numbers")
        if not len(y):
            return self
        n, new = len(self), (inputs, features, age)
        low = self.cross_covariance(*new)
        if n:
            low = solve_triangular(self.factor, low.T, lower=True, check_finite=False).T
        own = self.cross_covariance(*new, new)
        own[np.diag_indices(len(y))] += self.hyper.noise**2 + self._jitter(age)
        corner = _factor(own - low @ low.T, self._jitter(age))
        factor = np.zeros((n + len(y), n + len(y)))
        factor[:n, :n], factor[n:, :n], factor[n:, n:] = self.factor, low, corner
        x, phi = np.concatenate([self.inputs, inputs]), np.concatenate([self.features, features])
        both, ages = np.concatenate([self.y, y]), np.concatenate([self.age, age])
        return OnlineProcess(self.hyper, self.walk, x, phi, both, ages, factor)

    def removed(self, rows: IntArray) -> OnlineProcess:
        """A copy without some rows (indices)."""
        stay = np.setdiff1d(np.arange(len(self)), rows)
        first = int(np.min(rows, initial=len(self)))
        factor = np.tril(self.factor[np.ix_(stay, stay)])
        tail = factor[first:, first:]
        gone = self.factor[np.ix_(stay[first:], np.setdiff1d(rows, stay))]
        if len(tail) and gone.shape[1]:  # the part before the first removed row stays
            factor[first:, first:] = _cholesky_update(tail, gone)
        kept = replace(self, inputs=self.inputs[stay], features=self.features[stay], factor=factor)
        return replace(kept, y=self.y[stay], age=self.age[stay])

    def within(self, most: int, now: float, keep: str = "novelty") -> OnlineProcess:
        """A copy with at most `most` rows. keep: name in `RULES` of the rule that chooses the rows to remove."""
        return self if len(self) <= most else self.removed(RULES[keep](self, len(self) - most, now))

    @property
    def alpha(self) -> Array:
        """C^-1 y (N,)."""
        return np.asarray(cho_solve((self.factor, True), self.y, check_finite=False)) if len(self) else np.zeros(0)

    def inverse(self) -> Array:
        """C^-1 (N, N)."""
        (potri,) = get_lapack_funcs(("potri",), (self.factor,))
        found, _ = potri(self.factor, lower=1)
        return np.tril(found) + np.tril(found, -1).T

    def weights(self, now: float) -> tuple[Array, Array]:
        """E[w(now)] (M,) and its covariance (M, M), given all rows."""
        S = self.walk.weights**2
        back = S[:, None] * (self.features * np.minimum(self.age, now)[:, None]).T  # (M, N)
        if not len(self):
            return np.zeros(len(S)), np.diag(S * now)
        half = solve_triangular(self.factor, back.T, lower=True, check_finite=False)
        return back @ self.alpha, np.diag(S * now) - half.T @ half

    def process(self, now: float) -> GaussianProcess:
        """The mean of g now, as a plain Gaussian process for the planner. Raises ModelError if it is not finite."""
        alpha = self.alpha * (1.0 + self.walk.process * np.minimum(self.age, now))
        if not np.isfinite(alpha).all():
            raise ModelError("the process is not finite")
        return GaussianProcess.mean_only(replace(self.hyper, weight_sigma=np.zeros(0)), self.inputs, alpha)

    def predict(self, inputs: Array, features: Array, now: float) -> tuple[Array, Array]:
        """Mean and variance (N,) of f at rows measured now, without the noise of a sample."""
        age = np.full(len(inputs), float(now))
        prior = prior_variance(inputs, self.hyper) * (1.0 + self.walk.process * now)
        prior = prior + now * np.sum((features * self.walk.weights) ** 2, axis=1)
        if not len(self):
            return np.zeros(len(inputs)), prior
        cross = self.cross_covariance(inputs, features, age)
        half = solve_triangular(self.factor, cross.T, lower=True, check_finite=False)
        return cross @ self.alpha, np.maximum(prior - np.sum(half**2, axis=0), 0.0)

    def evidence(self, inputs: Array, features: Array, y: Array, age: Array) -> float:
        """Log likelihood of additional rows, given the present rows."""
        cross = self.cross_covariance(inputs, features, age)
        own = self.cross_covariance(inputs, features, age, (inputs, features, age))
        own[np.diag_indices(len(y))] += self.hyper.noise**2 + self._jitter(age)
        left = y
        if len(self):
            half = solve_triangular(self.factor, cross.T, lower=True, check_finite=False)
            own, left = own - half.T @ half, y - cross @ self.alpha
        factor = _factor(own, self._jitter(age))
        off = solve_triangular(factor, left, lower=True, check_finite=False)
        log_det = 2.0 * float(np.sum(np.log(np.diag(factor))))
        return -0.5 * (float(off @ off) + log_det + len(y) * float(np.log(2.0 * np.pi)))


def novelty(rows: OnlineProcess, count: int, now: float) -> IntArray:
    """The `count` rows whose loss adds least to the variance of f now, in order of removal."""
    at = np.unique(np.linspace(0, len(rows) - 1, min(PROBES, len(rows))).astype(np.int64))
    effect = rows.cross_covariance(rows.inputs[at], rows.features[at], np.full(len(at), float(now)))
    inverse = rows.inverse()
    effect, left = effect @ inverse, np.diag(inverse).copy()
    done, taken, gone = np.zeros((count, len(rows))), np.zeros(count, dtype=np.int64), np.zeros(len(rows), dtype=bool)
    for k in range(count):
        i = int(np.argmin(np.where(gone, np.inf, np.einsum("ij,ij->j", effect, effect) / left)))
        column = (inverse[i] - done[:k, i] @ done[:k]) / np.sqrt(left[i])
        effect = effect - np.outer(effect[:, i] / np.sqrt(left[i]), column)
        taken[k], gone[i], done[k] = i, True, column
        left = np.maximum(left - np.where(gone, 0.0, column**2), np.finfo(float).tiny)  # > 0 despite rounding
    return taken


def oldest(rows: OnlineProcess, count: int, now: float) -> IntArray:
    """The `count` oldest rows; among rows of the same age, the first."""
    return np.argsort(rows.age, kind="stable")[:count]


RULES: dict[str, Callable[[OnlineProcess, int, float], IntArray]] = {"novelty": novelty, "oldest": oldest}


def _factor(C: Array, jitter: Array) -> Array:
    """The lower Cholesky factor of C (K, K), with more jitter on the diagonal if needed. Raises ModelError."""
    for more in MORE_JITTER:
        try:
            return cholesky(C, lower=True)
        except np.linalg.LinAlgError:
            C = C + np.diag(more * jitter)
    raise ModelError("the covariance of the new rows is not positive definite")


def _cholesky_update(T: Array, B: Array) -> Array:
    """The lower Cholesky factor of T T' + B B', for a lower factor T (N, N) and B (N, K)."""
    n = len(T)
    (tpqrt,) = get_lapack_funcs(("tpqrt",), (T, B))
    upper, _, _, _ = tpqrt(0, min(PANEL, n), np.asfortranarray(T.T), np.asfortranarray(B.T))
    factor = np.tril(np.triu(upper).T)
    return factor * np.where(np.diag(factor) < 0.0, -1.0, 1.0)[None]
