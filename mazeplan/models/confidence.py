"""How sure a model may be of where the ball will be: thousands of roll-outs in which all that is uncertain is drawn.

Drawn are the start (angle and rate, as well as a causal filter knows them), the model (`posterior`), what no model can
know (the acceleration that this one left over in a stretch of its training record, taken whole, so that impacts stay
impacts), and the noise of the camera. Between the quantiles LOW and HIGH of the roll-outs the measured angle should lie
in nine of ten cases: how often it does is the coverage.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mazeplan.models.fitting import Fitted
from mazeplan.models.learned import AccelerationModel
from mazeplan.models.posterior import draw_model
from mazeplan.models.rollout import CHECKED, STEPS, Windows, roll_out, roll_out_delayed
from mazeplan.models.samples import RingSamples
from mazeplan.models.start import angle_noise, causal_estimate
from mazeplan.records import Array, IntArray

LOW, HIGH = 0.05, 0.95
DRAWS = 50  # roll-outs of a window: well above the 19 that 5 % needs
STRETCHES = 200  # of what is left over in training
LAGS, SHORT = 30, 0.1  # samples, and share of the power below which neighbours have nothing in common


@dataclass(frozen=True)
class ConfidenceOptions:
    """rollouts: of each kind and ring, 0 for none; device and precision of the sums over rows: what is drawn needs no
    more than seven digits."""

    rollouts: int = 2000
    device: str = "cpu"
    precision: str = "float32"


@dataclass(frozen=True)
class Confidence:
    """Of W windows, (W, STEPS + 1), rad: quantiles of the roll-outs, what was measured; rollouts: of all windows."""

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
        """Plain: widths and coverage by the sample, and the window whose band is of middle width at the end."""
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


def leftovers(model: AccelerationModel, samples: RingSamples, rows: IntArray, rng: np.random.Generator) -> Array:
    """What a model leaves over, (R, STEPS + 1), rad/s^2, in stretches that are wholly among some rows; (0, STEPS + 1)
    where there are none."""
    there = np.zeros(len(samples), dtype=bool)
    there[rows] = True
    run = np.concatenate([[0], np.cumsum(~there)])
    first = np.arange(max(len(samples) - STEPS, 0))
    first = first[(run[first + STEPS + 1] == run[first]) & (samples.segment[first] == samples.segment[first + STEPS])]
    if not len(first):
        return np.zeros((0, STEPS + 1))
    first = np.sort(rng.permutation(first)[:STRETCHES])
    used = first[:, None] + np.arange(STEPS + 1)
    each, back = np.unique(used, return_inverse=True)
    left = samples.theta_ddot[each] - model.mean(samples.at(each))
    return left[back].reshape(used.shape)


def repeated(left: Array) -> float:
    """How often what is left over (R, STEPS + 1) says the same, by its autocorrelation; at least once."""
    power, out = float(np.mean(left**2)) if left.size else 0.0, 1.0
    for lag in range(1, LAGS):
        share = float(np.mean(left[:, lag:] * left[:, :-lag])) / power if power > 0.0 else 0.0
        if not share > SHORT:
            break
        out += 2.0 * share
    return out


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
    """Bands of a fitted kind over windows of test samples; rows: those of train that it was fitted to, in stretches;
    misfit: as for `causal_estimate`. None where there is no window."""
    o = options or ConfidenceOptions()
    some = windows.start[_spread(len(windows), max(1, o.rollouts // DRAWS))]
    if not len(some) or o.rollouts < DRAWS:
        return None
    left, noise = leftovers(fitted.typical, train, rows, rng), angle_noise(train)
    drawn = draw_model(
        fitted.model, fitted.typical, DRAWS, rng, repeats=repeated(left), device=o.device, precision=o.precision
    )
    theta, rate, P = causal_estimate(fitted.typical.mean, test, some, noise, misfit)
    if rates == "filtered":  # as in the paper: the late rate is taken for the rate
        rate = test.k.theta_dot[some]
    off = np.einsum("wij,swj->swi", np.linalg.cholesky(P), rng.standard_normal((DRAWS, len(some), 2)))
    start = np.tile(some, DRAWS)  # a group of all windows for each draw of the model
    push = left[rng.integers(0, len(left), len(start))] if len(left) else None
    way = roll_out_delayed if rates == "delayed" else roll_out
    done = way(drawn, test, start, (theta + off[:, :, 0]).ravel(), (rate + off[:, :, 1]).ravel(), push)
    angle = (done.angle + noise * rng.standard_normal(done.angle.shape)).reshape(DRAWS, len(some), -1)
    low, middle, high = band(angle)
    measured = test.measured[some[:, None] + np.arange(STEPS + 1)]
    return Confidence(low, middle, high, measured, len(start))


def band(drawn: Array) -> Array:
    """Quantiles LOW, 0.5 and HIGH (3, ...) of draws (DRAWS, ...), so that one more lies between the outer two with
    probability HIGH - LOW: below the k-th of n it lies with k / (n + 1)."""
    return np.quantile(drawn, [LOW, 0.5, HIGH], axis=0, method="weibull")


def documented(
    kind: str, fitted: Fitted | None, rings: tuple[RingSamples, IntArray, RingSamples], *rest: Any, seed: list[int]
) -> dict[str, dict[str, Any]]:
    """`{kind: document}` of what `confidence` says of (train, rows, test) and the rest of its arguments; {} where it
    says nothing, or the kind is rolled out by no equation of motion. Each kind is given the same numbers drawn."""
    if fitted is None or kind == "npd":
        return {}
    train, rows, test, (windows, rates, misfit, options) = *rings, rest
    found = confidence(fitted, train, rows, test, windows, rates, misfit, np.random.default_rng(seed), options)
    return {} if found is None else {kind: found.document()}


def _spread(n: int, most: int) -> IntArray:
    """At most so many of n, evenly spread."""
    return np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(np.int64)) if n else np.zeros(0, np.int64)
