"""Scores of all kinds of ball models on one ring.

A Gaussian process predicts accelerations by its mean, because their errors are squared. Roll-outs use the fit with
heavy tails (see `fitting`), because their errors are absolute.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mazeplan.core.progress import Advance, Words, led_by, piece
from mazeplan.core.records import Array, IntArray
from mazeplan.learning.ball_models import AccelerationModel
from mazeplan.learning.camera_center import Centre
from mazeplan.learning.discrete_map import fit_discrete, roll_out_discrete
from mazeplan.learning.fitting import FitOptions, fit_kind
from mazeplan.learning.gp_training import TrainingOptions
from mazeplan.learning.rollout import (
    CHECKED,
    Rollout,
    Windows,
    angle_noise,
    causal_start,
    choose_windows,
    rollout_function,
)
from mazeplan.learning.samples import RingSamples, SampleOptions
from mazeplan.learning.smoothing import Smoothing
from mazeplan.learning.split import block_bootstrap, uniform_downsample

PREDICTED = ("rf", "p", "pi", "np", "sp")  # default
ROLLED = ("pi", "np", "npd", "sp")  # kinds with roll-outs
MISFIT = 0.5  # error of the model over the spread of theta_dd, as assumed by the filter before a roll-out
# With fewer rows, their choice matters. On measured data the exponential kernel predicted other blocks better, although
# the likelihood of the training rows often prefers the smooth one.
THOROUGH = TrainingOptions(first=900, rows=2000, starts=2, refinement=40, family="exponential")
COST = {"rf": 0.5, "p": 0.1, "pi": 0.1, "np": 6.0, "sp": 6.0, "roll": 0.5}  # relative duration


@dataclass(frozen=True)
class CompareOptions:
    """Settings of a comparison.

    smoothing:  of positions, if the table contains no derivatives
    delay:      delay of the ball behind the tilt, s; None: estimated by `best_lag`
    samples:    settings of the samples
    rates:      rates of the samples; "auto": chosen by the noise of the angle
    fit:        settings of the fits
    kinds:      names in `fitting.KINDS`
    seed:       for all random draws"""

    smoothing: Smoothing = field(default_factory=lambda: Smoothing(window=9))
    delay: float | None = None
    samples: SampleOptions = field(default_factory=SampleOptions)
    rates: str = "auto"
    fit: FitOptions = field(default_factory=lambda: FitOptions(training=THOROUGH))
    kinds: tuple[str, ...] = PREDICTED
    seed: int = 0


@dataclass(frozen=True)
class RingData:
    """Training and test samples of one ring (the same samples if a record is split), with the rows of each set.

    centre:  of the rings, if the camera counts the angle about another point; models are then fitted in the true angle
    seen:    with a centre, the training and test samples as measured, for the scores"""

    train: RingSamples
    test: RingSamples
    train_rows: IntArray
    test_mask: np.ndarray
    block: IntArray
    centre: Centre | None = None
    seen: tuple[RingSamples, RingSamples] | None = None

    def pairs(self, model: AccelerationModel, rows: IntArray, train: bool = False) -> tuple[Array, Array]:
        """theta_dd in some rows, measured and predicted."""
        samples = self.train if train else self.test
        truth, predicted = samples.theta_ddot[rows], model.mean(samples.at(rows))
        if self.centre is None or self.seen is None:
            return truth, predicted
        seen = self.seen[0 if train else 1]
        measured = seen.theta_ddot[rows]
        return measured, measured + (predicted - truth) / self.centre.slope(seen.k.theta[rows])

    @property
    def off(self) -> tuple[float, float]:
        """The centre of the rings, m."""
        r = self.test.k.radius
        return (0.0, 0.0) if self.centre is None else (self.centre.x * r, self.centre.y * r)

    @property
    def test_rows(self) -> IntArray:
        """Rows that are scored."""
        return np.flatnonzero(self.test_mask & self.test.good)

    def blocks(self, windows: Windows) -> dict[str, int]:
        """Number of blocks of time with test rows, and with windows."""
        rows = {"test": self.test_rows, "windows": windows.start}
        return {name: len(np.unique(self.block[some])) for name, some in rows.items()}


@dataclass(frozen=True)
class RingScores:
    """Scores of one ring; `document` is their JSON.

    delay:             of the ball behind the tilt, s
    signs:             of beta and gamma, see `samples.orientation`
    centre:            of the rings, m
    rollout:           mean absolute error of theta, rad, by kind and sample
    interval, bands:   95 % intervals of the scores, and bands of the roll-out errors
    blocks:            number of blocks of time with test rows, and with windows"""

    ring: int
    n_train: int
    n_test: int
    rates: str
    delay: float
    signs: tuple[int, int]
    windows: Windows
    centre: tuple[float, float]
    nrmse_train: dict[str, float]
    nrmse_test: dict[str, float]
    rollout: dict[str, dict[str, float]]
    interval: dict[str, dict[str, tuple[float, float]]]
    bands: dict[str, dict[str, list[float]]] = field(default_factory=dict)
    blocks: dict[str, int] = field(default_factory=dict)

    def document(self) -> dict[str, Any]:
        """For JSON, rounded."""
        out = {
            "n_train": self.n_train, "n_test": self.n_test, "rates": self.rates, "delay_s": self.delay,
            "signs": {"beta": self.signs[0], "gamma": self.signs[1]},
            "windows": len(self.windows), "windows_chosen": self.windows.chosen,
            "blocks": self.blocks, "centre_m": list(self.centre),
            "nrmse_train": self.nrmse_train, "nrmse_test": self.nrmse_test,
            "rollout": self.rollout, "interval95": self.interval,
        }  # fmt: skip
        return _rounded(out | ({"bands": self.bands} if self.bands else {}))


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(part) for part in value]
    return round(value, 4) if isinstance(value, float) and math.isfinite(value) else value


def score(
    ring: int,
    data: RingData,
    options: CompareOptions,
    rates: str,
    signs: tuple[int, int],
    openings: Array | None,
    progress: Words,
    advance: Advance,
) -> RingScores:
    """Fit each kind of model and score it. openings: angles of the openings, rad, if known."""
    rng = np.random.default_rng([options.seed, ring])
    windows = choose_windows(data.test, data.test_mask, openings)
    train_rows = data.train_rows[uniform_downsample(len(data.train_rows), options.fit.most)]
    at = data.test_rows
    nrmse_train, nrmse_test, models = {}, {}, {}
    interval: dict[str, dict[str, tuple[float, float]]] = {"nrmse_test": {}, "20": {}, "40": {}}
    fits = sum(COST[kind] for kind in options.kinds)
    done, whole = 0.0, fits + COST["roll"] * len(ROLLED)
    for kind in options.kinds:
        progress(kind)
        words, share = led_by(f"{kind}, ", progress), piece(advance, done, COST[kind], whole)
        models[kind] = fit_kind(kind, data.train, train_rows, options.fit, progress=words, advance=share)
        done += COST[kind]
        advance(done, whole)
        nrmse_train[kind] = nrmse(*data.pairs(models[kind].model, train_rows, train=True))
        pairs = np.stack(data.pairs(models[kind].model, at), axis=1)
        nrmse_test[kind] = nrmse(*pairs.T)
        interval["nrmse_test"][kind] = block_bootstrap(pairs, data.block[at], lambda p: nrmse(p[:, 0], p[:, 1]), rng)
    misfit = MISFIT * float(np.std(data.train.theta_ddot[train_rows]))
    rollout: dict[str, dict[str, float]] = {}
    bands: dict[str, dict[str, list[float]]] = {}
    for kind in ROLLED:
        progress(f"rolling out {kind}")
        fitted = models.get("np" if kind == "npd" else kind)  # npd goes with np
        if fitted is not None and len(windows):
            rolled = _roll(kind, fitted.typical, data, windows, misfit, rates, train_rows, options.fit)
            rollout[kind] = {str(n): rolled.after(n) for n in CHECKED}
            bands[kind] = rolled.bands()
            for n in CHECKED:
                blocks = data.block[windows.start]
                interval[str(n)][kind] = block_bootstrap(rolled.error[:, n], blocks, lambda e: float(np.mean(e)), rng)
        done += COST["roll"]
        advance(done, whole)
    return RingScores(
        ring, len(train_rows), len(at), rates, options.samples.delay, signs, windows, data.off, nrmse_train, nrmse_test,
        rollout, interval, bands, data.blocks(windows),
    )  # fmt: skip


def _roll(
    kind: str,
    model: AccelerationModel,
    data: RingData,
    windows: Windows,
    misfit: float,
    rates: str,
    rows: IntArray,
    options: FitOptions,
) -> Rollout:
    """The roll-out of a kind; misfit: see `causal_start`; rows: training rows, for npd."""
    start = windows.start
    theta, rate, _ = causal_start(model.mean, data.test, start, angle_noise(data.train), misfit)
    if kind == "npd":
        done = roll_out_discrete(fit_discrete(data.train, rows, options), data.test, start, theta, rate)
    else:
        done = rollout_function(rates)(model.mean, data.test, start, theta, rate)
    if data.centre is None or data.seen is None:
        return done
    return Rollout.against(data.centre.seen(done.angle), data.seen[1].k.theta, start)


def nrmse(truth: Array, predicted: Array) -> float:
    """Root mean square error over the standard deviation of the truth; NaN for no rows or a constant truth."""
    spread = float(np.std(truth)) if len(truth) else 0.0
    return float(np.sqrt(np.mean((truth - predicted) ** 2)) / spread) if spread > 0.0 else math.nan
