"""Commands that excite a rig: random sums of sines, as the published rig was excited.

50 sines per axis with frequencies drawn from [0, 1.5] Hz and phases from [0, 2 pi), 30 Hz; scaled so that the sum
stays within the tilt limit.
"""

from __future__ import annotations

import numpy as np

from mazeplan.core.records import Array

SINES = 50
BAND_HZ = (0.0, 1.5)
CREST = 2.5  # peak over standard deviation that is kept; rarer peaks are clipped at the limit


def multisine(
    rng: np.random.Generator, duration_s: float, rate_hz: float, limit: float, *, sines: int = SINES,
    band_hz: tuple[float, float] = BAND_HZ,
) -> Array:  # fmt: skip
    """Commands (N, 2) in rad for both axes over duration_s, each within +- limit."""
    t = np.arange(round(duration_s * rate_hz)) / rate_hz
    axes = []
    for _ in range(2):
        frequency, phase = rng.uniform(*band_hz, sines), rng.uniform(0.0, 2.0 * np.pi, sines)
        total = np.sin(2.0 * np.pi * np.outer(t, frequency) + phase).sum(axis=1)
        axes.append(np.clip(total / (CREST * np.sqrt(0.5 * sines)), -1.0, 1.0) * limit)
    return np.stack(axes, axis=1)
