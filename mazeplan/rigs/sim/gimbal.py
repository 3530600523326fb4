"""Plate, servos and ball in a MuJoCo model.

Positions and velocities of the ball are in the room's frame, relative to the plate's centre. `machine` converts them to
the plate's frame.

Walls with 360 boxes to a circle are 1,700 boxes in all, and MuJoCo moves all of them in every step. `NearWalls` divides
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
from mazeplan.core.records import Array, IntArray
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.sim.mjcf import PLUG_OFF, PLUG_ON, mjcf, plug_name
from mazeplan.rigs.sim.settings import SimulatedSettings

CELL = 0.004  # m, side of a cell
BOX_MARGIN_M = 0.003  # m, minimum distance that the ball may go before the boxes are chosen anew
FASTEST = 2.0  # m/s, largest speed of a ball; gravity alone gives 0.6
TILT = 1.5  # the plate swings to at most this many times the tilt limit
ARENA = 1 << 21  # bytes of MuJoCo's memory for contacts; the default of MuJoCo would be 14 MB a ball
BOX = mujoco.mjtGeom.mjGEOM_BOX
SEEN_WITH = ("geom_bodyid", "geom_dataid", "geom_matid", "geom_plugin")  # fields that are the same for all boxes


class Gimbal:
    """Plate and ball of the model that `mjcf` writes. Its joints are beta, gamma, then the ball's; its actuators are
    beta, gamma.

    steps: number of MuJoCo's steps in one chunk.
    ball: number of the ball's body, and addresses of its free joint in qpos and in qvel."""

    def __init__(self, model: mujoco.MjModel, steps: int, ball: tuple[int, int, int] | None = None) -> None:
        self.model = model
        self.data = mujoco.MjData(model)
        self.steps = steps
        self._body, self._q, self._v = ball or (model.body("ball").id, 2, 2)

    def reset(self, *positions: Array) -> None:
        """Level the plate, set velocities and time to 0, put each ball at a position (3,) in the plate's frame, m."""
        self._to_start(*positions)
        mujoco.mj_forward(self.model, self.data)

    def _to_start(self, *positions: Array) -> None:
        mujoco.mj_resetData(self.model, self.data)
        for index, position in enumerate(positions):
            self.data.qpos[2 + 7 * index : 5 + 7 * index] = position
            self.data.qpos[5 + 7 * index] = 1.0

    def drive(self, tilt: Array) -> None:
        """Give the servos their set points: beta, gamma, rad, (2,)."""
        self.data.ctrl[:] = tilt

    def advance(self) -> None:
        """Simulate one chunk."""
        mujoco.mj_step(self.model, self.data, nstep=self.steps)

    def plug(self, opening: str, there: bool) -> None:
        """Close an opening with a plug, or open it again."""
        geom = self.model.geom(plug_name(opening))
        geom.contype[:] = geom.conaffinity[:] = PLUG_ON if there else PLUG_OFF

    @property
    def tilt(self) -> tuple[float, float]:
        """beta, gamma, rad."""
        return float(self.data.qpos[0]), float(self.data.qpos[1])

    def plate(self) -> tuple[Array, Array]:
        """Rotation (3, 3) from the plate frame to the room, and the plate's angular velocity (3,) in its own frame."""
        data = self.data
        b, c = float(data.qpos[0]), float(data.qpos[1])
        cb, sb, cc, sc = math.cos(b), math.sin(b), math.cos(c), math.sin(c)
        plate = np.array([[cb, sb * sc, sb * cc], [0.0, cc, -sc], [-sb, cb * sc, cb * cc]])
        # the inner joint gamma turns about x, the outer joint beta turns about y
        return plate, np.array([data.qvel[1], cc * data.qvel[0], -sc * data.qvel[0]])

    def drawn(self) -> Array:
        """Rotation (3, 3) of the plate at the beginning of MuJoCo's last step."""
        return self.data.body("plate").xmat.reshape(3, 3)

    def place(self, index: int = 0) -> Array:
        """Position of a ball, (3,), m; the first one has index 0."""
        q = self._q + 7 * index
        return self.data.qpos[q : q + 3] - self._centre()

    def velocity(self) -> Array:
        """Velocity of the ball, (3,), m/s."""
        return self.data.qvel[self._v : self._v + 3] - self._drift()

    def spin(self) -> Array:
        """Angular velocity of the ball, (3,), rad/s."""
        return self.ball_rotation() @ self.data.qvel[self._v + 3 : self._v + 6]

    def put(self, place: Array, velocity: Array, spin: Array) -> None:
        """Set the ball's state, (3,) each."""
        data, v = self.data, self._v
        data.qpos[self._q : self._q + 3] = self._centre() + place
        data.qvel[v : v + 3] = velocity + self._drift()
        data.qvel[v + 3 : v + 6] = self.ball_rotation().T @ spin

    def rest(self, place: Array, index: int = 0) -> None:
        """Put a ball at a place, (3,), without speed."""
        q, v = self._q + 7 * index, self._v + 6 * index
        self.data.qpos[q : q + 3] = self._centre() + place
        self.data.qvel[v : v + 6] = 0.0

    def kick(self, x: float, y: float, index: int = 0) -> None:
        """Add x and y to a ball's velocity, m/s."""
        v = self._v + 6 * index
        self.data.qvel[v : v + 2] += x, y

    def push(self, force: Array, torque: Array | None = None) -> None:
        """Apply a force (3,), N, and a torque (3,), N m, to the ball from now on."""
        self.data.xfrc_applied[self._body, :3] = force
        if torque is not None:
            self.data.xfrc_applied[self._body, 3:] = torque

    def roughen(self, friction_m: float) -> None:
        """Set the rolling friction of the floor from now on, m. The model must have a geom `floor`."""
        self.model.geom("floor").friction[2] = friction_m

    def _centre(self) -> Array | float:
        """Middle of the maze's floor in the room, m."""
        return 0.0

    def _drift(self) -> Array | float:
        """Velocity of the middle of the maze's floor, m/s."""
        return 0.0

    def ball_rotation(self) -> Array:
        """Rotation (3, 3) of the ball."""
        out = np.empty(9)
        mujoco.mju_quat2Mat(out, self.data.qpos[self._q + 3 : self._q + 7])
        return out.reshape(3, 3)


class NearWalls:
    """The boxes near each cell of the floor of one plate. Rigs with the same physics share it.

    slots: largest number of boxes in a model.
    free: distance that a ball may go before the boxes are chosen anew, m; timestep: of MuJoCo, s."""

    def __init__(self, text: str, bare: str, maze: Maze) -> None:
        """text, bare: MJCF with and without walls."""
        self._whole = mujoco.MjModel.from_xml_string(text)
        floor, plate = self._whole.geom("floor").id, self._whole.body("plate").id
        self._boxes = np.flatnonzero(self._whole.geom_bodyid == plate)  # walls and plugs
        self._boxes = self._boxes[self._boxes != floor]
        self._plugs = {opening.name: self._whole.geom(plug_name(opening.name)).id for opening in maze.openings}
        self.timestep = float(self._whole.opt.timestep)
        self.free = max(BOX_MARGIN_M, FASTEST * self.timestep)
        reach = maze.ball.radius + self.free + _slack(maze) + math.sqrt(0.5) * CELL
        places, sizes = self._whole.geom_pos[self._boxes], self._whole.geom_size[self._boxes]
        self._half = float(np.max(np.hypot(places[:, 0], places[:, 1]) + np.hypot(sizes[:, 0], sizes[:, 1]))) + reach
        self._side = math.ceil(2.0 * self._half / CELL)
        self._near = self._boxes_near(reach)
        self.slots = maze.balls * max(len(boxes) for boxes in self._near.values())
        self._empty = self._without_boxes(bare)
        self._plate = self._empty.body("plate").id
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

    def fill(
        self, model: mujoco.MjModel, fields: list[tuple[Any, Any]], cells: tuple[int, ...], blocked: frozenset[str]
    ) -> None:
        """Put the boxes near some cells, and the plugs of blocked openings, into a model, in their order."""
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
        """{cell: numbers of the boxes within `reach` (m) of its middle}, in the whole model's order."""
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
    return NearWalls(mjcf(maze, settings), mjcf(maze, settings, walls=False), maze)


def _slack(maze: Maze) -> float:
    """Largest distance along the plate, m, between a ball in the room and its place in the plate's frame."""
    tilt = TILT * maze.tilt_limit * math.sqrt(2.0)
    rim = maze.walls[0].outer_radius
    return rim * (1.0 - math.cos(tilt)) + 2.0 * maze.ball.radius * math.sin(tilt)


class MazeGimbal(Gimbal):
    """A gimbal that simulates only the walls near the balls, in less than half the time.

    Its motion equals that of `Gimbal` to the last bit."""

    def __init__(self, walls: NearWalls, steps: int, balls: int) -> None:
        super().__init__(walls.model(), steps)
        self._walls = walls
        self._fields = walls.fields(self.model)
        self._balls = range(balls)
        self._blocked: frozenset[str] = frozenset()
        self._filled: tuple[tuple[int, ...], frozenset[str]] | None = None  # cells and plugs of the boxes in the model

    def reset(self, *positions: Array) -> None:
        """See `Gimbal`. Removes all plugs."""
        self._blocked = frozenset()
        self._to_start(*positions)
        self._choose()
        mujoco.mj_forward(self.model, self.data)

    def advance(self) -> None:
        """See `Gimbal`. For a fast ball, chooses the boxes anew in each step."""
        speed = max(math.hypot(*self.data.qvel[2 + 6 * i : 4 + 6 * i].tolist()) for i in self._balls)
        most = self.steps * self._walls.timestep  # s; a ball that stays near its cell so long needs no other boxes
        once = speed * most + GRAVITY * most * most <= self._walls.free
        for _ in range(1 if once else self.steps):
            self._choose()
            mujoco.mj_step(self.model, self.data, nstep=self.steps if once else 1)

    def _choose(self) -> None:
        """Put the boxes near the balls into the model."""
        places = self.data.qpos
        cells = tuple(self._walls.cell(places.item(2 + 7 * i), places.item(3 + 7 * i)) for i in self._balls)
        if (cells, self._blocked) != self._filled:
            self._walls.fill(self.model, self._fields, cells, self._blocked)
            self._filled = cells, self._blocked

    def plug(self, opening: str, there: bool) -> None:
        """See `Gimbal`."""
        self._blocked = self._blocked | {opening} if there else self._blocked - {opening}
