"""Acausal smoothing and derivatives of sampled signals."""

from __future__ import annotations

import numpy as np
from scipy.signal import savgol_filter

from mazeplan.records import Array


def smoothed(signal: Array, window: int, *, deriv: int = 0, dt: float = 1.0) -> Array:
    """Savitzky-Golay estimate, cubic over `window` samples (odd), of a signal (N,) or its derivative (per dt^deriv)."""
    return np.asarray(savgol_filter(signal, window, 3, deriv=deriv, delta=dt), dtype=np.float64)
