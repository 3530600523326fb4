"""What named effects leave of an acceleration, learned without a name: a Gaussian process on the residual.

    theta_dd - (what the model with all named effects predicts) ~ GP(inputs)

Inputs are the state as an opening sees it (`features.local_inputs`): tilts averaged as the target is, what they were a
while ago, the angle, and the rate of theta before the first sample of the target's window; and what the named effects
predict, since where they expect a blow it may come or not. None of them looks at what is predicted. Where the camera
was found to be off, angle and residual are those about the true centre. Kernel and training are those of the ball
models (`gp_training`); a rough kernel, since what is left comes from edges. It says how much better a model could
become that knows more, and names nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mazeplan.data.table import Table
from mazeplan.diagnosis.fit import Fit, Likelihood
from mazeplan.diagnosis.record import Record
from mazeplan.diagnosis.scores import MATCHED, acceleration_pairs, nrmse, plain, ring_of
from mazeplan.errors import InputError
from mazeplan.models.features import INPUT_SETS
from mazeplan.models.fitting import FitOptions, fit_process
from mazeplan.models.gp_training import TrainingOptions
from mazeplan.models.samples import RingSamples, SampleOptions, ring_samples
from mazeplan.records import Array

MOST = 5000  # rows of the process
FEWEST = 200  # rows from which something can be learned
TRAINING = TrainingOptions(first=900, rows=2000, starts=2, refinement=40, family="exponential")  # as `compare` has it


@dataclass(frozen=True)
class Remainder:
    """nRMSE of theta_dd on rows held out, of the named effects alone and with the process; rows it was trained on."""

    before: float
    nrmse: float
    rows: int

    def document(self) -> dict[str, Any]:
        """Plain and rounded."""
        return {"before": plain(self.before), "nrmse": plain(self.nrmse), "rows": self.rows}


def remainder(
    likelihood: Likelihood,
    fitted: Fit,
    record: Record,
    seen: np.ndarray,
    held: np.ndarray,
    tell: Callable[[str], None],
) -> Remainder | None:
    """Learned on rows that were seen (N,), scored on those held out; None where torch is missing or rows are few."""
    target, predicted = acceleration_pairs(likelihood, fitted)
    system, values = ring_of(likelihood), fitted.values
    samples = _samples(replace(record, theta=system.position(values)), system.radius)
    slope = system.slope(values)[samples.row]
    told = predicted[samples.row] * slope
    left = target[samples.row] * slope - told
    good = samples.good & np.isfinite(left)
    train, test = (np.flatnonzero(good & rows[samples.row]) for rows in (seen, held))
    if min(len(train), len(test)) < FEWEST:
        return None
    tell("what is left, by a Gaussian process")
    options = FitOptions(most=MOST, inputs="local", training=TRAINING)
    try:
        process, _ = fit_process(
            samples.at(train),
            left[train],
            "",
            options,
            lambda text: tell(f"what is left: {text}"),
            odd=told[train, None],
        )
    except InputError:  # torch is an extra
        return None
    better = np.full(len(target), np.nan)
    rows = samples.row[test]
    inputs = np.column_stack([INPUT_SETS["local"](samples.at(test)), told[test]])
    better[rows] = predicted[rows] + process.mean(inputs) / slope[test]
    both = np.isfinite(better)
    before, after = nrmse(target, predicted, both), nrmse(target, better, both)
    return Remainder(before, after, min(len(train), MOST)) if math.isfinite(after) else None


def _samples(record: Record, radius: float) -> RingSamples:
    """The record with rates from before the window of the target."""
    columns: dict[str, Array] = {
        "t": record.t, "theta": record.theta, "beta": record.beta, "gamma": record.gamma,
        "segment": record.segment.astype(np.float64),
    }  # fmt: skip
    options = SampleOptions(ring=1, radius=radius, rates="delayed")
    return ring_samples(Table(columns), None, MATCHED, options)[1]
