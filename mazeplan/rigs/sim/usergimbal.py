"""Plate, servos and ball in a user's own MuJoCo model: finds them by the names in the rig's file, and checks them.

The frame of a body or site is the plate's frame: x and y as in the map, z up from the floor, origin in the middle of
the maze. With the angle q of its joint, beta = sign (q - zero); gamma likewise. The set point of a position actuator is
`scale` times the joint's angle. The default of `scale` follows from the actuator's gear.
"""

from __future__ import annotations

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module has no types)
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from pydantic import Field

from mazeplan.core.errors import RigError, SettingsError
from mazeplan.core.records import Array
from mazeplan.maze.geometry import Maze
from mazeplan.maze.sections import Section
from mazeplan.maze.yamltree import shown
from mazeplan.rigs.sim.gimbal import Gimbal

PROBE_ANGLE = 1e-3  # rad; a turn of a joint by this angle shows what the joint does to the plate
MAX_PROBE_ERROR = 0.02  # share of a nudge; a larger error is no rounding error
ALIKE = 0.02  # relative difference allowed between the ball's radius in the model and in the map
WHOLE = 1e-6  # relative difference allowed between a number of steps and a whole number
JOINT, ACTUATOR, BODY, SITE = (
    getattr(mujoco.mjtObj, f"mjOBJ_{name}") for name in ("JOINT", "ACTUATOR", "BODY", "SITE")
)
OBJECTS = {"joint": JOINT, "actuator": ACTUATOR, "body": BODY, "site": SITE}
UNSTABLE = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)


class AxisSection(Section):
    """A joint and its actuator.

    actuator: None: the only actuator of that joint.
    sign: -1 if a positive angle of the joint is a negative tilt.
    scale: set point of the actuator for 1 rad of the joint; None: from the actuator's gear.
    zero_deg: the joint's angle when the plate is level."""

    joint: str
    actuator: str | None = None
    sign: int = Field(default=1, ge=-1, le=1)
    scale: float | None = Field(default=None, gt=0.0)
    zero_deg: float = Field(default=0.0, ge=-90.0, le=90.0)


class ModelSection(Section):
    """Keys of the rig's file that describe the model.

    mjcf: file of the model.
    beta, gamma: axes.
    ball: body of the ball.
    plate: body or site whose frame is the plate's frame.
    floor_mm: height of the floor in that frame."""

    mjcf: str
    beta: AxisSection
    gamma: AxisSection
    ball: str
    plate: str
    floor_mm: float = Field(default=0.0, ge=-1000.0, le=1000.0)


@dataclass(frozen=True)
class _Drive:
    """An axis in MuJoCo's numbers.

    q: address of the joint in qpos.
    actuator: number of the actuator.
    sign, zero: beta or gamma is sign (qpos[q] - zero), rad.
    scale: set point of the actuator for 1 rad of the joint."""

    q: int
    actuator: int
    sign: float
    zero: float
    scale: float


def read_model(path: Path) -> mujoco.MjModel:
    """A model from a file. Raises SettingsError with a message of one line."""
    if not path.is_file():
        raise SettingsError(f"no such file: {path}", key="mjcf")
    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except Exception as problem:  # the types of MuJoCo's errors differ from version to version
        raise SettingsError(f"{path}: {' '.join(str(problem).split())}", key="mjcf") from None


class UserGimbal(Gimbal):
    """See `Gimbal`. Raises SettingsError, with a key of the rig's file, if the model does not fit the names.

    chunks: number of chunks in a second."""

    def __init__(self, model: mujoco.MjModel, names: ModelSection, maze: Maze, chunks: float) -> None:
        super().__init__(model, _steps(model, chunks), _ball(model, names.ball, maze))
        self._names, self._floor = names, 1e-3 * names.floor_mm
        self._frame = _find(model, "plate", names.plate, "body", "site")
        beta, gamma = self._drives = tuple(
            _drive(model, key, axis) for key, axis in (("beta", names.beta), ("gamma", names.gamma))
        )
        for key, shared in (("joint", beta.q == gamma.q), ("actuator", beta.actuator == gamma.actuator)):
            if shared:
                raise SettingsError("is that of beta, too; expected another", key=f"gamma.{key}")
        for i in range(2):
            self._check_axis(i)

    # -- checks -----------------------------------------------------------------------------------------------------

    def _check_axis(self, i: int) -> None:
        """Raises SettingsError unless beta alone lowers the +x side, and gamma alone lifts the +y side."""
        name = ("beta", "gamma")[i]
        self._pose((0.0, 0.0))
        level = self.drawn()
        self._pose((PROBE_ANGLE, 0.0) if i == 0 else (0.0, PROBE_ANGLE))
        turn = level.T @ self.drawn()
        got = (-turn[2, 0] / PROBE_ANGLE, turn[2, 1] / PROBE_ANGLE)  # how far +x went down, +y up
        if abs(got[i] - 1.0) < MAX_PROBE_ERROR and abs(got[1 - i]) < MAX_PROBE_ERROR:
            return
        down, up = (round(one, 2) + 0.0 for one in got)  # without -0
        what = f"1 rad of its joint lowers the +x side by {down} rad and lifts the +y side by {up} rad"
        raise SettingsError(f"{what}; expected 1 rad of {('+x', '+y')[i]} alone: see joint and sign", key=name)

    # -- methods that `machine.Machine` calls -----------------------------------------------------------------------

    def reset(self, position: Array, *others: Array) -> None:
        """Level the plate, set velocities and time to 0, put the ball at a position (3,) in the plate's frame, m."""
        model, data = self.model, self.data
        mujoco.mj_resetData(model, data)
        self._pose((0.0, 0.0))
        self.drive(np.zeros(2))
        data.qvel[:] = 0.0
        data.qpos[self._q : self._q + 3] = self._centre() + self.drawn() @ position
        data.qpos[self._q + 3 : self._q + 7] = 1.0, 0.0, 0.0, 0.0
        mujoco.mj_forward(model, data)

    def drive(self, tilt: Array) -> None:
        """See `Gimbal`."""
        for drive, angle in zip(self._drives, tilt.tolist(), strict=True):
            self.data.ctrl[drive.actuator] = drive.scale * (drive.zero + drive.sign * angle)

    def advance(self) -> None:
        """See `Gimbal`. Raises RigError if the model becomes unstable."""
        super().advance()
        if self._unstable():
            raise RigError(f"the model became unstable at t = {self.data.time:.3f} s; expected a smaller time step")
        self.settle()

    def _unstable(self) -> bool:
        return any(self.data.warning[int(kind)].number for kind in UNSTABLE)

    def settle(self) -> None:
        """Update the frames from the joints."""
        mujoco.mj_kinematics(self.model, self.data)

    @property
    def tilt(self) -> tuple[float, float]:
        """beta, gamma, rad."""
        beta, gamma = (drive.sign * (float(self.data.qpos[drive.q]) - drive.zero) for drive in self._drives)
        return beta, gamma

    def plate(self) -> tuple[Array, Array]:
        """See `Gimbal`."""
        turned = self.drawn()
        return turned, turned.T @ self._motion()[:3]

    def drawn(self) -> Array:
        """Rotation (3, 3) of the plate now."""
        kind, number = self._frame
        return np.array((self.data.xmat if kind == BODY else self.data.site_xmat)[number]).reshape(3, 3)

    def place(self) -> Array:
        """See `Gimbal`."""
        return self.data.qpos[self._q : self._q + 3] - self._centre()

    def velocity(self) -> Array:
        """See `Gimbal`."""
        return self.data.qvel[self._v : self._v + 3] - self._drift()

    # -- frames -----------------------------------------------------------------------------------------------------

    def _pose(self, tilt: tuple[float, float]) -> None:
        """Set the joints to a tilt (beta, gamma), rad, and update the frames."""
        for drive, angle in zip(self._drives, tilt, strict=True):
            self.data.qpos[drive.q] = drive.zero + drive.sign * angle
        mujoco.mj_kinematics(self.model, self.data)

    def _centre(self) -> Array:
        kind, number = self._frame
        origin = (self.data.xpos if kind == BODY else self.data.site_xpos)[number]
        return origin + self._floor * self.drawn()[:, 2]

    def _motion(self) -> Array:
        """Angular and linear velocity (6,) of the plate's frame, in the frame of the room."""
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_comVel(self.model, self.data)
        kind, number = self._frame
        out = np.empty(6)
        of = mujoco.mjtObj.mjOBJ_XBODY if kind == BODY else SITE
        mujoco.mj_objectVelocity(self.model, self.data, of, number, out, 0)
        return out

    def _drift(self) -> Array:
        motion, up = self._motion(), self.drawn()[:, 2]
        return motion[3:] + np.cross(motion[:3], self._floor * up)


# -- names to numbers ------------------------------------------------------------------------------------------------


def _names(model: mujoco.MjModel, kind: str) -> str:
    """Names of all objects of a kind, for a message."""
    count = {"joint": model.njnt, "actuator": model.nu, "body": model.nbody, "site": model.nsite}[kind]
    names = (mujoco.mj_id2name(model, OBJECTS[kind], i) for i in range(count))
    return ", ".join(name for name in names if name and name != "world") or "none with a name"


def _find(model: mujoco.MjModel, key: str, name: str, *kinds: str) -> tuple[Any, int]:
    """MuJoCo's kind and number of a name. Raises SettingsError with the existing names."""
    for kind in kinds:
        number = mujoco.mj_name2id(model, OBJECTS[kind], name)
        if number >= 0:
            return OBJECTS[kind], number
    existing = "; ".join(f"{kind}: {_names(model, kind)}" for kind in kinds)
    raise SettingsError(f"got {shown(name)}, which the model does not have; {existing}", key=key)


def _steps(model: mujoco.MjModel, chunks: float) -> int:
    """Number of MuJoCo's steps in a chunk. Raises SettingsError for an unsuitable time step of the model.

    chunks: number of chunks in a second."""
    step, exact = float(model.opt.timestep), 1.0 / (chunks * float(model.opt.timestep))
    count = max(1, round(exact))
    if abs(exact - count) > WHOLE * count:
        near = 1.0 / (chunks * count)
        what = f"its timestep is {step:g} s, of which {exact:.4g} are in 1/{chunks:g} s; expected a whole number"
        raise SettingsError(f"{what}, such as a timestep of {near:.12g} s", key="mjcf")
    return count


def _ball(model: mujoco.MjModel, name: str, maze: Maze) -> tuple[int, int, int]:
    """Number of the ball's body, and addresses of its free joint in qpos and in qvel."""
    _, body = _find(model, "ball", name, "body")
    joint = int(model.body_jntadr[body])
    free = int(mujoco.mjtJoint.mjJNT_FREE)
    if model.body_jntnum[body] != 1 or int(model.jnt_type[joint]) != free:
        bodies = [int(model.jnt_bodyid[j]) for j in range(model.njnt) if int(model.jnt_type[j]) == free]
        others = ", ".join(mujoco.mj_id2name(model, BODY, b) or f"number {b}" for b in bodies) or "none"
        raise SettingsError(f"body {shown(name)} has no free joint; bodies with one: {others}", key="ball")
    first, count = int(model.body_geomadr[body]), int(model.body_geomnum[body])
    spheres = [g for g in range(first, first + count) if int(model.geom_type[g]) == int(mujoco.mjtGeom.mjGEOM_SPHERE)]
    if not spheres:
        raise SettingsError(f"body {shown(name)} has no geom of type sphere", key="ball")
    radius, wanted = float(model.geom_size[spheres[0]][0]), maze.ball.radius
    if abs(radius - wanted) > ALIKE * wanted:
        what = f"its radius is {1e3 * radius:.3f} mm, expected {1e3 * wanted:.3f} mm as in map {maze.name!r}"
        raise SettingsError(what, key="ball")
    return body, int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])


def _drive(model: mujoco.MjModel, key: str, axis: AxisSection) -> _Drive:
    """An axis in MuJoCo's numbers. Raises SettingsError if the model does not fit."""
    if axis.sign not in (-1, 1):
        raise SettingsError(f"got {axis.sign}, expected 1 or -1", key=f"{key}.sign")
    _, joint = _find(model, f"{key}.joint", axis.joint, "joint")
    if int(model.jnt_type[joint]) != int(mujoco.mjtJoint.mjJNT_HINGE):
        raise SettingsError(f"joint {shown(axis.joint)} is no hinge", key=f"{key}.joint")
    number, scale = _actuator(model, key, axis, joint), axis.scale
    if scale is None:
        if int(model.actuator_trntype[number]) != int(mujoco.mjtTrn.mjTRN_JOINT):
            what = "is missing: the actuator's set point per rad of the joint, which its transmission does not give"
            raise SettingsError(what, key=f"{key}.scale")
        scale = -float(model.actuator_gear[number][0] * model.actuator_biasprm[number][1])
        scale /= float(model.actuator_gainprm[number][0])
    return _Drive(int(model.jnt_qposadr[joint]), number, float(axis.sign), math.radians(axis.zero_deg), scale)


def _actuator(model: mujoco.MjModel, key: str, axis: AxisSection, joint: int) -> int:
    """Number of the position actuator of an axis."""
    if axis.actuator is not None:
        _, number = _find(model, f"{key}.actuator", axis.actuator, "actuator")
    else:
        kind = int(mujoco.mjtTrn.mjTRN_JOINT)
        of = [
            i for i in range(model.nu) if int(model.actuator_trntype[i]) == kind and model.actuator_trnid[i][0] == joint
        ]
        if len(of) != 1:
            what = f"joint {shown(axis.joint)} has {len(of)} actuators; expected the name of one"
            raise SettingsError(f"{what}: {_names(model, 'actuator')}", key=f"{key}.actuator")
        number = of[0]
    affine = int(model.actuator_biastype[number]) == int(mujoco.mjtBias.mjBIAS_AFFINE)
    if not (affine and model.actuator_biasprm[number][1] < 0.0 and model.actuator_gainprm[number][0] > 0.0):
        raise SettingsError("this actuator holds no position, expected one of kind position", key=f"{key}.actuator")
    return number
