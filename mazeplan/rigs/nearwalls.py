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
from mazeplan.records import Array, IntArray
from mazeplan.rigs.mjcf import GRAVITY, PLUG_ON, bare_mjcf, mjcf, plug_name
from mazeplan.rigs.settings import SimulatedSettings

CELL = 0.004  # m, side of a cell
FREE = 0.003  # m, at least, that the ball may go before the model is asked for again
FASTEST = 2.0  # m/s, of a ball; one that is left alone on the plate reaches .6
TILT = 1.5  # times the tilt limit: what the plate may swing to
MOST_MODELS = 4000  # of .1 MB each; the maze cme has 2,800 cells
ARENA = 1 << 21  # bytes for contacts of a ball; MuJoCo would take 14 MB a ball
BOX = mujoco.mjtGeom.mjGEOM_BOX
OPEN: frozenset[str] = frozenset()  # no opening has a plug in it
SEEN_WITH = ("geom_bodyid", "geom_dataid", "geom_matid", "geom_plugin")  # what is not the box's own


class NearWalls:
    """Models of one plate, by where the ball is. `any` fits all of them: data are made from it. slots: boxes that a
    model has at most."""

    def __init__(self, text: str, bare: str, maze: Maze) -> None:
        """text, bare: the models with all walls and with none (`mjcf`)."""
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
        self.slots = max(len(boxes) for boxes in self._near.values())
        self.any = self._empty(bare)
        self._plate = mujoco.mj_name2id(self.any, mujoco.mjtObj.mjOBJ_BODY, "plate")
        self._own = [
            name
            for name in dir(self.any)
            if name.startswith("geom_") and name not in SEEN_WITH and len(getattr(self.any, name)) == self.any.ngeom
        ]
        self._models: dict[tuple[int, frozenset[str]], mujoco.MjModel] = {}

    def at(self, x: float, y: float, blocked: frozenset[str] = OPEN) -> mujoco.MjModel:
        """The model for a ball at x, y, m in the room, as long as it is not farther than `free` from there; blocked:
        openings with a plug in them."""
        last = self._side - 1
        column = min(max(int((x + self._half) / CELL), 0), last)
        row = min(max(int((y + self._half) / CELL), 0), last)
        return self._of_cell(row * self._side + column, blocked)

    def at_all(self, places: Array) -> list[mujoco.MjModel]:
        """The same for balls at places (N, 2)."""
        column, row = np.clip((places + self._half) / CELL, 0.0, self._side - 1.0).astype(np.int64).T
        return [self._of_cell(cell) for cell in (row * self._side + column).tolist()]

    def _of_cell(self, cell: int, blocked: frozenset[str] = OPEN) -> mujoco.MjModel:
        model = self._models.get((cell, blocked))
        return self._make(cell, blocked) if model is None else model

    def slow(self, velocities: Array, steps: int) -> np.ndarray:
        """Whether balls at velocities (N, 2), m/s, stay in reach of their models for so many steps, (N,) bool."""
        most = steps * self._timestep
        return np.hypot(velocities[:, 0], velocities[:, 1]) * most + GRAVITY * most * most <= self._free

    def step(self, data: mujoco.MjData, steps: int, blocked: frozenset[str] = OPEN) -> None:
        """Let so many of MuJoCo's steps pass; one after another where the ball is too fast to be looked for once."""
        x, y, vx, vy = (*data.qpos[2:4].tolist(), *data.qvel[2:4].tolist())
        most = steps * self._timestep
        if math.hypot(vx, vy) * most + GRAVITY * most * most <= self._free:
            mujoco.mj_step(self.at(x, y, blocked), data, nstep=steps)
            return
        for _ in range(steps):
            mujoco.mj_step(self.at(data.qpos.item(2), data.qpos.item(3), blocked), data)

    def _make(self, cell: int, blocked: frozenset[str]) -> mujoco.MjModel:
        """Two threads may do this at once: they make the same."""
        boxes = self._near.get(cell, self._boxes[:0])
        model = copy.copy(self.any)
        slots = slice(1, 1 + len(boxes))  # behind the floor, in the order of the whole model
        for name in self._own:
            getattr(model, name)[slots] = getattr(self._whole, name)[boxes]
        for name in blocked:
            filled = 1 + np.flatnonzero(boxes == self._plugs[name])
            model.geom_contype[filled] = model.geom_conaffinity[filled] = PLUG_ON
        model.body_geomnum[self._plate] = 1 + len(boxes)  # nobody looks for the ball at those behind
        if len(self._models) >= MOST_MODELS:
            self._models.clear()
        self._models[cell, blocked] = model
        return model

    def _boxes_near(self, reach: float) -> dict[int, IntArray]:
        """{cell: numbers of the boxes that are not farther than `reach` from its middle}, in the whole model's order.

        Looked for from the boxes, each of which is near few cells."""
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
        """The model without walls, with as many boxes as a cell may need: they touch nothing."""
        spec = mujoco.MjSpec.from_string(bare)
        for _ in range(self.slots):
            spec.body("plate").add_geom(type=BOX, size=[1e-4] * 3, contype=0, conaffinity=0)
        spec.memory = ARENA
        model = spec.compile()
        # a tree of boxes that was made for other places is of no use, and there is but one island: ball and plate
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE | mujoco.mjtDisableBit.mjDSBL_ISLAND)
        return model


def near_walls(maze: Maze, settings: SimulatedSettings) -> NearWalls:
    """The models of a maze, shared by all whose physics are the same."""
    return _of_settings(maze, settings)  # pyright: ignore[reportArgumentType] frozen, so pydantic gives them a hash


@lru_cache(maxsize=4)
def _of_settings(maze: Maze, settings: SimulatedSettings) -> NearWalls:
    """The text takes 10 ms to write."""
    return _shared(mjcf(maze, settings), bare_mjcf(maze, settings), maze)


@lru_cache(maxsize=4)
def _shared(text: str, bare: str, maze: Maze) -> NearWalls:
    return NearWalls(text, bare, maze)


def _boxes(model: mujoco.MjModel) -> IntArray:
    """Numbers of the boxes of the plate but for the floor: walls, and plugs, which may be switched on."""
    floor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, "floor")
    found = np.flatnonzero(model.geom_bodyid == mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "plate"))
    return found[found != floor]


def _plug(model: mujoco.MjModel, opening: str) -> int:
    return mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, plug_name(opening))


def _slack(maze: Maze) -> float:
    """How far, m, a ball in the room may be from its place in the plate's frame, seen along the plate."""
    tilt = TILT * maze.tilt_limit * math.sqrt(2.0)
    rim = maze.walls[0].outer_radius
    return rim * (1.0 - math.cos(tilt)) + 2.0 * maze.ball.radius * math.sin(tilt)
