"""Bayesian linear regression on physical features, prior and noise by marginal likelihood (evidence).

    y = Phi w + e,   w ~ N(0, diag(1 / a)),   e ~ N(0, s^2)

a (one per feature) and s are found by the fixed-point rules of MacKay, "Bayesian interpolation", Neural Computation
1992; features that say nothing get a weight of zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mazeplan.records import Array

ROUNDS = 200
CLOSE = 1e-6  # relative change of the precisions at which the rounds end
SMALLEST = 1e-100  # of squares, so that an all but perfect fit can still be divided by, and its square too
DIGITS = 1e-14  # of the target's square: what is left of it below that is rounding
LARGEST = 1e12  # precision, in units of the feature's own scale, at which a weight is taken as zero


@dataclass(frozen=True)
class LinearFit:
    """weights (M,), covariance (M, M) of them, noise: standard deviation of a sample, evidence: log marginal
    likelihood."""

    weights: Array
    covariance: Array
    noise: float
    evidence: float

    @property
    def stderr(self) -> Array:
        """Standard errors (M,)."""
        return np.sqrt(np.diag(self.covariance))

    def mean(self, features: Array) -> Array:
        """Prediction (N,) for features (N, M)."""
        return features @ self.weights

    def variance(self, features: Array) -> Array:
        """Variance (N,) of the prediction, without the noise of a sample."""
        return np.einsum("ni,ij,nj->n", features, self.covariance, features)


def fit_linear(features: Array, target: Array) -> LinearFit:
    """Weights of features (N, M) for a target (N,). Raises ValueError when there are no more rows than features."""
    n, m = features.shape
    if n <= m:
        raise ValueError(f"got {n} samples, expected more than {m}")
    scale = np.sqrt(np.mean(features**2, axis=0))
    scale = np.where(scale > 0.0, scale, 1.0)
    X = features / scale
    gram, moment, power = X.T @ X, X.T @ target, float(target @ target)
    precision, noise = np.ones(m) / max(float(np.var(target)), SMALLEST), max(0.1 * power / n, SMALLEST)
    mean, covariance = np.zeros(m), np.eye(m)
    for _ in range(ROUNDS):
        covariance = np.linalg.inv(gram / noise + np.diag(precision))
        mean = covariance @ moment / noise
        known = 1.0 - precision * np.diag(covariance)  # how far each weight is told by the data
        before = precision
        precision = np.minimum(np.maximum(known, 1e-12) / np.maximum(mean**2, SMALLEST), LARGEST)
        rest = max(power - 2.0 * float(mean @ moment) + float(mean @ gram @ mean), DIGITS * power)
        noise = max(rest / max(n - float(known.sum()), 1.0), SMALLEST)
        if np.max(np.abs(np.log(precision / before))) < CLOSE:
            break
    weights = mean / scale
    evidence = _evidence(gram, moment, power, precision, noise, n)
    return LinearFit(weights, covariance / np.outer(scale, scale), float(np.sqrt(noise)), evidence)


def _evidence(gram: Array, moment: Array, power: float, precision: Array, noise: float, n: int) -> float:
    """Log marginal likelihood of the target, by the matrix determinant lemma."""
    information = gram / noise + np.diag(precision)
    _, log_det = np.linalg.slogdet(information)
    explained = moment @ np.linalg.solve(information, moment) / noise**2
    log_det_all = n * np.log(noise) - float(np.sum(np.log(precision))) + log_det
    return float(-0.5 * (n * np.log(2.0 * np.pi) + log_det_all + power / noise - explained))
