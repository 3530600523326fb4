"""The spread of times, for reports."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def spread(values: Sequence[float]) -> dict[str, float]:
    """p50, p99 and max of the values; 0 without values."""
    if not values:
        return {"p50": 0.0, "p99": 0.0, "max": 0.0}
    p50, p99 = np.percentile(values, [50.0, 99.0])
    return {"p50": round(float(p50), 4), "p99": round(float(p99), 4), "max": round(float(max(values)), 4)}
