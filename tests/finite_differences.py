"""The one finite-difference helper, against which analytic derivatives are compared."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np


def jacobian(f: Callable[[np.ndarray], Any], x: np.ndarray, step: float | np.ndarray = 1e-5) -> np.ndarray:
    """Derivatives of f at x (n,) by central differences of order 4, shape (*shape of f(x), n).

    step: one for all, or (n,), in the units of x. The error is of order step^4 times the fifth derivative, plus
    rounding of about 1e-16 |f| / step.
    """
    x = np.asarray(x, dtype=float)
    columns = []
    for i, h in enumerate(np.broadcast_to(np.asarray(step, dtype=float), x.shape)):
        values = []
        for k in (-2, -1, 1, 2):
            moved = x.copy()
            moved[i] += k * h
            values.append(np.array(f(moved), dtype=float))  # a copy: f may write into the same array each time
        columns.append((values[0] - 8.0 * values[1] + 8.0 * values[2] - values[3]) / (12.0 * h))
    return np.stack(columns, axis=-1)
