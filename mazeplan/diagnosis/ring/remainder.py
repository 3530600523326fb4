"""What named effects leave of an acceleration, learned without a name: a Gaussian process on the residual.

    theta_dd - (what the model with all named effects predicts) ~ GP(inputs)

Inputs are the state as an opening sees it (`features.local_inputs`): tilts averaged as the target is, what they were a
while ago, the angle, and the rate of theta before the first sample of the target's window. Where the named effects
expect a blow it may come or not, so what they predict is an input, too, if blocks of the seen rows are predicted better
with it. None of them looks at what is predicted. Where effects are named in finer words, a second process learns what
the plainer ones leave, and the two are averaged: what one takes up by chance the other has not. Where the camera was
found to be off, angle and residual are those about the true centre. Kernel and training are those of the ball models
(`gp_training`); a rough kernel, since what is left comes from edges. It says how much better a model could become that
knows more, and names nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mazeplan.core.errors import InputError
from mazeplan.core.logs.table import Table
from mazeplan.core.records import Array, IntArray
from mazeplan.diagnosis.coordinate.diagnosis import rounded
from mazeplan.diagnosis.coordinate.fit import Fit, Likelihood
from mazeplan.diagnosis.record import RingRecord
from mazeplan.diagnosis.ring.holdout import inner_folds
from mazeplan.diagnosis.ring.scores import MATCHED, acceleration_pairs, nrmse, ring_of
from mazeplan.learning.features import INPUT_SETS
from mazeplan.learning.fitting import FitOptions, fit_process
from mazeplan.learning.gp_training import TrainingOptions
from mazeplan.learning.samples import RingSamples, SampleOptions, ring_samples

MOST = 5000  # rows of the process
FEWEST = 200  # rows from which something can be learned
TRAINING = TrainingOptions(first=900, rows=2000, starts=2, refinement=40, family="exponential")  # as `compare` has it
QUICK = replace(TRAINING, first=400, rows=1000, starts=1, iterations=15, refinement=25)  # to choose by


@dataclass(frozen=True)
class Remainder:
    """nRMSE of theta_dd on rows held out, of the named effects alone and with the process; rows it was trained on."""

    before: float
    nrmse: float
    rows: int

    def document(self) -> dict[str, Any]:
        """Plain and rounded."""
        return {"before": rounded(self.before), "nrmse": rounded(self.nrmse), "rows": self.rows}


@dataclass(frozen=True)
class _Left:
    """The rest of the named effects, about the true centre, in n rows.

    samples: states; expected, left (n,): accelerations that the effects predict, and the rest, rad/s^2; slope (n,): of
    the true angle by the measured one; good (n,): True if both are known."""

    samples: RingSamples
    expected: Array
    left: Array
    slope: Array
    good: np.ndarray

    def among(self, rows: np.ndarray) -> IntArray:
        """Indices of the good ones among rows (N,) of the record."""
        return np.flatnonzero(self.good & rows[self.samples.row])

    def learned(
        self, train: IntArray, test: IntArray, knows: bool, training: TrainingOptions, tell: Callable[[str], None]
    ) -> Array:
        """The rest in some rows (K,), by a Gaussian process trained on others. knows: what the effects expect, too."""
        options = FitOptions(most=MOST, inputs="local", training=training)
        odd = self.expected[:, None] if knows else np.empty((len(self.expected), 0))
        process, _ = fit_process(
            self.samples.at(train), self.left[train], "", options, lambda text: tell(f"what is left: {text}"),
            odd=odd[train],
        )  # fmt: skip
        return process.mean(np.hstack([INPUT_SETS["local"](self.samples.at(test)), odd[test]]))


def remainder(
    likelihood: Likelihood,
    fits: Sequence[Fit],
    record: RingRecord,
    seen: np.ndarray,
    held: np.ndarray,
    tell: Callable[[str], None],
) -> Remainder | None:
    """Learned on rows that were seen (N,), scored on those held out; None where torch is missing or rows are few.

    fits: of the named effects, the one that is reported first."""
    target, reported = acceleration_pairs(likelihood, fits[0])
    what = _left(likelihood, fits[0], record, target, reported)
    train, test = what.among(seen), what.among(held)
    if min(len(train), len(test)) < FEWEST:
        return None
    tell("what is left, by a Gaussian process")
    predictions = []
    try:
        knows = _better_informed(what, list(inner_folds(record, seen)), tell)
        for fitted in fits:
            _, predicted = acceleration_pairs(likelihood, fitted)
            what = _left(likelihood, fitted, record, target, predicted)
            train, test = what.among(seen), what.among(held)
            better = np.full(len(target), np.nan)
            rows = what.samples.row[test]
            better[rows] = predicted[rows] + what.learned(train, test, knows, TRAINING, tell) / what.slope[test]
            predictions.append(better)
    except InputError:  # torch is an extra
        return None
    better = np.mean(predictions, axis=0)
    both = np.isfinite(better)
    before, after = nrmse(target, reported, both), nrmse(target, better, both)
    return Remainder(before, after, min(len(train), MOST)) if math.isfinite(after) else None


def _left(likelihood: Likelihood, fitted: Fit, record: RingRecord, target: Array, predicted: Array) -> _Left:
    """What is left of a target (N,) by what the named effects predict (N,)."""
    system, values = ring_of(likelihood), fitted.values
    samples = _samples(replace(record, theta=system.position(values)), system.radius)
    slope = system.slope(values)[samples.row]
    expected = predicted[samples.row] * slope
    left = target[samples.row] * slope - expected
    return _Left(samples, expected, left, slope, samples.good & np.isfinite(left))


def _better_informed(what: _Left, folds: Sequence[tuple[np.ndarray, np.ndarray]], tell: Callable[[str], None]) -> bool:
    """Whether a process that knows what the named effects predict leaves less on blocks of the seen rows."""
    pairs = [(what.among(learn), what.among(tried)) for learn, tried in folds]
    if min(len(rows) for pair in pairs for rows in pair) < FEWEST:
        return False
    without, with_it = (
        sum(
            float(np.sum((what.left[tried] - what.learned(learn, tried, knows, QUICK, tell)) ** 2))
            for learn, tried in pairs
        )
        for knows in (False, True)
    )
    return with_it < without


def _samples(record: RingRecord, radius: float) -> RingSamples:
    """The record with rates from before the window of the target."""
    columns: dict[str, Array] = {
        "t": record.t, "theta": record.theta, "beta": record.beta, "gamma": record.gamma,
        "segment": record.segment.astype(np.float64),
    }  # fmt: skip
    options = SampleOptions(ring=1, radius=radius, rates="delayed")
    return ring_samples(Table(columns), None, MATCHED, options)[1]
