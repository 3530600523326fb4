"""The share of the other axis's command that an axis of the stage follows, too.

What a fitted axis leaves of the measured angle is regressed on how it follows its own command and the other one's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mazeplan.core.records import Array
from mazeplan.physics.effects.rig import axis_coupling
from mazeplan.physics.rig.stage import StageAxis
from mazeplan.physics.rig.stage_simulation import actuator_output, simulate_axis

BLOCK_S, SURE = 1.0, 5.0  # s, block of correlated residuals; minimum coupling, in standard errors
SMALLEST_COUPLING = axis_coupling.parameters["beta_from_gamma"].smallest
MOST_COUPLING = axis_coupling.parameters["beta_from_gamma"].high


def coupling(
    axis: StageAxis, own: Array, other: Array, angle: Array, dt: float, rows: np.ndarray
) -> tuple[float, float, Array]:
    """Share, its standard error, and how the axis follows the other command (N,), rad.

    own, other: commands (N,), rad
    angle: measured (N,), rad
    rows: rows (N,) to use

    The axis is sure to follow the other command if the share is above SMALLEST_COUPLING and SURE standard errors."""
    unit = replace(axis, gain=1.0, offset=0.0)
    follows, moved = (simulate_axis(one, actuator_output(u, axis), dt) for one, u in ((unit, other), (axis, own)))
    A = np.column_stack([follows, moved, np.ones(len(own))])[rows]
    left = (angle - moved)[rows]
    w, *_ = np.linalg.lstsq(A, left, rcond=None)
    e = left - A @ w
    inverse = np.linalg.inv(A.T @ A)
    block = np.arange(len(e)) // max(round(BLOCK_S / dt), 1)
    scores = np.stack([np.bincount(block, weights=column * e) for column in A.T], axis=1)
    sigma = float(np.sqrt((inverse @ (scores.T @ scores) @ inverse)[0, 0])) / axis.gain  # for correlated neighbours
    return min(max(float(w[0]) / axis.gain, -MOST_COUPLING), MOST_COUPLING), sigma, follows


def significant(share: float, sigma: float) -> bool:
    """Whether a coupling is large enough to change the other numbers of the axis."""
    return abs(share) >= max(SMALLEST_COUPLING, SURE * sigma)
