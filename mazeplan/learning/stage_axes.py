"""Both axes of the stage: exchanged columns and wrong signs; fits of one order, each with the share of the other one's
command that the axis follows, too.

What a fitted axis leaves of the measured angle is regressed on how it follows its own command and the other one's."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mazeplan.core.logs.table import Table
from mazeplan.core.records import Array
from mazeplan.core.side_by_side import in_processes
from mazeplan.learning.axis_record import determined
from mazeplan.learning.stage_fit import StageFit, fit_axis
from mazeplan.physics.effects.rig import axis_coupling
from mazeplan.physics.rig.stage import StageAxis, actuator_output, simulate_axis

BLOCK_S, SURE = 1.0, 5.0  # s, block of correlated residuals; minimum coupling, in standard errors
SMALLEST_COUPLING = axis_coupling.parameters["beta_from_gamma"].smallest
NEARLY = 1.1  # times the rms of a fit: another fit of the axis that leaves less is as good
MOST_COUPLING = axis_coupling.parameters["beta_from_gamma"].high
LAG_S, EXCHANGED = 0.4, 0.6  # s, of a servo; size of a correlation that only exchanged or turned tilts have
FEWEST = 20  # rows with a tilt


def check_axes(table: Table) -> None:
    """Raise ValueError if the measured tilts are exchanged or turned round, beside commands up to LAG_S before."""
    angles = np.column_stack([table["beta"], table["gamma"]])
    commands = np.column_stack([table["u_beta"], table["u_gamma"]])
    size, high = np.zeros((2, 2)), np.zeros((2, 2))  # most of the correlations of each angle (row) with each command
    seen = np.isfinite(angles[:, 0]) & np.isfinite(angles[:, 1])
    for lag in range(round(LAG_S / table.dt)):
        rows = np.flatnonzero(seen[lag:])
        if len(rows) < FEWEST:
            return
        here = _unit(angles[lag:][rows]).T @ _unit(commands[rows])
        size, high = np.maximum(size, np.abs(here)), np.maximum(high, here)
    if min(size[0, 1], size[1, 0]) > EXCHANGED > max(size[0, 0], size[1, 1]):
        raise ValueError("beta follows u_gamma and gamma follows u_beta: are the two measured tilts exchanged?")
    # a sine has both signs: it follows its command, and half a period later the opposite of it
    turned = [name for i, name in enumerate(("beta", "gamma")) if size[i, i] > EXCHANGED > high[i, i]]
    if turned:
        raise ValueError(f"the measured tilt of {' and '.join(turned)} has the opposite sign of its command")


def _unit(x: Array) -> Array:
    """Columns (N, 2) around their means, each of length 1; 0 where nothing changes."""
    x = x - x.mean(axis=0)
    return np.asarray(x / np.maximum(np.linalg.norm(x, axis=0), 1e-12), dtype=np.float64)


def fit_axes(u: Array, angles: Array, dt: float, breaks: np.ndarray) -> tuple[StageFit, StageFit]:
    """The fits of beta and gamma. The servos of a rig are of one kind: both axes get the same order if the axis that
    changes for it fits nearly as well. Raises ValueError as `fit_axis`.

    u, angles: commands and measured angles (N, 2), rad
    breaks: True (N,) where a new record begins"""

    def fitted(i: int, kind: StageAxis | None = None) -> StageFit:
        return _coupled(u[:, i], u[:, 1 - i], angles[:, i], dt, breaks, kind)

    beta, gamma = in_processes(fitted, (0, 1))
    if beta.axis.order == gamma.axis.order:
        return beta, gamma
    like_gamma, like_beta = fitted(0, gamma.axis), fitted(1, beta.axis)
    ways = [(like_gamma, beta, (like_gamma, gamma)), (like_beta, gamma, (beta, like_beta))]
    alike = [(new.rms / old.rms, both) for new, old, both in ways if determined(new.axis)]
    more, both = min(alike, default=(math.inf, (beta, gamma)), key=lambda way: way[0])
    return both if more < NEARLY else (beta, gamma)


def _coupled(own: Array, other: Array, angle: Array, dt: float, breaks: np.ndarray, kind: StageAxis | None) -> StageFit:
    """The fit of an axis, with the share of the other axis's command that it surely follows."""
    found = fit_axis(own, angle, dt, breaks, kind=kind)
    share, sigma, follows = coupling(found.axis, own, other, angle, dt, np.isfinite(angle))
    if not significant(share, sigma):
        return found
    again = fit_axis(own, angle - found.axis.gain * share * follows, dt, breaks, kind=kind)
    stderr = {**again.axis.stderr, "coupling": sigma}
    return replace(again, axis=replace(again.axis, coupling=share, stderr=stderr))


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
