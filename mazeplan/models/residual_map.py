"""Where in a ring, and at what speed, a model is off: what it leaves of theta_dd, in cells of angle and rate.

Impacts at the edges of openings show as stripes at fixed angles, friction as rows of one colour.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mazeplan.records import Array, IntArray

ANGLES = 36  # cells around the ring
SPEEDS = (1.0 / 3.0, 2.0 / 3.0, 1.0)  # quantiles of the speed that part the cells, each way round
FEWEST = 3  # samples in a cell of which something is told


@dataclass(frozen=True)
class ResidualMap:
    """rate (R + 1,): edges of the cells, rad/s; count (R, ANGLES): samples; mean, rms: by kind, (R, ANGLES) of measured
    less predicted, rad/s^2, NaN in cells with fewer than FEWEST. Column j: theta from 2 pi j / ANGLES on."""

    rate: Array
    count: IntArray
    mean: dict[str, Array]
    rms: dict[str, Array]

    def document(self) -> dict[str, Any]:
        """Plain and rounded; null in cells with too few samples."""

        def cells(values: Array) -> list[list[float | None]]:
            return [[None if math.isnan(v) else round(v, 3) for v in row] for row in values.tolist()]

        return {
            "rate": [round(v, 4) for v in self.rate.tolist()],
            "count": self.count.tolist(),
            "mean": {kind: cells(values) for kind, values in self.mean.items()},
            "rms": {kind: cells(values) for kind, values in self.rms.items()},
        }


def residual_map(theta: Array, theta_dot: Array, residuals: Mapping[str, Array]) -> ResidualMap:
    """Of samples at theta (N,), rad, with rates theta_dot (N,), rad/s; residuals: by kind, (N,), rad/s^2."""
    speed = np.quantile(np.abs(theta_dot), SPEEDS) if len(theta_dot) else np.array(SPEEDS)
    edges = np.concatenate([-speed[::-1], [0.0], speed])
    column = np.floor(np.mod(theta, 2.0 * math.pi) / (2.0 * math.pi) * ANGLES).astype(np.int64) % ANGLES
    row = np.clip(np.searchsorted(edges, theta_dot, side="right") - 1, 0, len(edges) - 2)
    shape = (len(edges) - 1, ANGLES)
    cell = row * ANGLES + column

    def summed(values: Array | None = None) -> Array:
        return np.bincount(cell, values, minlength=shape[0] * shape[1]).reshape(shape).astype(np.float64)

    count = summed().astype(np.int64)
    told = np.where(count >= FEWEST, count, np.nan)
    mean = {kind: summed(left) / told for kind, left in residuals.items()}
    rms = {kind: np.sqrt(summed(left * left) / told) for kind, left in residuals.items()}
    return ResidualMap(edges, count, mean, rms)
