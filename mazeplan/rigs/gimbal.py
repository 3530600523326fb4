"""Where plate and ball are in a MuJoCo model, and how its servos are told a tilt.

Places and velocities are those of the room, seen from the plate's centre; the plate's own frame is another's business
(`machine`).
"""

from __future__ import annotations

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module tells type checkers nothing of its names)
import math
from collections.abc import Callable

import mujoco
import numpy as np

from mazeplan.errors import RigError
from mazeplan.records import Array
from mazeplan.rigs.mjcf import PLUG_OFF, PLUG_ON, plug_name
from mazeplan.rigs.nearwalls import OPEN, NearWalls


class Gimbal:
    """Of the model that `mjcf` writes: joints beta, gamma, then the ball's, and two actuators in that order. steps: of
    MuJoCo in one chunk."""

    def __init__(self, model: mujoco.MjModel, steps: int) -> None:
        self.model, self.data, self.steps = model, mujoco.MjData(model), steps

    def reset(self, position: Array) -> None:
        """Level plate, everything at rest, time 0, the ball at a position (3,) in the plate's frame, m."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[2:5] = position
        self.data.qpos[5] = 1.0
        mujoco.mj_forward(self.model, self.data)

    def drive(self, tilt: Array) -> None:
        """Set points of the servos: beta, gamma, rad, (2,)."""
        self.data.ctrl[:] = tilt

    def advance(self) -> None:
        """Let one chunk pass."""
        mujoco.mj_step(self.model, self.data, nstep=self.steps)

    def plug(self, opening: str, there: bool) -> None:
        """Whether an opening has something in it that the ball cannot pass, from now on."""
        geom = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_GEOM, plug_name(opening))
        self.model.geom_contype[geom] = self.model.geom_conaffinity[geom] = PLUG_ON if there else PLUG_OFF

    def settle(self) -> None:
        """The state was set from outside; nothing else is kept of it here."""

    @property
    def tilt(self) -> tuple[float, float]:
        """beta, gamma, rad."""
        return float(self.data.qpos[0]), float(self.data.qpos[1])

    def plate(self) -> tuple[Array, Array]:
        """Rotation (3, 3) from the plate frame to the room, and the plate's angular velocity (3,) in its own frame:
        gamma_dot about x, beta_dot about the y axis outside."""
        data = self.data
        b, c = float(data.qpos[0]), float(data.qpos[1])
        cb, sb, cc, sc = math.cos(b), math.sin(b), math.cos(c), math.sin(c)
        plate = np.array([[cb, sb * sc, sb * cc], [0.0, cc, -sc], [-sb, cb * sc, cb * cc]])
        return plate, np.array([data.qvel[1], cc * data.qvel[0], -sc * data.qvel[0]])

    def drawn(self) -> Array:
        """The rotation as MuJoCo saw it last, (3, 3): at the beginning of its last step."""
        return self.data.body("plate").xmat.reshape(3, 3)

    def place(self) -> Array:
        """The ball's, (3,), m."""
        return self.data.qpos[2:5]

    def velocity(self) -> Array:
        """The ball's, (3,), m/s."""
        return self.data.qvel[2:5]

    def spin(self) -> Array:
        """The ball's, (3,), rad/s."""
        return rotation(self.data.qpos[5:9]) @ self.data.qvel[5:8]

    def put(self, place: Array, velocity: Array, spin: Array) -> None:
        """The ball's state, (3,) each; all else goes on as it was."""
        data = self.data
        data.qpos[2:5] = place
        data.qvel[2:5] = velocity
        data.qvel[5:8] = rotation(data.qpos[5:9]).T @ spin

    def rest(self, place: Array) -> None:
        """Put the ball there, (3,), without speed."""
        self.data.qpos[2:5] = place
        self.data.qvel[2:8] = 0.0

    def kick(self, x: float, y: float) -> None:
        """Add to the ball's velocity, m/s."""
        self.data.qvel[2] += x
        self.data.qvel[3] += y

    def pull(self, force: Array) -> None:
        """Force on the ball from now on, (3,), N."""
        self.data.body("ball").xfrc_applied[:3] = force

    def twist(self, torque: Array) -> None:
        """Torque on the ball from now on, (3,), N m."""
        self.data.body("ball").xfrc_applied[3:] = torque

    def roughen(self, friction_m: float) -> None:
        """What comes to the rolling friction of the floor, m, from now on. Raises RigError where it cannot."""
        raise RigError("the floor of this model has one rolling friction, which stays")


class MazeGimbal(Gimbal):
    """The same with the walls near the ball alone: it goes the same way to the last bit, in less than half the
    time."""

    def __init__(self, walls: NearWalls, steps: int, rougher: Callable[[float], NearWalls] | None = None) -> None:
        """rougher: the walls on a floor of so much more rolling friction, m."""
        super().__init__(walls.any, steps)
        self._walls, self._blocked, self._rougher = walls, OPEN, rougher
        self._by_friction = {0.0: walls}

    def reset(self, position: Array) -> None:
        """See `Gimbal`; no opening has anything in it."""
        self._blocked, self._walls = OPEN, self._by_friction[0.0]
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[2:5] = position
        self.data.qpos[5] = 1.0
        mujoco.mj_forward(self._walls.at(float(position[0]), float(position[1])), self.data)

    def advance(self) -> None:
        """See `Gimbal`."""
        self._walls.step(self.data, self.steps, self._blocked)

    def plug(self, opening: str, there: bool) -> None:
        """See `Gimbal`."""
        self._blocked = self._blocked | {opening} if there else self._blocked - {opening}

    def roughen(self, friction_m: float) -> None:
        """See `Gimbal`."""
        if friction_m not in self._by_friction:
            if self._rougher is None:
                return super().roughen(friction_m)
            self._by_friction[friction_m] = self._rougher(friction_m)
        self._walls = self._by_friction[friction_m]
        return None


def rotation(quaternion: Array) -> Array:
    """Rotation matrix (3, 3)."""
    out = np.empty(9)
    mujoco.mju_quat2Mat(out, quaternion)
    return out.reshape(3, 3)
