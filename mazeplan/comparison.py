"""How kinds of ball models do on one ring: what is fitted and scored, and the scores. `compare` brings the data.

A process predicts accelerations, whose errors are squared, by its mean, and is rolled out, where errors are absolute,
by what is typical (`heavy_tails`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mazeplan.data.smoothing import Smoothing
from mazeplan.data.split import block_bootstrap, uniform_downsample
from mazeplan.models.confidence import ConfidenceOptions, documented
from mazeplan.models.discrete import fit_discrete, roll_out_discrete
from mazeplan.models.eccentric import Centre
from mazeplan.models.fitting import FitOptions, fit_kind
from mazeplan.models.gp_training import TrainingOptions
from mazeplan.models.learned import AccelerationModel
from mazeplan.models.residual_map import ResidualMap, residual_map
from mazeplan.models.rollout import CHECKED, Rollout, Windows, choose_windows, roll_out, roll_out_delayed
from mazeplan.models.samples import RingSamples, SampleOptions
from mazeplan.models.start import angle_noise, causal_start
from mazeplan.progress import Advance, Words, led_by, piece
from mazeplan.records import Array, IntArray

PREDICTED = ("rf", "p", "pi", "np", "sp")
ROLLED = ("pi", "np", "npd", "sp")
MISFIT = 0.5  # of the spread of theta_dd: what the filter that finds a roll-out's start expects of any model
THOROUGH = TrainingOptions(  # the hyperparameters of a comparison: with fewer rows they depend on which rows those are
    first=900, rows=2000, starts=2, refinement=40
)
COST = {"rf": 0.5, "p": 0.1, "pi": 0.1, "np": 6.0, "sp": 6.0, "roll": 0.5}  # about as long as they take
CURVE = (0.125, 0.25, 0.5, 1.0)  # shares of the training rows, for learning curves


@dataclass(frozen=True)
class CompareOptions:
    """smoothing of positions where the table brings no derivatives; delay: s that the ball is behind the tilt (None:
    found, see `best_lag`); samples: what else a table does not tell; rates: or "auto", by the noise of the angle; fit;
    curve: learning curves too; bands: of confidence around roll-outs; seed: of everything that is drawn."""

    smoothing: Smoothing = field(default_factory=lambda: Smoothing(window=9))
    delay: float | None = None
    samples: SampleOptions = field(default_factory=SampleOptions)
    rates: str = "auto"
    fit: FitOptions = field(default_factory=lambda: FitOptions(training=THOROUGH))
    curve: bool = False
    bands: ConfidenceOptions = field(default_factory=ConfidenceOptions)
    kinds: tuple[str, ...] = PREDICTED
    seed: int = 0


@dataclass(frozen=True)
class RingData:
    """One ring: samples of training and test records (the same where a record is split), and which rows are whose;
    centre: of the rings, where the camera counts the angle about another point: then models are fitted in the ball's
    own angle, and `seen` has the test samples as they were measured, by which they are scored."""

    train: RingSamples
    test: RingSamples
    train_rows: IntArray
    test_mask: np.ndarray
    block: IntArray
    centre: Centre | None = None
    seen: tuple[RingSamples, RingSamples] | None = None

    def pairs(self, model: AccelerationModel, rows: IntArray, train: bool = False) -> tuple[Array, Array]:
        """theta_dd as measured in some rows, and as predicted."""
        samples = self.train if train else self.test
        truth, predicted = samples.theta_ddot[rows], model.mean(samples.at(rows))
        if self.centre is None or self.seen is None:
            return truth, predicted
        seen = self.seen[0 if train else 1]
        measured = seen.theta_ddot[rows]
        return measured, measured + (predicted - truth) / self.centre.slope(seen.k.theta[rows])

    @property
    def off(self) -> tuple[float, float]:
        """Where the rings' centre is, m."""
        r = self.test.k.radius
        return (0.0, 0.0) if self.centre is None else (self.centre.x * r, self.centre.y * r)

    @property
    def test_rows(self) -> IntArray:
        """Rows scored."""
        return np.flatnonzero(self.test_mask & self.test.good)

    def blocks(self, windows: Windows) -> dict[str, int]:
        """How many blocks of time have rows scored, and windows."""
        return {
            "test": len(np.unique(self.block[self.test_rows])), "windows": len(np.unique(self.block[windows.start]))
        }  # fmt: skip


@dataclass(frozen=True)
class RingScores:
    """What a ring came to; `document` is the JSON of it."""

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
    curve: dict[str, list[tuple[int, float]]]
    bands: dict[str, dict[str, list[float]]] = field(default_factory=dict)  # of roll-outs, by the sample
    residual: ResidualMap | None = None
    confidence: dict[str, dict[str, Any]] = field(default_factory=dict)  # as `Confidence.document` has it
    blocks: dict[str, int] = field(default_factory=dict)  # of time: with test rows, and with windows

    def document(self) -> dict[str, Any]:
        """Plain and rounded."""

        def rounded(value: Any) -> Any:
            if isinstance(value, dict):
                return {key: rounded(part) for key, part in value.items()}
            if isinstance(value, list | tuple):
                return [rounded(part) for part in value]
            return round(value, 4) if isinstance(value, float) and math.isfinite(value) else value

        return {
            "n_train": self.n_train, "n_test": self.n_test, "rates": self.rates, "delay_s": round(self.delay, 4),
            "signs": {"beta": self.signs[0], "gamma": self.signs[1]},
            "windows": len(self.windows), "windows_chosen": self.windows.chosen,
            "blocks": self.blocks, "centre_m": rounded(list(self.centre)),
            "nrmse_train": rounded(self.nrmse_train), "nrmse_test": rounded(self.nrmse_test),
            "rollout": rounded(self.rollout), "interval95": rounded(self.interval),
            **({"curve": rounded(self.curve)} if self.curve else {}),
            **({"bands": rounded(self.bands)} if self.bands else {}),
            **({"confidence": rounded(self.confidence)} if self.confidence else {}),
            **({"residual": self.residual.document()} if self.residual else {}),
        }  # fmt: skip


def _starts(
    model: AccelerationModel, data: RingData, windows: Windows, rates: str, misfit: float
) -> tuple[Array, Array]:
    """Angle and rate (W,) at the start of each window, by a filter with the model that is then rolled out."""
    theta, rate = causal_start(model.mean, data.test, windows.start, angle_noise(data.train), misfit)
    if rates == "filtered":  # as in the paper: the late rate is taken for the rate
        rate = data.test.k.theta_dot[windows.start]
    return theta, rate


def score(
    ring: int,
    data: RingData,
    options: CompareOptions,
    rates: str,
    signs: tuple[int, int],
    openings: Array | None,
    tell: Words,
    advance: Advance,
) -> RingScores:
    """Fit each kind and score it."""
    rng = np.random.default_rng([options.seed, ring])
    windows = choose_windows(data.test, data.test_mask, openings)
    train_rows = data.train_rows[uniform_downsample(len(data.train_rows), options.fit.most)]
    nrmse_train, nrmse_test, models, left = {}, {}, {}, {}
    interval: dict[str, dict[str, tuple[float, float]]] = {"nrmse_test": {}, "20": {}, "40": {}}
    fits = sum(COST[kind] for kind in options.kinds)
    done, whole = 0.0, fits * (1.0 + options.curve * sum(CURVE[:-1])) + COST["roll"] * len(ROLLED)
    for kind in options.kinds:
        tell(kind)
        words = led_by(f"{kind}, ", tell)
        share = piece(advance, done, COST[kind], whole)
        models[kind] = fit_kind(kind, data.train, train_rows, options.fit, progress=words, advance=share)
        done += COST[kind]
        advance(done, whole)
        model = models[kind].model
        nrmse_train[kind] = nrmse(*data.pairs(model, train_rows, train=True))
        truth, predicted = data.pairs(model, data.test_rows)
        nrmse_test[kind] = nrmse(truth, predicted)
        pairs = np.stack([truth, predicted], axis=1)
        blocks = data.block[data.test_rows]
        interval["nrmse_test"][kind] = block_bootstrap(pairs, blocks, lambda p: nrmse(p[:, 0], p[:, 1]), rng)
        left[kind] = truth - predicted
    misfit = MISFIT * float(np.std(data.train.theta_ddot[train_rows]))
    rollout: dict[str, dict[str, float]] = {}
    bands: dict[str, dict[str, list[float]]] = {}
    sure: dict[str, dict[str, Any]] = {}
    for kind in ROLLED:
        tell(f"rolling out {kind}")
        fitted = models.get("np" if kind == "npd" else kind)  # npd goes with np
        rolled = _roll(kind, fitted.typical if fitted else None, data, windows, misfit, rates, train_rows, options)
        if rolled is not None:
            rollout[kind] = {str(n): rolled.after(n) for n in CHECKED}
            bands[kind] = rolled.bands()
            for n in CHECKED:
                blocks = data.block[windows.start]
                interval[str(n)][kind] = block_bootstrap(rolled.error[:, n], blocks, lambda e: float(np.mean(e)), rng)
            parts = data.train, data.train_rows, data.test
            doubts = windows, rates, misfit, options.bands
            sure |= documented(kind, fitted, parts, *doubts, seed=[options.seed, ring, 1])
        done += COST["roll"]
        advance(done, whole)
    curve = _curve(data, train_rows, options, tell, piece(advance, done, whole - done, whole)) if options.curve else {}
    at = data.test_rows
    return RingScores(
        ring, len(train_rows), len(at), rates, options.samples.delay, signs, windows, data.off, nrmse_train, nrmse_test,
        rollout, interval, curve, bands, residual_map(data.test.k.theta[at], data.test.k.theta_dot[at], left), sure,
        data.blocks(windows),
    )  # fmt: skip


def _roll(
    kind: str,
    model: AccelerationModel | None,
    data: RingData,
    windows: Windows,
    misfit: float,
    rates: str,
    rows: IntArray,
    options: CompareOptions,
) -> Rollout | None:
    """The roll-out of a kind; None where there are no windows or the kind was not asked for."""
    if model is None or not len(windows):
        return None
    theta, rate = _starts(model, data, windows, rates, misfit)
    if kind == "npd":
        done = roll_out_discrete(fit_discrete(data.train, rows, options.fit), data.test, windows.start, theta, rate)
    else:
        way = roll_out_delayed if rates == "delayed" else roll_out
        done = way(model.mean, data.test, windows.start, theta, rate)
    if data.centre is None or data.seen is None:
        return done
    angle = data.centre.seen(done.angle)
    there = data.seen[1].k.theta[windows.start[:, None] + np.arange(angle.shape[1])]
    return Rollout(angle, np.abs(angle - there))


def nrmse(truth: Array, predicted: Array) -> float:
    """Root mean square error over the standard deviation of the truth; NaN when there is nothing to compare."""
    spread = float(np.std(truth)) if len(truth) else 0.0
    return float(np.sqrt(np.mean((truth - predicted) ** 2)) / spread) if spread > 0.0 else math.nan


def _curve(
    data: RingData, rows: IntArray, options: CompareOptions, tell: Words, advance: Advance
) -> dict[str, list[tuple[int, float]]]:
    """Test nRMSE by number of training rows, which are the first of the record: more rows mean a longer record."""
    fit = replace(options.fit, heavy_tails=False)  # no roll-outs here
    curve: dict[str, list[tuple[int, float]]] = {kind: [] for kind in options.kinds if kind != "p"}
    for share in CURVE[:-1]:
        some = rows[: max(50, round(share * len(rows)))]
        for kind in curve:
            tell(f"learning curve, {kind} on {len(some)} rows")
            model = fit_kind(kind, data.train, some, fit).model
            curve[kind].append((len(some), nrmse(*data.pairs(model, data.test_rows))))
        advance(sum(CURVE[: CURVE.index(share) + 1]), sum(CURVE[:-1]))
    return curve
