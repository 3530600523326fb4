"""A smooth record, and the samples of it."""

from __future__ import annotations

from typing import Any

import numpy as np
from ring_record import DT

from mazeplan.core.logs.table import Table
from mazeplan.learning.samples import (
    ring_samples,
)
from mazeplan.maze.mapfile import load_map

MAZE = load_map("cme")
N = 60
NUDGE = 1e-9  # s; so that rounding does not put a time just before its sample


def columns(n=N, **more):
    """A smooth record; what is given in `more` replaces or joins its columns, None takes one away."""
    t = np.arange(n) * DT
    found = {
        "t": t,
        "theta": 0.4 * np.sin(2.0 * t) + 0.1,
        "beta": 0.05 * np.sin(3.0 * t),
        "gamma": 0.04 * np.cos(2.5 * t),
        "ring": np.full(n, 2.0),
        **more,
    }
    return {name: column for name, column in found.items() if column is not None}


def samples_of(maze: Any = MAZE, smoothing=None, options=None, **more):
    """Samples of ring 2 of such a record."""
    return ring_samples(Table(columns(**more)), maze, smoothing, options)[2]


# --- stretches
