"""The place of the camera by the channels alone: the ball is never inside a wall.

Before a filter follows the ball, its seen places are laid over the map, for camera positions and scales on a grid.
A fit begins at the camera with most places in channels. So a camera that is off by several millimetres is found.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from mazeplan.control.estimation.rigid_body_filter import BodyFilter, CameraView
from mazeplan.core.errors import TableError
from mazeplan.maze.geometry import Maze

FURTHEST, STEP = 0.01, 0.0005  # m, of the camera's middle
SCALES = tuple(0.9 + 0.004 * i for i in range(51))
BLUR = 0.0012  # m, by which a place may be in a wall
BETTER = 0.03  # share of the places that a start has to bring into the channels
MOST = 3000  # places
FEWEST = 0.6  # share of the places in channels, below which the map is another one; a run passes openings, too
TICKS = np.arange(-FURTHEST, FURTHEST + STEP, STEP)
Seen = tuple[float, float, float]  # middle of the camera's picture x, y (m) and scale


class _Places:
    """Places at which the ball was seen, laid over a map."""

    def __init__(self, body: BodyFilter, maze: Maze) -> None:
        y = body.pictures.y[np.isfinite(body.pictures.y[:, 0])]
        self._y, self._maze, self._ball = y[:: max(len(y) // MOST, 1)], maze, body.walls.radius

    def share(self, camera: Seen) -> float:
        """Share of the places in channels for a camera. A ball that passes an opening is in no channel."""
        x, z, scale = camera
        r = np.hypot(self._y[:, 0] - x, self._y[:, 1] - z) / scale
        inside = np.zeros(len(r), dtype=bool)
        for ring in self._maze.rings:
            low = -math.inf if ring.is_disc else ring.inner_radius + self._ball - BLUR
            inside |= (r >= low) & (r <= ring.outer_radius - self._ball + BLUR)
        return float(inside.mean()) if len(r) else 0.0

    def best(self, tried: Iterable[Seen]) -> Seen:
        """The camera with most places in channels; the middle of several that are as good."""
        scored = [(self.share(camera), camera) for camera in tried]
        most = max(share for share, _ in scored)
        x, z, scale = np.array([camera for share, camera in scored if share > most - 0.002]).mean(axis=0).tolist()
        return x, z, scale


def camera_starts(body: BodyFilter, view: CameraView, maze: Maze) -> dict[str, dict[str, float]]:
    """Numbers of the camera, by effect, that put more places into channels than `view` does."""
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
    """Raises TableError for places that no camera could have seen in the channels of the map."""
    places = _Places(body, maze)
    ticks = np.arange(-FURTHEST, FURTHEST + STEP, 4.0 * STEP).tolist()
    share = max(places.share((x, z, scale)) for x in ticks for z in ticks for scale in SCALES[::5])
    if share < FEWEST:
        problem = f"the ball is in no ring of the map in {1.0 - share:.0%} of the samples that show it"
        raise TableError(f"{problem}, wherever the camera is; expected --radius M, or another --map", file=file)
