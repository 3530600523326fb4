"""Plate, servos and ball in a MuJoCo model.

Positions and velocities of the ball are in the room's frame, relative to the plate's centre. `machine` converts them to
the plate's frame.
"""

from __future__ import annotations

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module has no types)
import math

import mujoco
import numpy as np

from mazeplan.core.records import Array
from mazeplan.rigs.sim.mjcf import PLUG_OFF, PLUG_ON, plug_name
from mazeplan.rigs.sim.nearwalls import NearWalls


class Gimbal:
    """Plate and ball of the model that `mjcf` writes. Its joints are beta, gamma, then the ball's; its actuators are
    beta, gamma.

    steps: number of MuJoCo's steps in one chunk.
    ball: number of the ball's body, and addresses of its free joint in qpos and in qvel."""

    def __init__(self, model: mujoco.MjModel, steps: int, ball: tuple[int, int, int] | None = None) -> None:
        self.model, self.data, self.steps = model, mujoco.MjData(model), steps
        self._body, self._q, self._v = ball or (mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "ball"), 2, 2)

    def reset(self, position: Array, *others: Array) -> None:
        """Level the plate, set velocities and time to 0, put each ball at a position (3,) in the plate's frame, m."""
        self._to_start(position, *others)
        mujoco.mj_forward(self.model, self.data)

    def _to_start(self, *positions: Array) -> None:
        mujoco.mj_resetData(self.model, self.data)
        for index, position in enumerate(positions):
            q = 2 + 7 * index
            self.data.qpos[q : q + 3] = position
            self.data.qpos[q + 3] = 1.0

    def drive(self, tilt: Array) -> None:
        """Give the servos their set points: beta, gamma, rad, (2,)."""
        self.data.ctrl[:] = tilt

    def advance(self) -> None:
        """Simulate one chunk."""
        mujoco.mj_step(self.model, self.data, nstep=self.steps)

    def plug(self, opening: str, there: bool) -> None:
        """Close an opening with a plug, or open it again."""
        geom = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_GEOM, plug_name(opening))
        self.model.geom_contype[geom] = self.model.geom_conaffinity[geom] = PLUG_ON if there else PLUG_OFF

    def settle(self) -> None:
        """Update values that depend on the state after a caller has set the state. Here nothing is to be done."""

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

    def place(self) -> Array:
        """Position of the ball, (3,), m."""
        return self.data.qpos[2:5]

    def place_of(self, index: int) -> Array:
        """Position of a ball, (3,), m; the first one has index 0."""
        if index == 0:
            return self.place()
        return self.data.qpos[2 + 7 * index : 5 + 7 * index]

    def velocity(self) -> Array:
        """Velocity of the ball, (3,), m/s."""
        return self.data.qvel[2:5]

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
        self.data.qvel[v] += x
        self.data.qvel[v + 1] += y

    def pull(self, force: Array) -> None:
        """Apply a force to the ball from now on, (3,), N."""
        self.data.xfrc_applied[self._body, :3] = force

    def twist(self, torque: Array) -> None:
        """Apply a torque to the ball from now on, (3,), N m."""
        self.data.xfrc_applied[self._body, 3:] = torque

    def roughen(self, friction_m: float) -> None:
        """Set the rolling friction of the floor from now on, m. The model must have a geom `floor`."""
        self.model.geom_friction[mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_GEOM, "floor"), 2] = friction_m

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


class MazeGimbal(Gimbal):
    """A gimbal that simulates only the walls near the balls, in less than half the time.

    Its motion equals that of `Gimbal` to the last bit."""

    def __init__(self, walls: NearWalls, steps: int, balls: int) -> None:
        super().__init__(walls.model(), steps)
        self._walls, self._fields, self._balls = walls, walls.fields(self.model), range(balls)
        self._blocked: frozenset[str] = frozenset()
        self._filled: tuple[tuple[int, ...], frozenset[str]] | None = None  # cells and plugs of the boxes in the model

    def reset(self, position: Array, *others: Array) -> None:
        """See `Gimbal`. Removes all plugs."""
        self._blocked = frozenset()
        self._to_start(position, *others)
        self._choose()
        mujoco.mj_forward(self.model, self.data)

    def advance(self) -> None:
        """See `Gimbal`. For a fast ball, chooses the boxes anew in each step."""
        speed = max(math.hypot(*self.data.qvel[2 + 6 * i : 4 + 6 * i].tolist()) for i in self._balls)
        once = self._walls.stays_near(speed, self.steps)
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
