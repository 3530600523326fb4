"""Faster walls: MuJoCo simulates only the boxes of the walls near the ball.

Walls with 360 boxes to a circle are 1,700 boxes in all, and MuJoCo moves all of them in every step. This module divides
the floor into square cells. A rig's model has room for the boxes near one cell; they are exchanged when the ball comes
into another cell. The plate's mass does not depend on its boxes. The contacts equal those of the whole model, in the
same order. So the ball's motion is the same to the last bit.
"""

from __future__ import annotations

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module has no types)
import copy
import math
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
FREE = 0.003  # m, minimum distance that the ball may go before the boxes are chosen anew
FASTEST = 2.0  # m/s, largest speed of a ball; gravity alone gives 0.6
TILT = 1.5  # the plate swings to at most this many times the tilt limit
ARENA = 1 << 21  # bytes of MuJoCo's memory for contacts; the default of MuJoCo would be 14 MB a ball
BOX = mujoco.mjtGeom.mjGEOM_BOX
SEEN_WITH = ("geom_bodyid", "geom_dataid", "geom_matid", "geom_plugin")  # fields that are the same for all boxes


class NearWalls:
    """The boxes near each cell of the floor of one plate. Rigs with the same physics share it.

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
        self._empty = self._without_boxes(bare)
        self._plate = mujoco.mj_name2id(self._empty, mujoco.mjtObj.mjOBJ_BODY, "plate")
        names = [name for name in dir(self._empty) if name.startswith("geom_") and name not in SEEN_WITH]
        self._own = [name for name in names if len(getattr(self._empty, name)) == self._empty.ngeom]

    def model(self) -> mujoco.MjModel:
        """A new model with room for the boxes near the balls, but without boxes."""
        return copy.copy(self._empty)

    def fields(self, model: mujoco.MjModel) -> list[tuple[Any, Any]]:
        """(array of a model, array of the whole model) for each field in which boxes differ."""
        return [(getattr(model, name), getattr(self._whole, name)) for name in self._own]

    def cell(self, x: float, y: float) -> int:
        """The cell at x, y, m, in the frame of the room."""
        last = self._side - 1
        column = min(max(int((x + self._half) / CELL), 0), last)
        row = min(max(int((y + self._half) / CELL), 0), last)
        return row * self._side + column

    def stays_near(self, speed: float, steps: int) -> bool:
        """Whether a ball with this speed, m/s, stays near its cell for so many of MuJoCo's steps."""
        most = steps * self._timestep
        return speed * most + GRAVITY * most * most <= self._free

    def fill(
        self, model: mujoco.MjModel, fields: list[tuple[Any, Any]], cells: tuple[int, ...], blocked: frozenset[str]
    ) -> None:
        """Put the boxes near some cells into a model, in the order of the whole model.

        fields: of the model. blocked: openings with a plug"""
        boxes = self._near.get(cells[0], self._boxes[:0])
        for cell in cells[1:]:
            boxes = np.union1d(boxes, self._near.get(cell, self._boxes[:0]))
        slots = slice(1, 1 + len(boxes))  # behind the floor
        for own, whole in fields:
            own[slots] = whole[boxes]
        for name in blocked:
            filled = 1 + np.flatnonzero(boxes == self._plugs[name])
            model.geom_contype[filled] = model.geom_conaffinity[filled] = PLUG_ON
        model.body_geomnum[self._plate] = 1 + len(boxes)  # the rest takes no part in collisions

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

    def _without_boxes(self, bare: str) -> mujoco.MjModel:
        """The model without walls, with `slots` boxes that touch nothing."""
        spec = mujoco.MjSpec.from_string(bare)
        for _ in range(self.slots):
            spec.body("plate").add_geom(type=BOX, size=[1e-4] * 3, contype=0, conaffinity=0)
        spec.memory = ARENA
        model = spec.compile()
        # MuJoCo's search tree of boxes would hold wrong places, and ball and plate are the only island
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE | mujoco.mjtDisableBit.mjDSBL_ISLAND)
        return model


@lru_cache(maxsize=4)
def near_walls(maze: Maze, settings: SimulatedSettings) -> NearWalls:
    """The walls of a maze."""
    return NearWalls(mjcf(maze, settings), bare_mjcf(maze, settings), maze)


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
