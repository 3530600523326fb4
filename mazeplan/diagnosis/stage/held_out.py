"""Whether a changed gain of the servos predicts the measured tilt in held-out blocks of time.

If commands overtax the servos, as in navigation, the ball is predicted from the measured tilt. This prediction is the
same with the old gain and with the new gain. But the commands predict the tilt, so the tilt can judge the gains.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mazeplan.core.records import Array
from mazeplan.diagnosis.record import RingRecord
from mazeplan.diagnosis.stage.plate_motion import BLOCK_S, Stage
from mazeplan.physics.rig.stage import StageAxis
from mazeplan.physics.rig.stage_simulation import actuator_output, simulate_axis


def nearer_tilt(record: RingRecord, stage: Stage, was: tuple[float, float]) -> float:
    """Standard errors by which the record's gains predict blocks of measured tilt better than the old gains.

    was: old gains of beta and gamma

    Both predictions use the lag of the fitted stage, each with its own offsets. Offsets and new gains for one half of
    the record come from the other half. Raises ValueError without commands."""
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
    """Angles (N,) of the axis under commands u (N,), with gain one and without offset."""
    return simulate_axis(replace(axis, gain=1.0, offset=0.0), actuator_output(u, axis), dt)


def _error(follows: Array, angle: Array, rows: np.ndarray, gain: float | None) -> Array:
    """Measured minus predicted angle (K,) in some rows. Offset and gain come from the other rows.

    gain: a known gain; None: fit it"""
    other = ~rows
    if gain is None:
        columns = np.column_stack([follows[other], np.ones(int(other.sum()))])
        fitted, *_ = np.linalg.lstsq(columns, angle[other], rcond=None)
        return np.asarray(angle[rows] - fitted[0] * follows[rows] - fitted[1])
    return np.asarray(angle[rows] - gain * follows[rows] - np.mean(angle[other] - gain * follows[other]))
