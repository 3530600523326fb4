"""Where the camera is, from the channels alone: the ball is never inside a wall.

Before a filter follows the ball, the places at which it was seen are laid over the map, for camera positions and scales
on a grid. The one with most places in channels is where a fit begins, so that a camera that is off by several
millimetres is found, not refused.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from mazeplan.errors import TableError
from mazeplan.estimation.bodyfilter import BodyFilter, View
from mazeplan.maze.geometry import Maze
from mazeplan.records import Array

FURTHEST, STEP = 0.01, 0.0005  # m, of the camera's middle
SCALES = tuple(0.9 + 0.004 * i for i in range(51))
BLUR = 0.0012  # m, by which a place may be in a wall
BETTER = 0.03  # share of the places that a start has to bring into the channels
MOST = 3000  # places that are looked at
FEWEST = 0.6  # share of the places in channels, below which the map is another one; a run passes openings, too


def camera_starts(body: BodyFilter, view: View, maze: Maze) -> dict[str, dict[str, float]]:
    """Numbers of the camera, by effect, with which the ball is seen in the channels more often than as in `view`."""
    y = body.pictures.y[np.isfinite(body.pictures.y[:, 0])]
    y = y[:: max(len(y) // MOST, 1)]
    seen = _share(y, view.offset_x, view.offset_y, view.scale, maze, body.walls.radius)
    ticks = np.arange(-FURTHEST, FURTHEST + STEP, STEP)
    coarse = [(float(x), float(z), view.scale) for x in ticks[::4] for z in ticks[::4]]
    x, z, _ = _best(y, coarse, maze, body.walls.radius)
    near = ticks[np.abs(ticks) <= 4.0 * STEP]
    x, z, _ = best = _best(
        y, ((x + float(dx), z + float(dz), view.scale) for dx in near for dz in near), maze, body.walls.radius
    )
    out = {}
    if _share(y, *best, maze, body.walls.radius) > seen + BETTER:
        out["camera_offset"] = {"offset_x": x, "offset_y": z}
    *_, scale = best = _best(
        y, ((view.offset_x, view.offset_y, scale) for scale in SCALES), maze, body.walls.radius
    )  # fmt: skip
    if _share(y, *best, maze, body.walls.radius) > seen + BETTER:
        out["camera_scale"] = {"scale": scale}
    return out


def check_map(body: BodyFilter, maze: Maze, file: str | None) -> None:
    """Raises TableError for places that no camera could have seen in the channels of the map."""
    y = body.pictures.y[np.isfinite(body.pictures.y[:, 0])]
    y = y[:: max(len(y) // MOST, 1)]
    ticks = np.arange(-FURTHEST, FURTHEST + STEP, 4.0 * STEP)
    cameras = ((float(x), float(z), scale) for x in ticks for z in ticks for scale in SCALES[::5])
    share = max(_share(y, *camera, maze, body.walls.radius) for camera in cameras)
    if share < FEWEST:
        problem = f"the ball is in no ring of the map in {1.0 - share:.0%} of the samples that show it"
        raise TableError(f"{problem}, wherever the camera is; expected --radius M, or another --map", file=file)


def _best(
    y: Array, tried: Iterable[tuple[float, float, float]], maze: Maze, radius: float
) -> tuple[float, float, float]:
    """The camera with most places in channels; of several that are as good, the one in their middle."""
    scored = [(_share(y, *camera, maze, radius), camera) for camera in tried]
    most = max(share for share, _ in scored)
    good = np.array([camera for share, camera in scored if share > most - 0.002])
    x, z, scale = good.mean(axis=0).tolist()
    return x, z, scale


def _share(y: Array, x: float, z: float, scale: float, maze: Maze, radius: float) -> float:
    """Share of places in channels, as a camera at (x, z) with this scale sees them. Where the ball passes from ring to
    ring it is in no channel, whatever the camera."""
    r = np.hypot(y[:, 0] - x, y[:, 1] - z) / scale
    inside = np.zeros(len(r), dtype=bool)
    for ring in maze.rings:
        low = -math.inf if ring.is_disc else ring.inner_radius + radius - BLUR
        inside |= (r >= low) & (r <= ring.outer_radius - radius + BLUR)
    return float(inside.mean()) if len(r) else 0.0
