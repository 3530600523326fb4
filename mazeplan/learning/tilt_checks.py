"""Whether the tilts of a record follow their commands, and the ball the tilts: exchanged columns and wrong signs."""

from __future__ import annotations

import numpy as np

from mazeplan.core.logs.table import Table
from mazeplan.core.records import Array
from mazeplan.physics.effects.ball import rolling_inertia

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


def check_follows(ring: int, factor: float) -> None:
    """Raise ValueError if the ball does not follow the tilt as a ball should."""
    allowed = rolling_inertia.parameters["factor"]
    if not allowed.low <= factor <= allowed.high:
        raise ValueError(
            f"ring {ring}: the ball does not follow the tilt: its acceleration is {factor:.2g} times that of a sliding "
            f"point, expected {allowed.low:g} to {allowed.high:g}; are x and y, or beta and gamma, swapped, a sign or "
            "a unit wrong?"
        )
