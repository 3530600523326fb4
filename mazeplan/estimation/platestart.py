"""How the plate moved at the beginning of each stretch, where a simulation from the commands does not know it.

A simulated stage starts at rest where its commands hold it; the real one was left anywhere by what came before. Both
obey the same linear equation, so they differ by a free motion, angle'' = -wn^2 angle - 2 zeta wn angle', of which the
first samples of the tilt sensor tell the start (angle, rate) by least squares.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from mazeplan.physics.plate import PlateMotion
from mazeplan.physics.ring_parameters import stage_transition
from mazeplan.physics.stage import StageAxis
from mazeplan.records import Array

LOOKED_AT = 0.4  # s of the sensor behind a start
SETTLED = 1.5  # s after which nothing is left of a start


def with_true_starts(
    plate: PlateMotion, tilts: Array, first: np.ndarray, dt: float, axes: Sequence[StageAxis]
) -> PlateMotion:
    """The motion with the free motion behind each start put in. tilts (N, 2): measured beta, gamma, rad; first (N,): a
    stretch begins; dt: s; axes: of beta, gamma; the grid of `plate` begins with the first row."""
    per, motion = round(dt / plate.step), plate.motion.copy()
    rows, fine = max(round(LOOKED_AT / dt), 3), round(SETTLED / plate.step)
    for a, b in pairwise([*np.flatnonzero(first).tolist(), len(tilts)]):
        for i, axis in enumerate(axes):
            free = _free(axis, plate.step, min(fine, (b - a) * per))
            n = min(rows, b - a)
            gap = tilts[a : a + n, i] - plate.motion[a * per : (a + n) * per : per, 3 * i]
            looked = free[: n * per : per, 0]
            good = np.isfinite(gap)
            if good.sum() < 3:
                continue
            start = np.linalg.lstsq(looked[good], gap[good], rcond=1e-6)[0]
            motion[a * per : a * per + len(free), 3 * i : 3 * i + 3] += free @ start
    return PlateMotion(plate.start, plate.step, motion)


def _free(axis: StageAxis, step: float, count: int) -> Array:
    """Free motion (count, 3, 2) of an axis: angle, rate, acceleration, for a start at angle 1 and for one at rate 1."""
    wn, zeta = axis.natural_frequency, axis.damping
    M, now = stage_transition(wn, zeta, step), np.eye(2)
    out = np.empty((count, 3, 2))
    for i in range(count):
        out[i, :2], out[i, 2] = now, -wn * wn * now[0] - 2.0 * zeta * wn * now[1]
        now = M @ now
    return out
