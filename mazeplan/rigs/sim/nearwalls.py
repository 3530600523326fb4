"""Faster walls: MuJoCo simulates only the boxes of the walls near the ball.

Walls with 360 boxes to a circle are 1,700 boxes in all, and MuJoCo moves all of them in every step. This module divides
the floor into square cells. Each cell has its own model with only the boxes near the cell; everything else is a copy of
the whole model. The plate's mass does not depend on its boxes. The contacts equal those of the whole model, in the same
order. So the ball's motion is the same to the last bit.
"""

from __future__ import annotations

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module has no types)
import copy
import math
import sys
from contextlib import suppress
from functools import lru_cache
from typing import Any

import mujoco
import numpy as np

from mazeplan.core.constants import GRAVITY
from mazeplan.core.records import IntArray
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.sim.mjcf import PLUG_ON, bare_mjcf, mjcf, plug_name
from mazeplan.rigs.sim.settings import SimulatedSettings

CELL = 0.004  # m, side of a cell
FREE = 0.003  # m, minimum distance that the ball may go before a new model is chosen
FASTEST = 2.0  # m/s, largest speed of a ball; gravity alone gives 0.6
TILT = 1.5  # the plate swings to at most this many times the tilt limit
# maximum number of kept models; the newest are kept. A model has 0.23 MB and takes 0.8 ms to make. The maze cme has
# 2,800 cells; a run needs about 60
MOST_MODELS = 128
ARENA = 1 << 21  # bytes of MuJoCo's memory for contacts; the default of MuJoCo would be 14 MB a ball
BOX = mujoco.mjtGeom.mjGEOM_BOX
OPEN: frozenset[str] = frozenset()  # no opening has a plug
SEEN_WITH = ("geom_bodyid", "geom_dataid", "geom_matid", "geom_plugin")  # fields that are the same for all boxes


class NearWalls:
    """Models of one plate, one for each cell of the floor.

    any: a model without walls, whose MjData fit all models.
    slots: largest number of boxes in a model."""

    def __init__(self, text: str, bare: str, maze: Maze) -> None:
        """text: MJCF with all walls. bare: MJCF without walls. See `mjcf`."""
        self._whole = mujoco.MjModel.from_xml_string(text)
        self._boxes = _boxes(self._whole)
        self._plugs = {opening.name: _plug(self._whole, opening.name) for opening in maze.openings}
        self._timestep = float(self._whole.opt.timestep)
        self._free = max(FREE, FASTEST * self._timestep)
        reach = maze.ball.radius + self._free + _slack(maze) + math.sqrt(0.5) * CELL
        places, sizes = self._whole.geom_pos[self._boxes], self._whole.geom_size[self._boxes]
        self._half = float(np.max(np.hypot(places[:, 0], places[:, 1]) + np.hypot(sizes[:, 0], sizes[:, 1]))) + reach
        self._side = math.ceil(2.0 * self._half / CELL)
        self._near = self._boxes_near(reach)
        self.slots = maze.balls * max(len(boxes) for boxes in self._near.values())
        self.any = self._empty(bare)
        self._plate = mujoco.mj_name2id(self.any, mujoco.mjtObj.mjOBJ_BODY, "plate")
        self._own = [
            name
            for name in dir(self.any)
            if name.startswith("geom_") and name not in SEEN_WITH and len(getattr(self.any, name)) == self.any.ngeom
        ]
        self._models: dict[tuple[Any, frozenset[str]], mujoco.MjModel] = {}

    def at(self, x: float, y: float, blocked: frozenset[str] = OPEN) -> mujoco.MjModel:
        """The model for a ball at x, y, m, in the frame of the room, and for places up to `_free` m away.

        blocked: openings with a plug."""
        return self._of_cell(self._cell(x, y), blocked)

    def _cell(self, x: float, y: float) -> int:
        last = self._side - 1
        column = min(max(int((x + self._half) / CELL), 0), last)
        row = min(max(int((y + self._half) / CELL), 0), last)
        return row * self._side + column

    def near(self, data: mujoco.MjData, blocked: frozenset[str] = OPEN) -> mujoco.MjModel:
        """The model for the present place of the ball."""
        return self.at(data.qpos.item(2), data.qpos.item(3), blocked)

    def _of_cell(self, cell: int, blocked: frozenset[str] = OPEN) -> mujoco.MjModel:
        model = self._models.get((cell, blocked))
        return self._make(cell, blocked) if model is None else model

    def step(self, data: mujoco.MjData, steps: int, blocked: frozenset[str] = OPEN) -> None:
        """Simulate `steps` of MuJoCo's steps. For a fast ball, choose the model anew in each step."""
        x, y, vx, vy = (*data.qpos[2:4].tolist(), *data.qvel[2:4].tolist())
        most = steps * self._timestep
        if math.hypot(vx, vy) * most + GRAVITY * most * most <= self._free:
            mujoco.mj_step(self.at(x, y, blocked), data, nstep=steps)
            return
        for _ in range(steps):
            mujoco.mj_step(self.near(data, blocked), data)

    def _make(self, cell: int, blocked: frozenset[str]) -> mujoco.MjModel:
        """Make the model of a cell. Two threads may do this at once, because both make the same model."""
        return self._filled((cell, blocked), self._near.get(cell, self._boxes[:0]))

    def _filled(self, key: tuple[Any, frozenset[str]], boxes: IntArray) -> mujoco.MjModel:
        """Make a model with these boxes and keep it under a key: (cells of the balls, openings with a plug)."""
        model, blocked = self._blank(), key[1]
        slots = slice(1, 1 + len(boxes))  # behind the floor, in the order of the whole model
        for name in self._own:
            getattr(model, name)[slots] = getattr(self._whole, name)[boxes]
        for name in blocked:
            filled = 1 + np.flatnonzero(boxes == self._plugs[name])
            model.geom_contype[filled] = model.geom_conaffinity[filled] = PLUG_ON
        model.body_geomnum[self._plate] = 1 + len(boxes)  # the rest takes no part in collisions
        self._models[key] = model
        return model

    def _blank(self) -> mujoco.MjModel:
        """A model without boxes: a new one until MOST_MODELS are kept, then the oldest if nothing else uses it.

        Reuse avoids holes in the memory of the process, which new models in place of old ones would leave."""
        model = None
        while len(self._models) >= MOST_MODELS:
            with suppress(KeyError, RuntimeError, StopIteration):  # another thread was faster
                model = self._models.pop(next(iter(self._models)))
        if model is None or sys.getrefcount(model) > _ALONE:
            return copy.copy(self.any)
        filled = slice(1, int(model.body_geomnum[self._plate]))
        for name in self._own:
            getattr(model, name)[filled] = getattr(self.any, name)[filled]
        return model

    def _boxes_near(self, reach: float) -> dict[int, IntArray]:
        """{cell: numbers of the boxes within `reach` (m) of its middle}, in the whole model's order.

        The search goes from box to box, because each box is near few cells."""
        whole, walls = self._whole, self._boxes
        place, size, quaternion = whole.geom_pos[walls], whole.geom_size[walls], whole.geom_quat[walls]
        turn = 2.0 * np.arctan2(quaternion[:, 3], quaternion[:, 0])
        c, s = np.cos(turn)[:, None], np.sin(turn)[:, None]
        far = math.ceil((reach + float(np.hypot(size[:, 0], size[:, 1]).max())) / CELL)
        rows, columns = (part.ravel() for part in np.mgrid[-far : far + 1, -far : far + 1])
        home = np.floor((place[:, :2] + self._half) / CELL).astype(np.int64)
        column, row = home[:, :1] + columns, home[:, 1:] + rows  # (boxes, cells around)
        dx = (column + 0.5) * CELL - self._half - place[:, :1]
        dy = (row + 0.5) * CELL - self._half - place[:, 1:2]
        along, across = np.abs(c * dx + s * dy) - size[:, :1], np.abs(c * dy - s * dx) - size[:, 1:2]
        inside = (np.minimum(column, row) >= 0) & (np.maximum(column, row) < self._side)
        near = inside & (np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0)) <= reach)
        box = np.nonzero(near)[0]
        cell = (row * self._side + column)[near]
        order = np.argsort(cell, kind="stable")  # boxes of a cell stay in their order
        cells, begin = np.unique(cell[order], return_index=True)
        return dict(zip(cells.tolist(), np.split(walls[box[order]], begin[1:]), strict=True))

    def _empty(self, bare: str) -> mujoco.MjModel:
        """The model without walls, with `slots` boxes that touch nothing."""
        spec = mujoco.MjSpec.from_string(bare)
        for _ in range(self.slots):
            spec.body("plate").add_geom(type=BOX, size=[1e-4] * 3, contype=0, conaffinity=0)
        spec.memory = ARENA
        model = spec.compile()
        # MuJoCo's search tree of boxes would hold wrong places, and ball and plate are the only island
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE | mujoco.mjtDisableBit.mjDSBL_ISLAND)
        return model


class PairWalls(NearWalls):
    """Models for two balls: each has the boxes near either ball."""

    def step(self, data: mujoco.MjData, steps: int, blocked: frozenset[str] = OPEN) -> None:
        """See `NearWalls.step`."""
        speed = max(math.hypot(*data.qvel[v : v + 2].tolist()) for v in (2, 8))
        most = steps * self._timestep
        if speed * most + GRAVITY * most * most <= self._free:
            mujoco.mj_step(self.near(data, blocked), data, nstep=steps)
            return
        for _ in range(steps):
            mujoco.mj_step(self.near(data, blocked), data)

    def near(self, data: mujoco.MjData, blocked: frozenset[str] = OPEN) -> mujoco.MjModel:
        """The model for the present places of both balls."""
        one, other = (self._cell(data.qpos.item(q), data.qpos.item(q + 1)) for q in (2, 9))
        model = self._models.get(((one, other), blocked))
        if model is not None:
            return model
        none = self._boxes[:0]
        boxes = np.union1d(self._near.get(one, none), self._near.get(other, none))  # in the whole model's order
        return self._filled(((one, other), blocked), boxes)


def _alone() -> int:
    """The result of `sys.getrefcount` for an object to which only the calling function refers."""
    something = object()
    return sys.getrefcount(something)


_ALONE = _alone()


def near_walls(maze: Maze, settings: SimulatedSettings) -> NearWalls:
    """The models of a maze. Rigs with the same physics share these models."""
    return _of_settings(maze, settings)  # pyright: ignore[reportArgumentType] frozen, so pydantic gives them a hash


@lru_cache(maxsize=4)
def _of_settings(maze: Maze, settings: SimulatedSettings) -> NearWalls:
    """A cache by settings, because the text of a model takes 10 ms to write."""
    return _shared(mjcf(maze, settings), bare_mjcf(maze, settings), maze)


@lru_cache(maxsize=4)
def _shared(text: str, bare: str, maze: Maze) -> NearWalls:
    return (NearWalls if maze.balls == 1 else PairWalls)(text, bare, maze)


def _boxes(model: mujoco.MjModel) -> IntArray:
    """Numbers of the boxes on the plate: walls and plugs."""
    floor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, "floor")
    found = np.flatnonzero(model.geom_bodyid == mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "plate"))
    return found[found != floor]


def _plug(model: mujoco.MjModel, opening: str) -> int:
    return mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, plug_name(opening))


def _slack(maze: Maze) -> float:
    """Largest distance along the plate, m, between a ball in the room and its place in the plate's frame."""
    tilt = TILT * maze.tilt_limit * math.sqrt(2.0)
    rim = maze.walls[0].outer_radius
    return rim * (1.0 - math.cos(tilt)) + 2.0 * maze.ball.radius * math.sin(tilt)
