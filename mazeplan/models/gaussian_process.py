"""Exact Gaussian-process regression, conditioned by Cholesky: mean, variance, derivatives.

    f(x) = phi(x) w + g(x),   w ~ N(0, S),   g ~ GP(0, k),   k(x, x') = sum of a^2 c(r)
    r^2 = sum_d ((x_d - x'_d) / l_d)^2 over the columns of a term
    y = f(x) + e,             e ~ N(0, s^2), or with an s of each row's own
    c(r) = exp(-r^2 / 2)      rbf: smooth
    c(r) = exp(-r)            exponential: continuous but rough, as forces at the edges of openings are

S diagonal; without features only g remains. Given y, with C = K + s^2 I:

    E[w] = S Phi' (C + Phi S Phi')^-1 y,   E[g(x)] = k(x, X) alpha,   alpha = C^-1 (y - Phi E[w])

Rasmussen, Williams, "Gaussian Processes for Machine Learning", 2006, sections 2.2 and 2.7. Hyperparameters come from
`gp_training`; the compiled predictor for control is `fast_gp`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular

from mazeplan.errors import ModelError
from mazeplan.models.covariance import add
from mazeplan.records import Array

FAMILIES = ("rbf", "exponential")
BATCH = 512  # rows predicted at a time, so that memory stays small
NEAR = 1e-9  # r below which two inputs are the same
JITTER = 1e-10  # of amplitude^2, on the diagonal: rounding alone must not make a covariance indefinite


@dataclass(frozen=True)
class Term:
    """One part of the kernel. columns: of the inputs it looks at, with lengthscales (C,) in their units; amplitude in
    units of y; flip (C,) of 1 and -1, or none: the part is odd under it, a^2 (c(x, x') - c(x, F x'))."""

    columns: tuple[int, ...]
    lengthscales: Array
    amplitude: float
    flip: tuple[float, ...] = ()

    def scaled(self, a: Array, b: Array) -> tuple[Array, list[tuple[float, Array]]]:
        """Of inputs a (N, D) and b (K, D) the columns over their lengthscales (C, N), and with which sign they are
        compared with what (C, K): as it stands, and turned round where there is a flip."""
        x, z = (np.ascontiguousarray((rows[:, self.columns] / self.lengthscales).T) for rows in (a, b))
        return x, [(1.0, z), *([(-1.0, z * np.array(self.flip)[:, None])] if self.flip else [])]

    def squares(self, a: Array, b: Array) -> Array:
        """r^2 between inputs (N, D) and (K, D), which are already those of the columns: (N, K)."""
        u, v = a / self.lengthscales, b / self.lengthscales
        middle = v.mean(axis=0)  # differences of squares lose no digits near it
        u, v = u - middle, v - middle
        return np.maximum(np.sum(u**2, axis=1)[:, None] + np.sum(v**2, axis=1)[None] - 2.0 * u @ v.T, 0.0)


@dataclass(frozen=True)
class Hyperparameters:
    """terms of the kernel; noise s in units of y; weight_sigma (M,): square roots of S, empty without features; family:
    of all terms. Raises ModelError for numbers that are not positive and finite."""

    terms: tuple[Term, ...]
    noise: float
    weight_sigma: Array
    family: str = "rbf"

    def __post_init__(self) -> None:
        scales = [("lengthscales", np.concatenate([term.lengthscales for term in self.terms]))]
        scales += [("amplitude", np.array([term.amplitude for term in self.terms])), ("noise", np.array([self.noise]))]
        for name, values in (*scales, ("weight_sigma", np.asarray(self.weight_sigma))):
            least = 0.0 if name == "weight_sigma" else np.nextafter(0.0, 1.0)
            if not (np.isfinite(values).all() and (values >= least).all()):
                raise ModelError("got a number that is not finite and positive", key=name)
        if self.family not in FAMILIES:
            raise ModelError(f"got {self.family!r}, expected one of {', '.join(FAMILIES)}", key="family")

    @classmethod
    def plain(
        cls, lengthscales: Array, amplitude: float, noise: float, weight_sigma: Array | None = None, family: str = "rbf"
    ) -> Hyperparameters:
        """One term that looks at all inputs."""
        term = Term(tuple(range(len(lengthscales))), lengthscales, amplitude)
        return cls((term,), noise, np.zeros(0) if weight_sigma is None else weight_sigma, family)

    @property
    def only(self) -> Term:
        """The one term; raises ModelError where there are more, or an odd one."""
        if len(self.terms) != 1 or self.terms[0].flip:
            raise ModelError(f"got {len(self.terms)} terms, expected a plain kernel", key="kernel")
        return self.terms[0]


def kernel(a: Array, b: Array, h: Hyperparameters) -> Array:
    """k between inputs (N, D) and (K, D): (N, K)."""
    total = np.zeros((len(a), len(b)))
    _add(a, b, h, False, total)
    return total


def _add(a: Array, b: Array, h: Hyperparameters, lower: bool, C: Array) -> None:
    """Add k to C (N, K), or to its lower triangle alone."""
    for term in h.terms:
        x, others = term.scaled(a, b)
        for sign, z in others:
            add(x, z, sign * term.amplitude**2, h.family == "rbf", lower, C)


def _shape(squares: Array, family: str) -> Array:
    """c(r) from r^2."""
    return np.exp(-0.5 * squares if family == "rbf" else -np.sqrt(squares))


def prior_variance(inputs: Array, h: Hyperparameters) -> Array:
    """k(x, x) (N,)."""
    out = np.full(len(inputs), sum(term.amplitude**2 for term in h.terms))
    for term in h.terms:
        if term.flip:
            x = inputs[:, term.columns] / term.lengthscales
            gap = np.sum((x * (1.0 - np.array(term.flip))) ** 2, axis=1)
            out -= term.amplitude**2 * _shape(gap, h.family)
    return out


@dataclass(frozen=True, eq=False)
class GaussianProcess:
    """A conditioned process, equal to itself only. inputs (N, D), features (N, M) of the training rows; alpha (N,);
    weights (M,) with covariance (M, M)."""

    hyper: Hyperparameters
    inputs: Array
    features: Array
    alpha: Array
    weights: Array
    covariance: Array
    factor: Array  # lower triangle of the Cholesky factor of C + Phi S Phi'; empty when only the mean is wanted

    def __len__(self) -> int:
        return len(self.alpha)

    @classmethod
    def condition(
        cls, hyper: Hyperparameters, inputs: Array, features: Array, y: Array, noise: Array | None = None
    ) -> GaussianProcess:
        """The process given y (N,) at inputs (N, D) with features (N, M), M may be 0; noise: standard deviation of each
        row's (N,), units of y, where it is not that of the hyperparameters. Raises ModelError when the covariance is
        not positive definite."""
        n, S = len(y), hyper.weight_sigma**2
        if not (len(inputs) == len(features) == n and features.shape[1] == len(S)):
            raise ModelError(f"got {len(inputs)} inputs, {len(features)} x {features.shape[1]} features for {n} values")
        C = (features * S) @ features.T  # only its lower triangle counts
        _add(inputs, inputs, hyper, True, C)
        deviation, most = hyper.noise if noise is None else noise, max(term.amplitude for term in hyper.terms)
        C[np.diag_indices(n)] += deviation**2 + JITTER * most**2
        try:  # by columns, as LAPACK has it, it is the upper one, and no copy is made
            factor = cholesky(C.T, lower=False, overwrite_a=True)
        except np.linalg.LinAlgError:
            raise ModelError("the covariance of the training rows is not positive definite") from None
        back = S[:, None] * features.T
        gain = cho_solve((factor, False), back.T)  # (N, M)
        weights = gain.T @ y
        covariance = np.diag(S) - back @ gain
        alpha = cho_solve((factor, False), y)  # = C^-1 (y - Phi w), by the matrix inversion lemma
        return cls(hyper, inputs, features, alpha, weights, covariance, factor.T)

    def mean(self, inputs: Array, features: Array | None = None) -> Array:
        """E[f] (N,) at inputs (N, D); of g alone without features."""
        out = np.concatenate([kernel(part, self.inputs, self.hyper) @ self.alpha for part in _parts(inputs)])
        return out if features is None else out + features @ self.weights

    def variance(self, inputs: Array, features: Array | None = None) -> Array:
        """Variance of f (N,), without the noise of a sample. Raises ModelError when the factor was left out."""
        if not self.factor.size:
            raise ModelError("this process was loaded for its mean alone")
        S, out = self.hyper.weight_sigma**2, []
        wide = np.zeros((len(inputs), len(S))) if features is None else features
        for part, phi in zip(_parts(inputs), _parts(wide), strict=True):
            cross = kernel(part, self.inputs, self.hyper) + (phi * S) @ self.features.T
            half = solve_triangular(self.factor, cross.T, lower=True)
            prior = prior_variance(part, self.hyper) + np.sum(phi**2 * S, axis=1)
            out.append(prior - np.sum(half**2, axis=0))
        return np.maximum(np.concatenate(out), 0.0)

    def gradient(self, inputs: Array) -> Array:
        """Derivatives of E[g] by the inputs, (N, D). A rough kernel has none at a training row, which is then left
        out."""
        return np.concatenate([self._gradient(part) for part in _parts(inputs)])

    def _gradient(self, inputs: Array) -> Array:
        out = np.zeros_like(inputs)
        for term in self.hyper.terms:
            x, rows = inputs[:, term.columns], self.inputs[:, term.columns]
            parts = [(rows, 1.0)]
            if term.flip:
                parts.append((rows * np.array(term.flip), -1.0))
            for y, sign in parts:
                squares = term.squares(x, y)
                weighted = sign * term.amplitude**2 * _shape(squares, self.hyper.family) * self.alpha
                if self.hyper.family == "exponential":  # c'(r) = -c(r)
                    r = np.sqrt(squares)
                    weighted = np.where(r > NEAR, weighted / np.maximum(r, NEAR), 0.0)
                slope = (weighted @ y - weighted.sum(axis=1)[:, None] * x) / term.lengthscales**2
                out[:, term.columns] += slope
        return out

    def log_likelihood(self, y: Array) -> float:
        """Log marginal likelihood of the values (N,) it was conditioned on."""
        half = solve_triangular(self.factor, y, lower=True)
        log_det = 2.0 * float(np.sum(np.log(np.diag(self.factor))))
        return -0.5 * (float(half @ half) + log_det + len(y) * float(np.log(2.0 * np.pi)))


def _parts(rows: Array) -> list[Array]:
    """Batches of rows; one empty batch for none."""
    return [rows[i : i + BATCH] for i in range(0, len(rows), BATCH)] or [rows]
