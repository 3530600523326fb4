"""The position of the camera from the channels alone: the ball is never inside a wall.

Before a filter follows the ball, its measured positions are laid over the map, for offsets and scales of the camera on
a grid. A fit starts at the camera that puts most positions into channels. So the fit finds a camera that is off by
several millimetres.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from copy import copy

import numpy as np

from mazeplan.control.estimation.rigid_body_filter import BodyFilter, CameraView
from mazeplan.core.errors import TableError
from mazeplan.maze.geometry import Maze

FURTHEST, STEP = 0.01, 0.0005  # m, maximum and step of the camera's offset
SCALES = tuple(0.9 + 0.004 * i for i in range(51))
BLUR = 0.0012  # m, by which a position may lie in a wall
BETTER = 0.03  # minimum share of positions that a start brings into the channels in addition
MOST = 3000  # maximum number of positions
MIN_CHANNEL_SHARE = 0.72  # minimum share of positions in channels, for the right map; 0.86 and more were seen
FEWEST = 100  # minimum number of positions that say something about a map
NEAR_OPENING = 0.008  # m; positions so near an opening say nothing about the map: a ball may pass it, or lie in it
TICKS = np.arange(-FURTHEST, FURTHEST + STEP, STEP)
Seen = tuple[float, float, float]  # offset of the camera x, y (m) and scale


class _Places:
    """Measured positions of the ball, laid over a map."""

    def __init__(self, body: BodyFilter, maze: Maze) -> None:
        y = body.pictures.y[np.isfinite(body.pictures.y[:, 0])]
        self._y, self._maze, self._ball = y[:: max(len(y) // MOST, 1)], maze, body.walls.radius

    def __len__(self) -> int:
        return len(self._y)

    def without_openings(self) -> _Places:
        """The same positions, without those near openings."""
        rest = copy(self)
        for opening in self._maze.openings:
            r = self._maze.threshold_radius(opening)
            middle = r * np.array([math.cos(opening.angle), math.sin(opening.angle)])
            far = np.hypot(*(rest._y - middle).T) > 0.5 * opening.width + NEAR_OPENING
            rest._y = rest._y[far]
        return rest

    def share(self, camera: Seen) -> float:
        """Share of the positions in channels, for a camera. A ball that passes an opening is in no channel."""
        x, z, scale = camera
        r = np.hypot(self._y[:, 0] - x, self._y[:, 1] - z) / scale
        inside = np.zeros(len(r), dtype=bool)
        for ring in self._maze.rings:
            low = -math.inf if ring.is_disc else ring.inner_radius + self._ball - BLUR
            inside |= (r >= low) & (r <= ring.outer_radius - self._ball + BLUR)
        return float(inside.mean()) if len(r) else 0.0

    def best(self, tried: Iterable[Seen]) -> Seen:
        """The camera with most positions in channels. If several cameras are equally good, their mean."""
        scored = [(self.share(camera), camera) for camera in tried]
        most = max(share for share, _ in scored)
        x, z, scale = np.array([camera for share, camera in scored if share > most - 0.002]).mean(axis=0).tolist()
        return x, z, scale


def camera_starts(body: BodyFilter, view: CameraView, maze: Maze) -> dict[str, dict[str, float]]:
    """Numbers of the camera, by effect, that put more positions into channels than `view` does."""
    places = _Places(body, maze)
    seen = places.share((view.offset_x, view.offset_y, view.scale))
    x, z, _ = places.best((float(x), float(z), view.scale) for x in TICKS[::4] for z in TICKS[::4])
    near = TICKS[np.abs(TICKS) <= 4.0 * STEP]
    x, z, _ = best = places.best((x + float(dx), z + float(dz), view.scale) for dx in near for dz in near)
    out = {}
    if places.share(best) > seen + BETTER:
        out["camera_offset"] = {"offset_x": x, "offset_y": z}
    *_, scale = best = places.best((view.offset_x, view.offset_y, scale) for scale in SCALES)
    if places.share(best) > seen + BETTER:
        out["camera_scale"] = {"scale": scale}
    return out


def check_map(body: BodyFilter, maze: Maze, file: str | None) -> None:
    """Raise TableError if no camera puts enough of the positions into the channels of the map.

    Positions near openings do not count: in quick runs, these are two thirds."""
    places = _Places(body, maze).without_openings()
    if len(places) < FEWEST:
        return
    ticks = np.arange(-FURTHEST, FURTHEST + STEP, 4.0 * STEP).tolist()
    share = max(places.share((x, z, scale)) for x in ticks for z in ticks for scale in SCALES[::5])
    if share < MIN_CHANNEL_SHARE:
        problem = f"away from openings, the ball is in no ring of the map in {1.0 - share:.0%} of the samples"
        raise TableError(f"{problem}, wherever the camera is; expected --radius M, or another --map", file=file)
