"""Draws of ball models from their posterior, each evaluated in many states at once.

A linear model has weights with a covariance. A function f = phi w + g of a Gaussian process given y is drawn by
pathwise conditioning: a draw from the prior, plus the correction of its error at the data,

    f_s(x) = phi(x) w_s + g_s(x) + k_f(x, X) C^-1 (y - Phi w_s - g_s(X) - e_s),   w_s ~ N(0, S), e_s ~ N(0, s^2)
    g_s(x) = a F^-1/2 sum_j  n_j cos(v_j x / l) + m_j sin(v_j x / l),             n_j, m_j ~ N(0, 1)

(Wilson et al., "Efficiently sampling functions from Gaussian process posteriors", ICML 2020). There are F = WAVES
waves. v_j comes from the spectrum of the kernel: normal for rbf, multivariate Cauchy for exponential. An odd term is
(g(x) - g(x')) / sqrt(2), with x' the reflection of x. The sums over the rows are in single precision.

A draw of an ensemble of networks is its mean plus n_e / sqrt(E - 1) times the deviation of each member, n_e ~ N(0, 1).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.linalg import cho_solve

from mazeplan.core.records import Array
from mazeplan.learning.ball_models import AccelerationModel, GaussianBall, LinearBall, NetworkBall
from mazeplan.learning.features import FEATURES, INPUT_SETS
from mazeplan.learning.gaussian_process import GaussianProcess, Hyperparameters, KernelTerm
from mazeplan.physics.formulas.arrays import RingKinematics, kinematic_terms

FOURIER_FEATURES = 256  # number of waves of a draw from the prior, for each term
ELEMENTS = 2**18  # maximum elements of a piece of the kernel matrix

Drawn = Callable[[RingKinematics], Array]


class RandomFourierFeatures:
    """S draws of the prior of one term, each a sum of WAVES waves."""

    def __init__(self, term: KernelTerm, family: str, count: int, rng: np.random.Generator, dtype: Any) -> None:
        v = rng.standard_normal((FOURIER_FEATURES, len(term.columns)))
        if family == "exponential":
            v /= np.abs(rng.standard_normal((FOURIER_FEATURES, 1)))
        scale = term.amplitude / math.sqrt(FOURIER_FEATURES * (2.0 if term.flip else 1.0))
        self._term, self._dtype, v = term, dtype, v / term.lengthscales
        waves = [v, *([v * np.array(term.flip)] if term.flip else [])]
        self._waves = [np.ascontiguousarray(part.T, dtype=dtype) for part in waves]
        self._weights = (scale * rng.standard_normal((2, FOURIER_FEATURES, count))).astype(dtype)

    def _seen(self, x: Array) -> tuple[Any, Any]:
        """cos and sin (N, WAVES) at inputs (N, D); for an odd term, minus those at the flipped inputs."""
        part = np.ascontiguousarray(x[:, self._term.columns], dtype=self._dtype)
        phases = [part @ waves for waves in self._waves]
        if len(phases) == 1:
            return np.cos(phases[0]), np.sin(phases[0])
        return np.cos(phases[0]) - np.cos(phases[1]), np.sin(phases[0]) - np.sin(phases[1])

    def all(self, x: Array) -> Array:
        """Each draw at all inputs (N, D): (N, S)."""
        cos, sin = self._seen(x)
        return (cos @ self._weights[0] + sin @ self._weights[1]).astype(np.float64)

    def each(self, x: Array) -> Array:
        """Each draw at its own group of inputs, S groups one after the other: (S, N / S)."""
        groups = self._weights.shape[2]
        out = np.zeros((groups, len(x) // groups))
        for part, weights in zip(self._seen(x), self._weights, strict=True):
            out += (part.reshape(groups, -1, FOURIER_FEATURES) @ weights.T[:, :, None])[:, :, 0]
        return out


class ProcessDraws:
    """S draws of a Gaussian process given its data, around the mean of a Gaussian process on the same rows."""

    def __init__(
        self,
        process: GaussianProcess,
        centre: GaussianProcess,
        count: int,
        rng: np.random.Generator,
        precision: str = "float64",
    ) -> None:
        """process: the Gaussian process, with its factor. Raises ModelError if the factor is missing.

        centre:     its mean is the mean of the draws
        count:      number of draws S
        precision:  of the sum over rows"""
        process.variance(process.inputs[:0], process.features[:0])  # raises without the factor
        h, n = process.hyper, len(process)
        self.count, dtype = count, np.dtype(precision)
        self._waves = [RandomFourierFeatures(term, h.family, count, rng, dtype) for term in h.terms]
        sigma = h.weight_sigma[:, None]
        weights = sigma * rng.standard_normal((len(h.weight_sigma), count))
        off = process.features @ weights + h.noise * rng.standard_normal((n, count))
        for wave in self._waves:
            off += wave.all(process.inputs)
        moved = cho_solve((process.factor, True), off)
        self._weights = centre.weights[:, None] + weights - sigma**2 * (process.features.T @ moved)
        self._sum = RowSum(h, process.inputs, centre.alpha[:, None] - moved, dtype)

    def mean(self, inputs: Array, features: Array | None) -> Array:
        """f_s(x) (B,) at inputs (B, D) with features (B, M), S groups one after the other."""
        grouped = (self.count, len(inputs) // self.count, -1)
        out = self._sum(inputs).reshape(grouped[:2])
        for wave in self._waves:
            out += wave.each(inputs)
        if features is not None:
            out += np.einsum("sqm,ms->sq", features.reshape(grouped), self._weights)
        return out.ravel()


class RowSum:
    """Computes k(x, X) A_s for inputs x in S groups; each group s has other weights A_s."""

    def __init__(self, hyper: Hyperparameters, rows: Array, weights: Array, dtype: Any) -> None:
        """rows X (N, D); weights A (N, S)."""
        self._dtype: Any = dtype
        self._rbf = hyper.family == "rbf"
        unit = math.sqrt(2.0 * math.log(2.0)) if self._rbf else math.log(2.0)  # c is then a power of two
        self._weights = np.ascontiguousarray(weights.T[:, :, None], dtype=dtype)
        self._parts: list[tuple[KernelTerm, Array, Array, float, Any]] = []
        for term in hyper.terms:
            scales = term.lengthscales * unit
            for flip, sign in ((np.ones(len(scales)), 1.0), *([(np.array(term.flip), -1.0)] if term.flip else [])):
                x = rows[:, term.columns] * flip / scales
                centre = x.mean(axis=0)  # differences of squares lose no digits near it
                x = x - centre
                wide = np.column_stack([-2.0 * x, np.sum(x**2, axis=1), np.ones(len(x))])
                packed = np.ascontiguousarray(wide.T, dtype=dtype)
                self._parts.append((term, scales, centre, sign * term.amplitude**2, packed))
        self._piece = ELEMENTS // len(rows)

    def __call__(self, inputs: Array) -> Array:
        """The sums (B,) at inputs (B, D), S groups one after the other."""
        groups = len(self._weights)
        each = len(inputs) // groups
        together = max(1, self._piece // max(each, 1))
        out = np.zeros((groups, each))
        for term, scales, centre, scale, packed in self._parts:
            x = inputs[:, term.columns] / scales - centre
            z = np.column_stack([x, np.ones(len(x)), np.sum(x**2, axis=1)]).astype(self._dtype)
            for a in range(0, groups, together):
                b = min(a + together, groups)
                c = z[a * each : b * each] @ packed
                np.clip(c, 0.0, 1e6, out=c)
                if not self._rbf:
                    np.sqrt(c, out=c)
                np.exp2(np.negative(c, out=c), out=c)
                out[a:b] += scale * (c.reshape(b - a, each, -1) @ self._weights[a:b])[:, :, 0]
        return out.ravel()


def draw_model(
    model: AccelerationModel,
    centre: AccelerationModel,
    count: int,
    rng: np.random.Generator,
    *,
    repeats: float = 1.0,
    precision: str = "float64",
) -> Drawn:
    """theta_dd (B,) of `count` draws of a model, for B states in as many groups, one after the other.

    centre:     its mean is the mean of the draws of a Gaussian process
    repeats:    scales the covariance of a linear fit, see `fitting.correlation_time`
    precision:  of the sum over rows

    Models of other kinds have no uncertainty."""
    if isinstance(model, GaussianBall) and isinstance(centre, GaussianBall):
        draws = ProcessDraws(model.process, centre.process, count, rng, precision)
        seen, features = INPUT_SETS[model.inputs], FEATURES[model.features] if model.features else None
        return lambda k: kinematic_terms(k) + draws.mean(seen(k), None if features is None else features(k))
    if isinstance(model, LinearBall):
        fit, terms = model.fit, FEATURES[model.features]
        weights = rng.multivariate_normal(fit.weights, repeats * fit.covariance, count, method="eigh")
        grouped = (count, -1, len(fit.weights))
        return lambda k: np.einsum("sqm,sm->sq", terms(k).reshape(grouped), weights).ravel()
    if isinstance(model, NetworkBall):
        members = len(model.networks.last)
        weights = rng.standard_normal((count, members)) / math.sqrt(members - 1)

        def drawn(k: RingKinematics) -> Array:
            found = model.each(k).reshape(members, count, -1)
            middle = found.mean(axis=0)
            return (middle + np.einsum("se,esq->sq", weights, found - middle)).ravel()

        return drawn
    return model.mean
