"""Residuals of a diagnosis as plain data (`evidence.json` beside `report.json`, which a report draws), and numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from mazeplan.core.records import Array

BINS = 24
FEWEST = 12  # minimum number of samples in a bin that is shown


@dataclass(frozen=True)
class Evidence:
    """Residual of one model.

    residual: whitened innovations (N,), NaN where there is none
    position, speed, time: of the same samples (N,)"""

    residual: Array
    position: Array
    speed: Array
    time: Array

    def document(self) -> dict[str, Any]:
        """Means of the residual against three variables."""
        return {
            "position": self._against(self.position, self.residual),
            "speed": self._against(self.speed, self.residual),
            "time": self._against(self.time, -self.residual * np.sign(self.speed)),  # against the motion
        }

    def _against(self, variable: Array, residual: Array) -> dict[str, list[float | None]]:
        """Mean of the residual, in standard deviations, in bins of a variable. All bins have equally many samples."""
        good = np.isfinite(residual) & np.isfinite(variable)
        e, x = residual[good], variable[good]
        edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, BINS + 1))) if len(x) else np.zeros(1)
        bins = np.digitize(x, edges[1:-1])
        parts = [(x[bins == i], e[bins == i]) for i in range(max(len(edges) - 1, 0))]
        parts = [(at, left) for at, left in parts if len(left) >= FEWEST]
        return {
            "at": [_number(at.mean()) for at, _ in parts],
            "mean": [_number(left.mean()) for _, left in parts],
            "stderr": [_number(left.std() / np.sqrt(len(left))) for _, left in parts],
        }


def _number(value: float) -> float | None:
    return float(f"{float(value):.5g}") if math.isfinite(value) else None


def rounded(value: float, digits: int) -> float | None:
    """A number of a document; None if not finite."""
    return round(float(value), digits) if math.isfinite(value) else None


def both_documents(pair: tuple[Any, Any]) -> dict[str, Any]:
    """The documents of a pair, before and after the effects were found."""
    return {"before": pair[0].document(), "after": pair[1].document()}
