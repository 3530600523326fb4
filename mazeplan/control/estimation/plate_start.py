"""Initial motion of the plate in each stretch of a record.

A simulated stage starts at rest, the real stage in motion. Both obey the same linear equation, so they differ by a free
motion, angle'' = -wn^2 angle - 2 zeta wn angle'. A least-squares fit to the first tilt samples gives the start (angle,
rate) of this free motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise

import numpy as np

from mazeplan.core.records import Array
from mazeplan.physics.dynamics.plate import PlateMotion
from mazeplan.physics.rig.stage import StageAxis

LOOKED_AT = 0.4  # s of samples for the fit
SETTLED = 1.5  # s until the free motion has died away


def with_true_starts(
    plate: PlateMotion, tilts: Array, begins: np.ndarray, dt: float, axes: Sequence[StageAxis]
) -> PlateMotion:
    """The simulated motion plus the free motion of each stretch.

    plate:         simulated motion; its grid begins with the first row
    tilts (N, 2):  measured beta and gamma, rad
    begins (N,):   whether a stretch begins
    dt:            time from row to row, s
    axes:          axes of beta and gamma"""
    per, motion = round(dt / plate.step), plate.motion.copy()
    rows, fine = max(round(LOOKED_AT / dt), 3), round(SETTLED / plate.step)
    whole = [_free(axis, plate.step, min(fine, len(motion))) for axis in axes]
    for a, b in pairwise([*np.flatnonzero(begins).tolist(), len(tilts)]):
        for i, free in enumerate(free[: (b - a) * per] for free in whole):
            n = min(rows, b - a, -(-len(free) // per))  # rows that the free motion reaches
            gap = tilts[a : a + n, i] - plate.motion[a * per : (a + n) * per : per, 3 * i]
            looked = free[: n * per : per, 0]
            good = np.isfinite(gap)
            if good.sum() < 3:
                continue
            start = np.linalg.lstsq(looked[good], gap[good], rcond=1e-6)[0]
            motion[a * per : a * per + len(free), 3 * i : 3 * i + 3] += free @ start
    return PlateMotion(plate.start, plate.step, motion)


@lru_cache(2)
def _free(axis: StageAxis, step: float, count: int) -> Array:
    """Free motion (count, 3, 2) of an axis: angle, rate, acceleration, for a start at angle 1 and for one at rate 1."""
    M, now = axis.transition(step), np.eye(2)
    out = np.empty((count, 3, 2))
    for i in range(count):
        out[i, :2] = now
        out[i, 2] = [axis.acceleration(*start) for start in now.T]
        now = M @ now
    return out
