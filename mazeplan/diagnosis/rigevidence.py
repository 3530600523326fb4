"""What a report of a whole rig shows beside its document: plain data, as a file (evidence.json) beside report.json."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mazeplan.diagnosis.bodyverdict import BodyVerdict
from mazeplan.estimation.bodyfilter import Filtered
from mazeplan.estimation.bodyfit import BLOCK_S, autocorrelation
from mazeplan.maze.geometry import Maze
from mazeplan.records import Array

CELLS = 40  # of the map of what is left, along each side
FEWEST = 4  # pictures in a cell that is drawn
LAGS = 10  # pictures


def rig_evidence(done: BodyVerdict, maze: Maze, map_text: str, title: str) -> dict[str, Any]:
    """Errors by samples ahead (rad), gain by blocks of time, what is left by place and from picture to picture."""
    found = done.searched
    parts = {"before": found.first.filtered, "after": found.fit.filtered}
    reach = max(ring.outer_radius for ring in maze.rings)
    gain = done.held.gain.tolist()
    return {
        "kind": "rig", "title": title, "map": map_text, "reach": reach,
        "ahead_s": (done.body.pictures.dt * np.arange(1, len(done.held.before) + 1)).round(4).tolist(),
        "error": {when: _rounded(np.nanmean(getattr(done.held, when), axis=1)) for when in ("before", "after")},
        "quartile": {
            when: _rounded(np.nanquantile(getattr(done.held, when), 0.75, axis=1)) for when in ("before", "after")
        },
        "block_s": BLOCK_S, "gain": [round(float(g), 2) for g in gain] if any(gain) else [],
        "left": {when: _by_place(filtered, reach) for when, filtered in parts.items()},
        "correlation": {when: _rounded(autocorrelation(filtered, LAGS)) for when, filtered in parts.items()},
        "white": round(2.0 / math.sqrt(2.0 * max(int(np.isfinite(parts["after"].nu[:, 0]).sum()), 1)), 5),
        "remaining": {"then": round(done.was.remaining, 3), "after": round(done.remaining, 3)},
    }  # fmt: skip


def _rounded(values: Array) -> list[float | None]:
    return [round(float(v), 5) if math.isfinite(v) else None for v in values]


def _by_place(filtered: Filtered, reach: float) -> list[list[float | None]]:
    """How large what a filter did not expect was, in its standard deviations, root mean square in cells of the plate;
    rows are y, from -reach on."""
    keep = np.isfinite(filtered.nu[:, 0])
    size = np.mean(filtered.whitened() ** 2, axis=1)
    x, y = filtered.state[keep, :2].T
    edges = np.linspace(-reach, reach, CELLS + 1)
    counts, *_ = np.histogram2d(y, x, (edges, edges))
    sums, *_ = np.histogram2d(y, x, (edges, edges), weights=size)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(counts >= FEWEST, np.sqrt(sums / counts), np.nan)
    return [[round(float(v), 2) if math.isfinite(v) else None for v in row] for row in mean]
