"""Whether a changed gain of the servos predicts the measured tilt of blocks of time that took no part in its fit.

Commands that overtax the servos, as in navigation, say nothing about the ball beyond the measured tilt: the ball is
predicted from the sensor, by the old gain and by the new one alike. The tilt itself can be predicted, from commands.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mazeplan.core.records import Array
from mazeplan.diagnosis.record import RingRecord
from mazeplan.diagnosis.stage.plate_motion import BLOCK_S, Stage
from mazeplan.physics.rig.stage import StageAxis, passed_on, simulate_axis


def nearer_tilt(record: RingRecord, stage: Stage, was: tuple[float, float]) -> float:
    """Standard errors by which blocks of measured tilt are nearer with the record's own gains than with the old ones.

    was: gains of beta and gamma until now. Both kinds move by the lag of the fitted stage, with offsets of their own;
    each half of the record is predicted by gains and offsets of the other half. Raises ValueError without commands."""
    if record.u is None:
        raise ValueError("got a record without commands u_beta, u_gamma")
    blocks = np.arange(len(record)) // max(round(BLOCK_S / record.dt), 1)
    second = np.arange(len(record)) >= len(record) // 2
    gain = np.zeros(len(record))
    for axis, u, angle, old in zip(stage.axes, record.u.T, (record.beta, record.gamma), was, strict=True):
        follows = _follows(axis, u, record.dt)
        for rows in (second, ~second):
            errors = [_error(follows, angle, rows, value) for value in (old, None)]
            gain[rows] += errors[0] ** 2 - errors[1] ** 2
    by_block = np.bincount(blocks, weights=gain)
    return float(by_block.mean()) / max(float(by_block.std(ddof=1)) / math.sqrt(len(by_block)), 1e-12)


def _follows(axis: StageAxis, u: Array, dt: float) -> Array:
    """How an axis with gain one, without offset, follows commands u (N,)."""
    return simulate_axis(replace(axis, gain=1.0, offset=0.0), passed_on(u, axis), dt)


def _error(follows: Array, angle: Array, rows: np.ndarray, gain: float | None) -> Array:
    """Measured minus predicted angle (K,) in some rows, by offset and gain of the other rows; gain: if known."""
    other = ~rows
    if gain is None:
        columns = np.column_stack([follows[other], np.ones(int(other.sum()))])
        fitted, *_ = np.linalg.lstsq(columns, angle[other], rcond=None)
        return np.asarray(angle[rows] - fitted[0] * follows[rows] - fitted[1])
    return np.asarray(angle[rows] - gain * follows[rows] - np.mean(angle[other] - gain * follows[other]))
