"""Confidence bands by Monte-Carlo roll-outs: each roll-out draws everything that is uncertain.

    start         from the filter's estimate and covariance
    model         from its posterior (`posterior`)
    acceleration  that no model explains: residuals of this model in a whole stretch of its training record, so that
                  impacts stay impacts
    noise         of the camera

The measured angle should lie between the quantiles LOW and HIGH in nine of ten cases. The coverage is the share of
cases in which it does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mazeplan.core.records import Array, IntArray
from mazeplan.learning.ball_models import AccelerationModel
from mazeplan.learning.fitting import Fitted, correlation_time
from mazeplan.learning.posterior import draw_model
from mazeplan.learning.rollout import (
    CHECKED,
    STEPS,
    Windows,
    angle_noise,
    causal_start,
    rollout_function,
    uninterrupted,
)
from mazeplan.learning.samples import RingSamples

LOW, HIGH = 0.05, 0.95
DRAWS = 50  # roll-outs of a window; the 5 % quantile needs at least 19
STRETCHES = 200  # maximum number of stretches of training residuals


@dataclass(frozen=True)
class ConfidenceOptions:
    """Settings of the confidence bands.

    rollouts:   number of roll-outs of each kind and ring; 0: no bands
    precision:  of the sums over rows"""

    rollouts: int = 2000
    precision: str = "float32"


@dataclass(frozen=True)
class Confidence:
    """Quantiles of the roll-outs of W windows, and the measured angle, each (W, STEPS + 1), rad.

    rollouts: number of roll-outs of all windows."""

    low: Array
    middle: Array
    high: Array
    measured: Array
    rollouts: int

    @property
    def coverage(self) -> Array:
        """Share of the windows (STEPS + 1,) in which the measured angle lies between low and high."""
        return np.mean((self.low <= self.measured) & (self.measured <= self.high), axis=0)

    def document(self) -> dict[str, Any]:
        """For JSON: widths and coverage by sample, and the window of median width at the end."""
        width = (self.high - self.low)[:, -1]
        shown = int(np.argsort(width)[len(width) // 2])
        names = ("low", "middle", "high", "measured")
        return {
            "rollouts": self.rollouts, "windows": len(self.low), "level": HIGH - LOW,
            "below": np.mean(self.low - self.middle, axis=0).tolist(),
            "above": np.mean(self.high - self.middle, axis=0).tolist(),
            "coverage": self.coverage.tolist(),
            **{f"coverage{n}": float(self.coverage[n]) for n in CHECKED},
            "coverage_all": float(np.mean(self.coverage[1:])),
            "window": {name: getattr(self, name)[shown].tolist() for name in names},
        }  # fmt: skip


def residual_stretches(
    model: AccelerationModel, samples: RingSamples, rows: IntArray, rng: np.random.Generator
) -> Array:
    """Residuals of a model, (R, STEPS + 1), rad/s^2, in stretches that lie entirely in `rows`; R may be 0."""
    usable = np.zeros(len(samples), dtype=bool)
    usable[rows] = True
    first = uninterrupted(usable, samples.segment)
    if not len(first):
        return np.zeros((0, STEPS + 1))
    first = np.sort(rng.permutation(first)[:STRETCHES])
    used = first[:, None] + np.arange(STEPS + 1)
    each, back = np.unique(used, return_inverse=True)
    left = samples.theta_ddot[each] - model.mean(samples.at(each))
    return left[back].reshape(used.shape)


def confidence(
    fitted: Fitted,
    train: RingSamples,
    rows: IntArray,
    test: RingSamples,
    windows: Windows,
    rates: str,
    misfit: float,
    rng: np.random.Generator,
    options: ConfidenceOptions | None = None,
) -> Confidence | None:
    """Bands of a fitted kind over windows of test samples; None without windows.

    rows:    training rows, indices into `train`
    rates:   see `samples`
    misfit:  see `causal_start`"""
    o = options or ConfidenceOptions()
    some = windows.start[_spread(len(windows), max(1, o.rollouts // DRAWS))]
    if not len(some) or o.rollouts < DRAWS:
        return None
    left, noise = residual_stretches(fitted.typical, train, rows, rng), angle_noise(train)
    drawn = draw_model(fitted.model, fitted.typical, DRAWS, rng, repeats=correlation_time(left), precision=o.precision)
    theta, rate, P = causal_start(fitted.typical.mean, test, some, noise, misfit)
    if rates == "filtered":  # like the published figures: the late rate is used as the rate
        rate = test.k.theta_dot[some]
    off = np.einsum("wij,swj->swi", np.linalg.cholesky(P), rng.standard_normal((DRAWS, len(some), 2)))
    start = np.tile(some, DRAWS)  # a group of all windows for each draw of the model
    push = left[rng.integers(0, len(left), len(start))] if len(left) else None
    done = rollout_function(rates)(
        drawn, test, start, (theta + off[:, :, 0]).ravel(), (rate + off[:, :, 1]).ravel(), push
    )
    angle = (done.angle + noise * rng.standard_normal(done.angle.shape)).reshape(DRAWS, len(some), -1)
    low, middle, high = band(angle)
    measured = test.measured[some[:, None] + np.arange(STEPS + 1)]
    return Confidence(low, middle, high, measured, len(start))


def band(drawn: Array) -> Array:
    """Quantiles LOW, 0.5 and HIGH (3, ...) of draws (DRAWS, ...).

    A further draw lies between the outer two quantiles with probability HIGH - LOW, because it lies below the k-th of n
    draws with probability k / (n + 1)."""
    return np.quantile(drawn, [LOW, 0.5, HIGH], axis=0, method="weibull")


def _spread(n: int, most: int) -> IntArray:
    """At most `most` indices below n, evenly spread."""
    return np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(np.int64)) if n else np.zeros(0, np.int64)
