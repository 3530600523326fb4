"""A Gaussian process learns the residual of the named effects. It shows how much better a model could become.

    theta_dd - (prediction of the model with all named effects) ~ GP(inputs)

The Gaussian process gives no cause a name. Its inputs are the state as an opening sees it (`features.local_inputs`):

    tilts, averaged in the same way as the target, and earlier tilts
    angle of the ball
    rate of theta before the first sample of the target's window

The prediction of the named effects becomes an input, too, if it lowers the error on blocks of the seen rows. The reason
is that a blow may come or not where the effects expect it. No input is computed from the target.

If models with more parameters replaced some effects, a second Gaussian process learns the residual of the plainer fit.
The two predictions are averaged, because their chance errors differ. If the camera has an offset, angle and residual
refer to the true centre. Kernel and training are those of the ball models (`gp_training`). The kernel is a rough one,
because the residual comes from edges.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mazeplan.core.errors import InputError
from mazeplan.core.logs.table import Table
from mazeplan.core.progress import Words
from mazeplan.core.records import Array, IntArray
from mazeplan.diagnosis.record import RingRecord
from mazeplan.diagnosis.ring.fit import Fit, Likelihood
from mazeplan.diagnosis.ring.holdout import Folds, inner_folds
from mazeplan.diagnosis.ring.scores import MATCHED, acceleration_pairs, nrmse, rounded
from mazeplan.learning.features import INPUT_SETS
from mazeplan.learning.fitting import FitOptions, fit_process
from mazeplan.learning.gp_training import TrainingOptions
from mazeplan.learning.samples import RingSamples, SampleOptions, ring_samples

MOST = 5000  # maximum number of training rows
FEWEST = 200  # minimum number of rows to train or to test on
TRAINING = TrainingOptions(first=900, rows=2000, starts=2, refinement=40, family="exponential")  # same as `compare`
QUICK = replace(TRAINING, first=400, rows=1000, starts=1, iterations=15, refinement=25)  # for the choice of inputs


@dataclass(frozen=True)
class Remainder:
    """Errors on held-out rows.

    before: nRMSE of theta_dd with the named effects alone
    nrmse: nRMSE of theta_dd with the Gaussian process added
    rows: number of training rows"""

    before: float
    nrmse: float
    rows: int

    def document(self) -> dict[str, Any]:
        """Entry of the JSON document, rounded."""
        return {"before": rounded(self.before), "nrmse": rounded(self.nrmse), "rows": self.rows}


@dataclass(frozen=True)
class _Residual:
    """The residual of the named effects in n rows, about the true centre.

    samples: states
    expected: accelerations (n,) that the effects predict, rad/s^2
    residual: rad/s^2 (n,)
    slope: derivative (n,) of the true angle by the measured angle
    good: True (n,) where state and residual are known"""

    samples: RingSamples
    expected: Array
    residual: Array
    slope: Array
    good: np.ndarray

    def among(self, rows: np.ndarray) -> IntArray:
        """Indices of the good samples in these rows (N,) of the record."""
        return np.flatnonzero(self.good & rows[self.samples.row])

    def predict_residual(
        self, train: IntArray, test: IntArray, use_prediction: bool, training: TrainingOptions, tell: Words
    ) -> Array:
        """Prediction (K,) of the residual in the test rows, by a Gaussian process trained on the train rows.

        use_prediction: whether the prediction of the effects is an input"""
        options = FitOptions(most=MOST, inputs="local", training=training)
        odd = self.expected[:, None] if use_prediction else np.empty((len(self.expected), 0))
        process, _ = fit_process(
            self.samples.at(train), self.residual[train], "", options, lambda text: tell(f"what is left: {text}"),
            odd=odd[train],
        )  # fmt: skip
        return process.mean(np.hstack([INPUT_SETS["local"](self.samples.at(test)), odd[test]]))


def remainder(
    likelihood: Likelihood, fits: Sequence[Fit], record: RingRecord, seen: np.ndarray, held: np.ndarray, tell: Words
) -> Remainder | None:
    """Train on seen rows (N,) and score on held-out rows (N,). None if torch is missing or rows are few.

    fits: fits of the named effects; the first of them is the reported fit"""
    target, reported = acceleration_pairs(likelihood, fits[0])
    what = _residual(likelihood, fits[0], record, target, reported)
    train, test = what.among(seen), what.among(held)
    if min(len(train), len(test)) < FEWEST:
        return None
    tell("what is left, by a Gaussian process")
    predictions = []
    try:
        use_prediction = _better_informed(what, inner_folds(record, seen), tell)
        for fitted in fits:
            _, predicted = acceleration_pairs(likelihood, fitted)
            what = _residual(likelihood, fitted, record, target, predicted)
            train, test = what.among(seen), what.among(held)
            better = np.full(len(target), np.nan)
            rows = what.samples.row[test]
            better[rows] = (
                predicted[rows] + what.predict_residual(train, test, use_prediction, TRAINING, tell) / what.slope[test]
            )
            predictions.append(better)
    except InputError:  # torch is an extra
        return None
    better = np.mean(predictions, axis=0)
    both = np.isfinite(better)
    before, after = nrmse(target, reported, both), nrmse(target, better, both)
    return Remainder(before, after, min(len(train), MOST)) if math.isfinite(after) else None


def _residual(likelihood: Likelihood, fitted: Fit, record: RingRecord, target: Array, predicted: Array) -> _Residual:
    """The residual: target (N,) minus the accelerations (N,) that the named effects predict."""
    system, values = likelihood.system, fitted.values
    columns: dict[str, Array] = {
        "t": record.t, "theta": system.position(values), "beta": record.beta, "gamma": record.gamma,
        "segment": record.segment.astype(np.float64),
    }  # fmt: skip
    # rates of theta from before the target's window
    options = SampleOptions(ring=1, radius=system.radius, rates="delayed")
    samples = ring_samples(Table(columns), None, MATCHED, options)[1]
    slope = system.slope(values)[samples.row]
    expected = predicted[samples.row] * slope
    residual = target[samples.row] * slope - expected
    return _Residual(samples, expected, residual, slope, samples.good & np.isfinite(residual))


def _better_informed(what: _Residual, folds: Folds, tell: Words) -> bool:
    """Whether the prediction of the named effects, as an input, lowers the error on blocks of the seen rows."""
    pairs = [(what.among(learn), what.among(tried)) for learn, tried in folds]
    if min(len(rows) for pair in pairs for rows in pair) < FEWEST:
        return False
    errors = [0.0, 0.0]  # sums of squares without and with it
    for use_prediction in (False, True):
        for learn, tried in pairs:
            left = what.residual[tried] - what.predict_residual(learn, tried, use_prediction, QUICK, tell)
            errors[use_prediction] += float(np.sum(left**2))
    return errors[True] < errors[False]
