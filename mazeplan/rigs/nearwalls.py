"""Walls that cost less: of the boxes that make up the walls, MuJoCo is shown only those that the ball could touch.

A wall of 360 boxes a circle puts 1,700 boxes on the plate, and each of them is moved with it in every step, wherever
the ball is. Here the floor is divided into square cells. Each cell has a model with the boxes near it alone, a copy of
the whole one in all else; the plate's mass does not hang on its boxes. As long as the model goes with the ball, each
contact is the one of the whole model, in the same order: the ball goes the same way to the last bit.
"""

from __future__ import annotations

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module tells type checkers nothing of its names)
import copy
import math
from functools import lru_cache

import mujoco
import numpy as np

from mazeplan.maze.geometry import Maze
from mazeplan.records import IntArray
from mazeplan.rigs.mjcf import GRAVITY, PLUG_ON, mjcf
from mazeplan.rigs.settings import SimulatedSettings

CELL = 0.004  # m, side of a cell
FREE = 0.003  # m, at least, that the ball may go before the model is asked for again
FASTEST = 2.0  # m/s, of a ball; one that is left alone on the plate reaches .6
TILT = 1.5  # times the tilt limit: what the plate may swing to
ARENA = 1 << 21  # bytes for contacts of a ball; MuJoCo would take 14 MB a ball
SEEN_WITH = ("geom_bodyid", "geom_dataid", "geom_matid", "geom_plugin")  # what is not the box's own


class NearWalls:
    """Models of one plate, by where the ball is. `any` fits all of them: data are made from it."""

    def __init__(self, text: str, maze: Maze) -> None:
        self._whole = mujoco.MjModel.from_xml_string(text)
        self._walls = _walls(self._whole)
        self._timestep = float(self._whole.opt.timestep)
        self._free = max(FREE, FASTEST * self._timestep)
        reach = maze.ball.radius + self._free + _slack(maze) + math.sqrt(0.5) * CELL
        places, sizes = self._whole.geom_pos[self._walls], self._whole.geom_size[self._walls]
        self._half = float(np.max(np.hypot(places[:, 0], places[:, 1]) + np.hypot(sizes[:, 0], sizes[:, 1]))) + reach
        self._side = math.ceil(2.0 * self._half / CELL)
        self._near = self._boxes_near(reach)
        self.slots = max(len(boxes) for boxes in self._near.values())  # boxes that a model has
        self.any = self._template(text)
        self._own = [
            name
            for name in dir(self.any)
            if name.startswith("geom_") and name not in SEEN_WITH and len(getattr(self.any, name)) == self.any.ngeom
        ]
        self._models: dict[int, mujoco.MjModel] = {}

    def at(self, x: float, y: float) -> mujoco.MjModel:
        """The model for a ball at x, y, m in the room, as long as it is not farther than `free` from there."""
        last = self._side - 1
        column = min(max(int((x + self._half) / CELL), 0), last)
        row = min(max(int((y + self._half) / CELL), 0), last)
        cell = row * self._side + column
        model = self._models.get(cell)
        return self._make(cell) if model is None else model

    def step(self, data: mujoco.MjData, steps: int) -> None:
        """Let so many of MuJoCo's steps pass; one after another where the ball is too fast to be looked for once."""
        x, y, vx, vy = (*data.qpos[2:4].tolist(), *data.qvel[2:4].tolist())
        most = steps * self._timestep
        if math.hypot(vx, vy) * most + GRAVITY * most * most <= self._free:
            mujoco.mj_step(self.at(x, y), data, nstep=steps)
            return
        for _ in range(steps):
            mujoco.mj_step(self.at(data.qpos.item(2), data.qpos.item(3)), data)

    def _make(self, cell: int) -> mujoco.MjModel:
        """Two threads may do this at once: they make the same."""
        model, boxes = copy.copy(self.any), self._near.get(cell, self._walls[:0])
        slots = slice(1, 1 + len(boxes))  # behind the floor, in the order of the whole model
        for name in self._own:
            getattr(model, name)[slots] = getattr(self._whole, name)[boxes]
        self._models[cell] = model
        return model

    def _boxes_near(self, reach: float) -> dict[int, IntArray]:
        """{cell: numbers of the boxes that are not farther than `reach` from its middle}, in the whole model's order.

        Looked for from the boxes, each of which is near few cells."""
        whole, walls = self._whole, self._walls
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

    def _template(self, text: str) -> mujoco.MjModel:
        """The whole model without its walls and plugs, with as many boxes as a cell may need: they touch nothing."""
        spec = mujoco.MjSpec.from_string(text)
        plate = spec.body("plate")
        for geom in list(plate.geoms):
            if geom.name != "floor":
                spec.delete(geom)
        for _ in range(self.slots):
            plate.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[1e-4] * 3, contype=0, conaffinity=0)
        spec.memory = ARENA
        model = spec.compile()
        # a tree of boxes that was made for other places is of no use, and there is but one island: ball and plate
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE | mujoco.mjtDisableBit.mjDSBL_ISLAND)
        return model


def near_walls(maze: Maze, settings: SimulatedSettings) -> NearWalls:
    """The models of a maze, shared by all whose physics are the same."""
    return _shared(mjcf(maze, settings), maze)


@lru_cache(maxsize=4)
def _shared(text: str, maze: Maze) -> NearWalls:
    return NearWalls(text, maze)


def _walls(model: mujoco.MjModel) -> IntArray:
    """Numbers of the boxes of the plate that touch the ball, but for the floor."""
    floor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, "floor")
    plate = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "plate")
    touching = (model.geom_bodyid == plate) & (model.geom_contype & PLUG_ON > 0)
    touching[floor] = False
    return np.flatnonzero(touching)


def _slack(maze: Maze) -> float:
    """How far, m, a ball in the room may be from its place in the plate's frame, seen along the plate."""
    tilt = TILT * maze.tilt_limit * math.sqrt(2.0)
    rim = maze.walls[0].outer_radius
    return rim * (1.0 - math.cos(tilt)) + 2.0 * maze.ball.radius * math.sin(tilt)
