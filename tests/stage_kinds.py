"""Axes of the stage of each usual kind, and commands that show of which kind an axis is."""

from __future__ import annotations

import math

import numpy as np

from mazeplan.physics.rig.stage import StageAxis

DT = 1.0 / 30.0
DEGREE = math.radians(1.0)
LIMIT = 5.0 * DEGREE
KINDS = {
    "at once": StageAxis.prompt(1.02, 0.0, 0.003),
    "late": StageAxis.prompt(0.97, 0.08, -0.002),
    "first order": StageAxis(1.03, 16.0, 1.0, 0.02, 0.002, order=1),
    "springy": StageAxis(0.98, 14.0, 0.35, 0.05, 0.001),
    "limited": StageAxis(1.0, 60.0, 1.0, 0.02, 0.002, order=0, rate_limit=0.87),
}


def jumps(seed: int, n: int, *, bang: bool = False) -> np.ndarray:
    """Commands (n, 2): level at first, then random angles, or full tilt either way, held for 2 to 15 samples."""
    rng = np.random.default_rng(seed)
    draw = (lambda: rng.choice([-LIMIT, LIMIT], n)) if bang else (lambda: rng.uniform(-LIMIT, LIMIT, n))
    u = np.stack([np.repeat(draw(), rng.integers(2, 16, n))[:n] for _ in range(2)], axis=1)
    u[0] = 0.0
    return u
