"""Bayesian linear regression on physical features; the marginal likelihood (evidence) determines prior and noise.

    y = Phi w + e,   w ~ N(0, diag(1 / a)),   e ~ N(0, s^2)

a (one for each feature) and s follow from the fixed-point rules of MacKay, "Bayesian interpolation", Neural Computation
1992. Features without influence get a weight of zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mazeplan.core.records import Array

ROUNDS = 200
CLOSE = 1e-6  # relative change of the precisions that ends the rounds
SMALLEST = 1e-100  # minimum of a divisor
DIGITS = 1e-14  # share of the target's square; a smaller rest is rounding
LARGEST = 1e12  # maximum precision, in units of the scaled feature; the weight is then practically zero


@dataclass(frozen=True)
class LinearFit:
    """A fitted linear model.

    weights (M,), covariance (M, M):  mean and covariance of the weights
    noise:                            standard deviation of a sample"""

    weights: Array
    covariance: Array
    noise: float

    def mean(self, features: Array) -> Array:
        """Prediction (N,) for features (N, M)."""
        return features @ self.weights


def fit_linear(features: Array, target: Array) -> LinearFit:
    """Weights of features (N, M) for a target (N,). Raises ValueError if there are no more rows than features."""
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
        known = 1.0 - precision * np.diag(covariance)  # 1 for a weight that the data determine
        before = precision
        precision = np.minimum(np.maximum(known, 1e-12) / np.maximum(mean**2, SMALLEST), LARGEST)
        rest = max(power - 2.0 * float(mean @ moment) + float(mean @ gram @ mean), DIGITS * power)
        noise = max(rest / max(n - float(known.sum()), 1.0), SMALLEST)
        if np.max(np.abs(np.log(precision / before))) < CLOSE:
            break
    return LinearFit(mean / scale, covariance / np.outer(scale, scale), float(np.sqrt(noise)))
