"""Whether changed gains or a changed coupling of the servos predict the measured tilt in held-out blocks of time.

If commands overtax the servos, as in navigation, the ball is predicted from the measured tilt. This prediction is the
same with the old numbers of the servos and with the new ones. But the commands predict the tilt, so the tilt can judge.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mazeplan.core.records import Array
from mazeplan.diagnosis.record import RingRecord
from mazeplan.diagnosis.stage.plate_motion import Stage
from mazeplan.learning.stage_axes import BLOCK_S
from mazeplan.physics.rig.stage import StageAxis
from mazeplan.physics.rig.stage_simulation import actuator_output, simulate_axis


def nearer_tilt(record: RingRecord, stage: Stage, was: tuple[float, float]) -> float:
    """Standard errors by which the record's gains predict blocks of measured tilt better than the old gains.

    was: old gains of beta and gamma

    Both predictions use the lag of the fitted stage, each with its own offsets. Offsets and new gains for one half of
    the record come from the other half. Raises ValueError without commands."""
    second, gain = np.arange(len(record)) >= len(record) // 2, np.zeros(len(record))
    for axis, u, angle, old in zip(stage.axes, _commands(record).T, (record.beta, record.gamma), was, strict=True):
        follows = _follows(axis, u, record.dt)
        for rows in (second, ~second):
            known = angle - old * follows
            errors = known[rows] - np.mean(known[~rows]), _left(angle, [follows], rows)
            gain[rows] += errors[0] ** 2 - errors[1] ** 2
    return _standard_errors(gain, record.dt)


def nearer_by_coupling(record: RingRecord, stage: Stage, was: tuple[float, float]) -> float:
    """As `nearer_tilt`, for couplings: the share of the other axis' command that an axis follows.

    was: old couplings of beta and gamma

    Gains come from the other half of the record in both predictions."""
    second, gain = np.arange(len(record)) >= len(record) // 2, np.zeros(len(record))
    u = _commands(record)
    for axis, own, other, angle, old in zip(
        stage.axes, u.T, u.T[::-1], (record.beta, record.gamma), was, strict=True
    ):  # fmt: skip
        follows = [_follows(axis, command, record.dt) for command in (own, other)]
        for rows in (second, ~second):
            before = _left(angle, [follows[0] + old * follows[1]], rows)
            gain[rows] += before**2 - _left(angle, follows, rows) ** 2
    return _standard_errors(gain, record.dt)


def _commands(record: RingRecord) -> Array:
    if record.u is None:
        raise ValueError("got a record without commands u_beta, u_gamma")
    return record.u


def _standard_errors(gain: Array, dt: float) -> float:
    """Mean of gains (N,) over blocks of BLOCK_S s, in standard errors of this mean."""
    blocks = np.arange(len(gain)) // max(round(BLOCK_S / dt), 1)
    by_block = np.bincount(blocks, weights=gain)
    return float(by_block.mean()) / max(float(by_block.std(ddof=1)) / math.sqrt(len(by_block)), 1e-12)


def _follows(axis: StageAxis, u: Array, dt: float) -> Array:
    """Angles (N,) of the axis under commands u (N,), with gain one and without offset."""
    return simulate_axis(replace(axis, gain=1.0, offset=0.0), actuator_output(u, axis), dt)


def _left(angle: Array, follows: Sequence[Array], rows: np.ndarray) -> Array:
    """Measured minus predicted angle (K,) in some rows. Offset and factors of `follows` come from the other rows."""
    columns = np.column_stack([*follows, np.ones(len(angle))])
    fitted, *_ = np.linalg.lstsq(columns[~rows], angle[~rows], rcond=None)
    return np.asarray(angle[rows] - columns[rows] @ fitted)
