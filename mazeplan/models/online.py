"""A Gaussian process that is told a few rows at a time, forgets what the rig no longer is, and never grows.

    f(x, t) = g(x, t) + phi(x) w(t)      t: when a row was measured, by a clock that runs from run to run
    cov(g(x, t), g(x', t')) = k(x, x') (1 + q m)        m = min(t, t'): what is added walks at random
    cov(w(t), w(t'))        = diag(S) m                 w(0) = 0: the walk begins at the model as it was fitted
    y = f(x, t) + e,   e ~ N(0, s^2);      C = cov of all rows + s^2 I = L L'

Rows of before and rows of now thus differ by a walk between them, and the older a row is the less it says of now; with
no rows but those of before, nothing changes. C itself does not depend on what time it is, so that its Cholesky factor
can be kept from run to run:

    rows added      L21' = L11^-1 C12,  L22 L22' = C22 - L21 L21'
    rows removed    of the rows that stay let T be the columns that stay, B those that go:
                    their factor R' has R'R = T T' + B B', by Householder's reflections of [T'; B'] (LAPACK tpqrt)

Which rows stay is decided by what f now, at places p of rows old and new, would be less sure of without them: removing
row i adds to the variance

    sum_p (K_pi)^2 / (C^-1)_ii,   K = cov(f(x_p, now), rows) C^-1

A row that others tell as well, and one that is too old to tell anything, add little. The least is removed first; that
changes K and C^-1 by one column each, that of a Cholesky factor of C^-1 pivoted the other way round. That a row is
best known from the others is not enough: samples are so noisy that many alike are needed to tell what friction is.

Rasmussen, Williams, "Gaussian Processes for Machine Learning", 2006, sections 2.2 and A.3; novelty as the reason to
keep a row: Csato, Opper, "Sparse on-line Gaussian processes", Neural Computation 14, 2002; the walk in time: Van
Vaerenbergh, Lazaro-Gredilla, Santamaria, "Kernel recursive least-squares tracker for time-varying regression", 2012.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_solve, cholesky, get_lapack_funcs, solve_triangular

from mazeplan.errors import ModelError
from mazeplan.models.gaussian_process import JITTER, GaussianProcess, Hyperparameters, kernel, prior_variance
from mazeplan.records import Array, IntArray

PROBES = 256  # places at which what is known is looked at
PANEL = 32  # columns of a reflection at a time
MORE_JITTER = (1.0, 1e2, 1e4, 1e6)  # times JITTER, tried one after the other where rounding leaves a negative pivot


@dataclass(frozen=True)
class Walk:
    """What may change in a unit of t. process: q, of the variance of g; weights (M,): deviation of each weight's step,
    square root of S, in the weight's unit."""

    process: float
    weights: Array


@dataclass(frozen=True)
class OnlineProcess:
    """Rows and the factor of their covariance. inputs (N, D), features (N, M), y (N,): what the process is to explain,
    age (N,): t of each row; factor (N, N): L."""

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
        """Without any rows; inputs: D."""
        m = len(walk.weights)
        none = np.zeros(0)
        return cls(hyper, walk, np.zeros((0, inputs)), np.zeros((0, m)), none, none, np.zeros((0, 0)))

    # -- covariance ---------------------------------------------------------------------------------------------------

    def between(
        self, inputs: Array, features: Array, age: Array, other: tuple[Array, Array, Array] | None = None
    ) -> Array:
        """Covariance of f at some places (K, ...) and at others, None: at its rows: (K, N)."""
        x, phi, t = other or (self.inputs, self.features, self.age)
        shared = np.minimum(age[:, None], t[None])
        out = kernel(inputs, x, self.hyper) * (1.0 + self.walk.process * shared)
        if len(self.walk.weights):
            out += (features * self.walk.weights**2) @ phi.T * shared
        return out

    def _jitter(self, age: Array) -> Array:
        most = max(term.amplitude for term in self.hyper.terms)
        return JITTER * most**2 * (1.0 + self.walk.process * age)

    # -- rows come and go ---------------------------------------------------------------------------------------------

    def added(self, inputs: Array, features: Array, y: Array, age: Array) -> OnlineProcess:
        """With further rows. Raises ModelError for values that are not finite and where no jitter helps."""
        if not all(np.isfinite(part).all() for part in (inputs, features, y, age)):
            raise ModelError("got a row that is not finite, expected numbers")
        if not len(y):
            return self
        n, new = len(self), (inputs, features, age)
        low = self.between(*new)
        if n:
            low = solve_triangular(self.factor, low.T, lower=True, check_finite=False).T
        own = self.between(*new, new)
        own[np.diag_indices(len(y))] += self.hyper.noise**2 + self._jitter(age)
        corner = _factor(own - low @ low.T, self._jitter(age))
        factor = np.zeros((n + len(y), n + len(y)))
        factor[:n, :n], factor[n:, :n], factor[n:, n:] = self.factor, low, corner
        x, phi = np.concatenate([self.inputs, inputs]), np.concatenate([self.features, features])
        both, ages = np.concatenate([self.y, y]), np.concatenate([self.age, age])
        return OnlineProcess(self.hyper, self.walk, x, phi, both, ages, factor)

    def removed(self, rows: IntArray) -> OnlineProcess:
        """Without some rows (indices)."""
        stay = np.setdiff1d(np.arange(len(self)), rows)
        first = int(np.min(rows, initial=len(self)))
        factor = np.tril(self.factor[np.ix_(stay, stay)])
        tail = factor[first:, first:]
        gone = self.factor[np.ix_(stay[first:], np.setdiff1d(rows, stay))]
        if len(tail) and gone.shape[1]:  # what is before the first of them does not change
            factor[first:, first:] = _taken_in(tail, gone)
        kept = replace(self, inputs=self.inputs[stay], features=self.features[stay], factor=factor)
        return replace(kept, y=self.y[stay], age=self.age[stay])

    def within(self, most: int, now: float, score: Score | None = None) -> OnlineProcess:
        """At most so many rows: those that tell least of now are removed, by `score` (None: `novelty`)."""
        if len(self) <= most:
            return self
        return self.removed((score or novelty)(self, len(self) - most, now))

    # -- what it says ------------------------------------------------------------------------------------------------

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
        """g as it is now: a plain process for who plans, its mean alone (the factor is left out)."""
        alpha = self.alpha * (1.0 + self.walk.process * np.minimum(self.age, now))
        plain, none = replace(self.hyper, weight_sigma=np.zeros(0)), np.zeros((0, 0))
        if not np.isfinite(alpha).all():
            raise ModelError("the process came out as no number")
        return GaussianProcess(plain, self.inputs, np.zeros((len(self), 0)), alpha, np.zeros(0), none, none)

    def predict(self, inputs: Array, features: Array, now: float) -> tuple[Array, Array]:
        """Mean and variance of f (N,) at rows measured now, without the noise of a sample."""
        age = np.full(len(inputs), float(now))
        prior = prior_variance(inputs, self.hyper) * (1.0 + self.walk.process * now)
        prior = prior + now * np.sum((features * self.walk.weights) ** 2, axis=1)
        if not len(self):
            return np.zeros(len(inputs)), prior
        cross = self.between(inputs, features, age)
        half = solve_triangular(self.factor, cross.T, lower=True, check_finite=False)
        return cross @ self.alpha, np.maximum(prior - np.sum(half**2, axis=0), 0.0)

    def evidence(self, inputs: Array, features: Array, y: Array, age: Array) -> float:
        """Log likelihood of further rows, given all that are here."""
        cross, own = self.between(inputs, features, age), self.between(inputs, features, age, (inputs, features, age))
        own[np.diag_indices(len(y))] += self.hyper.noise**2 + self._jitter(age)
        left = y
        if len(self):
            half = solve_triangular(self.factor, cross.T, lower=True, check_finite=False)
            own, left = own - half.T @ half, y - cross @ self.alpha
        factor = _factor(own, self._jitter(age))
        off = solve_triangular(factor, left, lower=True, check_finite=False)
        log_det = 2.0 * float(np.sum(np.log(np.diag(factor))))
        return -0.5 * (float(off @ off) + log_det + len(y) * float(np.log(2.0 * np.pi)))


Score = Callable[[OnlineProcess, int, float], IntArray]  # (rows, how many must go, now) -> which


def novelty(rows: OnlineProcess, count: int, now: float) -> IntArray:
    """The `count` rows without which f is known best now, one after the other, as the module has it."""
    at = np.unique(np.linspace(0, len(rows) - 1, min(PROBES, len(rows))).astype(np.int64))
    tells = rows.between(rows.inputs[at], rows.features[at], np.full(len(at), float(now)))
    inverse = rows.inverse()
    tells, left = tells @ inverse, np.diag(inverse).copy()
    done, taken, gone = np.zeros((count, len(rows))), np.zeros(count, dtype=np.int64), np.zeros(len(rows), dtype=bool)
    for k in range(count):
        i = int(np.argmin(np.where(gone, np.inf, np.einsum("ij,ij->j", tells, tells) / left)))
        column = (inverse[i] - done[:k, i] @ done[:k]) / np.sqrt(left[i])
        tells = tells - np.outer(tells[:, i] / np.sqrt(left[i]), column)
        taken[k], gone[i], done[k] = i, True, column
        # never below what rounding may turn round
        left = np.maximum(left - np.where(gone, 0.0, column**2), np.finfo(float).tiny)
    return taken


def information(rows: OnlineProcess, count: int, now: float) -> IntArray:
    """Those that are best known from the others, whatever their age: what a row alone tells of itself is least."""
    return np.argsort(-np.diag(rows.inverse()), kind="stable")[:count]


def influence(rows: OnlineProcess, count: int, now: float) -> IntArray:
    """Those without which the mean at their own place changes least: |alpha_i| / (C^-1)_ii, Csato and Opper's score."""
    change = np.abs(rows.alpha) / np.diag(rows.inverse())
    return np.argsort(change, kind="stable")[:count]


def oldest(rows: OnlineProcess, count: int, now: float) -> IntArray:
    """The oldest, of one age the first."""
    return np.argsort(rows.age, kind="stable")[:count]


def at_random(rows: OnlineProcess, count: int, now: float) -> IntArray:
    """Any of them, drawn anew in each run."""
    rng = np.random.default_rng([len(rows), int(now)])
    return rng.choice(len(rows), count, replace=False)


SCORES: dict[str, Score] = {
    "novelty": novelty, "information": information, "influence": influence, "oldest": oldest, "random": at_random,
}  # fmt: skip


def _factor(C: Array, jitter: Array) -> Array:
    """The lower Cholesky factor of C (K, K), with more jitter on the diagonal where rounding asks for it."""
    for more in MORE_JITTER:
        try:
            return cholesky(C, lower=True)
        except np.linalg.LinAlgError:
            C = C + np.diag(more * jitter)
    raise ModelError("the covariance of the new rows is not positive definite")


def _taken_in(T: Array, B: Array) -> Array:
    """The lower factor of T T' + B B', T (N, N) a lower factor, B (N, K)."""
    n = len(T)
    (tpqrt,) = get_lapack_funcs(("tpqrt",), (T, B))
    upper, _, _, _ = tpqrt(0, min(PANEL, n), np.asfortranarray(T.T), np.asfortranarray(B.T))
    factor = np.tril(np.triu(upper).T)
    return factor * np.where(np.diag(factor) < 0.0, -1.0, 1.0)[None]
