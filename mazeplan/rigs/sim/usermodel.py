"""A rig simulated on a user's own MuJoCo model: `class: mazeplan.rigs.sim.usermodel:ModelRig` in a rig's YAML file.

The model, in MuJoCo's own format (MJCF), has a plate on two joints, a position actuator for each joint, and a ball with
a free joint. The rig's file gives the names of these parts. Camera, delays and play are simulated as for any simulated
rig.

The frame of a body or site is the plate's frame: x and y as in the map, z up from the floor, origin in the middle of
the maze. With the angle q of its joint, beta = sign (q - zero); gamma likewise. The set point of a position actuator is
`scale` times the joint's angle. The default of `scale` follows from the actuator's gear.
"""

from __future__ import annotations

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module has no types)
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import mujoco
import numpy as np
from pydantic import Field

from mazeplan.core.errors import RigError, SettingsError
from mazeplan.core.records import Array
from mazeplan.maze.geometry import Maze
from mazeplan.maze.sections import Section
from mazeplan.maze.yamltree import shown
from mazeplan.rigs.files import FileSettings, validated
from mazeplan.rigs.sim.gimbal import Gimbal
from mazeplan.rigs.sim.machine import CHUNKS
from mazeplan.rigs.sim.settings import Fault, RigSettings, SimulatedSettings
from mazeplan.rigs.sim.simulated import SimulatedRig

PROBE_ANGLE = 1e-3  # rad; a turn of a joint by this angle shows what the joint does to the plate
MAX_PROBE_ERROR = 0.02  # share of a nudge; a larger error is no rounding error
RADIUS_TOLERANCE = 0.02  # relative difference allowed between the ball's radius in the model and in the map
WHOLE = 1e-6  # relative difference allowed between a number of steps and a whole number
UNSTABLE = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)


class AxisSection(Section):
    """A joint and its actuator."""

    joint: str
    actuator: str | None = None  # None: the only actuator of that joint
    sign: Literal[-1, 1] = 1  # -1 if a positive angle of the joint is a negative tilt
    scale: float | None = Field(default=None, gt=0.0)  # set point for 1 rad of the joint; None: by the actuator's gear
    zero_deg: float = Field(default=0.0, ge=-90.0, le=90.0)  # the joint's angle when the plate is level


class ModelSettings(RigSettings):
    """Keys of the rig's file."""

    mjcf: str  # file of the model
    beta: AxisSection
    gamma: AxisSection
    ball: str  # its body
    plate: str  # body or site whose frame is the plate's frame
    floor_mm: float = Field(default=0.0, ge=-1000.0, le=1000.0)  # height of the floor in that frame


class ModelRig(SimulatedRig):
    """See `interface.Rig`. Raises SettingsError for keys and names that do not fit the model.

    cannot: kinds of faults for which the model has no parts."""

    cannot = ("blocked",)

    def __init__(self, maze: Maze, settings: Mapping[str, Any]) -> None:
        keys = validated(ModelSettings, settings)
        for i, fault in enumerate(keys.faults):
            self._check(fault, f"faults[{i}].kind")
        path = Path(keys.mjcf)
        if isinstance(settings, FileSettings) and (settings.file.parent / path).exists():
            path = settings.file.parent / path
        gimbal = UserGimbal(_read_model(path), keys, maze)
        shared = {name: getattr(keys, name) for name in RigSettings.model_fields}
        super().__init__(maze, SimulatedSettings(**shared), lambda: gimbal)

    def inject(self, fault: Fault) -> None:
        """See `Machine.inject`. Raises SettingsError for a fault that the model cannot have."""
        self._check(fault, "fault.kind")
        super().inject(fault)

    def _check(self, fault: Fault, key: str) -> None:
        if fault.kind in self.cannot:
            raise SettingsError(f"got {fault.kind}, expected another: this model has no plugs", key=key)


@dataclass(frozen=True)
class _Drive:
    """An axis in MuJoCo's numbers: beta or gamma is sign (qpos[q] - zero), rad."""

    q: int  # address of the joint in qpos
    actuator: int  # number of the actuator
    sign: float
    zero: float
    scale: float  # set point of the actuator for 1 rad of the joint


def _read_model(path: Path) -> mujoco.MjModel:
    """A model from a file. Raises SettingsError with a message of one line."""
    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except Exception as problem:  # the types of MuJoCo's errors differ from version to version
        raise SettingsError(f"{path}: {' '.join(str(problem).split())}", key="mjcf") from None


class UserGimbal(Gimbal):
    """See `Gimbal`. Raises SettingsError, with a key of the rig's file, if the model does not fit the names."""

    def __init__(self, model: mujoco.MjModel, names: ModelSettings, maze: Maze) -> None:
        super().__init__(model, _steps(model, names.rate_hz * CHUNKS), _ball(model, names.ball, maze))
        self._floor = 1e-3 * names.floor_mm
        kind, self._number = _find(model, "plate", names.plate, "body", "site")
        self._frame = getattr(self.data, kind)(self._number)
        self._kind = mujoco.mjtObj.mjOBJ_XBODY if kind == "body" else mujoco.mjtObj.mjOBJ_SITE
        beta, gamma = self._drives = _drive(model, "beta", names.beta), _drive(model, "gamma", names.gamma)
        if beta.actuator == gamma.actuator:
            raise SettingsError("is that of beta, too; expected another", key="gamma.actuator")
        for i in range(2):
            self._check_axis(i)

    def _check_axis(self, i: int) -> None:
        """Raises SettingsError unless beta alone lowers the +x side, and gamma alone lifts the +y side."""
        self._pose((0.0, 0.0))
        level = self.drawn()
        self._pose((PROBE_ANGLE, 0.0) if i == 0 else (0.0, PROBE_ANGLE))
        turn = level.T @ self.drawn()
        got = (-turn[2, 0] / PROBE_ANGLE, turn[2, 1] / PROBE_ANGLE)  # how far +x went down, +y up
        if abs(got[i] - 1.0) < MAX_PROBE_ERROR and abs(got[1 - i]) < MAX_PROBE_ERROR:
            return
        down, up = (round(one, 2) + 0.0 for one in got)  # without -0
        what = f"1 rad of its joint lowers the +x side by {down} rad, lifts the +y side by {up} rad"
        wanted = f"expected 1 rad of {('+x', '+y')[i]} alone: see joint and sign"
        raise SettingsError(f"{what}; {wanted}", key=("beta", "gamma")[i])

    def reset(self, *positions: Array) -> None:
        """See `Gimbal`. The model has one ball."""
        model, data = self.model, self.data
        mujoco.mj_resetData(model, data)
        self._pose((0.0, 0.0))
        self.drive(np.zeros(2))
        data.qpos[self._q : self._q + 3] = self._centre() + self.drawn() @ positions[0]
        data.qpos[self._q + 3 : self._q + 7] = 1.0, 0.0, 0.0, 0.0
        mujoco.mj_forward(model, data)

    def drive(self, tilt: Array) -> None:
        """See `Gimbal`."""
        for drive, angle in zip(self._drives, tilt.tolist(), strict=True):
            self.data.ctrl[drive.actuator] = drive.scale * (drive.zero + drive.sign * angle)

    def advance(self) -> None:
        """See `Gimbal`. Raises RigError if the model becomes unstable."""
        super().advance()
        if any(self.data.warning[int(kind)].number for kind in UNSTABLE):
            raise RigError(f"the model became unstable at t = {self.data.time:.3f} s; expected a smaller time step")
        mujoco.mj_kinematics(self.model, self.data)  # updates the frames from the joints

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
        return np.array(self._frame.xmat).reshape(3, 3)

    def _pose(self, tilt: tuple[float, float]) -> None:
        """Set the joints to a tilt (beta, gamma), rad, and update the frames."""
        for drive, angle in zip(self._drives, tilt, strict=True):
            self.data.qpos[drive.q] = drive.zero + drive.sign * angle
        mujoco.mj_kinematics(self.model, self.data)

    def _centre(self) -> Array:
        return self._frame.xpos + self._floor * self.drawn()[:, 2]

    def _motion(self) -> Array:
        """Angular and linear velocity (6,) of the plate's frame, in the frame of the room."""
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_comVel(self.model, self.data)
        out = np.empty(6)
        mujoco.mj_objectVelocity(self.model, self.data, self._kind, self._number, out, 0)
        return out

    def _drift(self) -> Array:
        motion, up = self._motion(), self.drawn()[:, 2]
        return motion[3:] + np.cross(motion[:3], self._floor * up)


def _find(model: mujoco.MjModel, key: str, name: str, *kinds: str) -> tuple[str, int]:
    """Kind and number of a name. Raises SettingsError with the existing names."""
    said = []
    for kind in kinds:
        try:
            return kind, getattr(model, kind)(name).id
        except KeyError as unknown:  # its message has the names of the model
            said.append(f"{kind}: {' '.join(unknown.args[0].split())}")
    raise SettingsError("; ".join(said), key=key)


def _steps(model: mujoco.MjModel, chunks: float) -> int:
    """Number of MuJoCo's steps in a chunk, of which a second has `chunks`. Raises SettingsError."""
    exact = 1.0 / (chunks * float(model.opt.timestep))
    count = max(1, round(exact))
    if abs(exact - count) > WHOLE * count:
        what = f"{exact:.4g} of its timesteps are in 1/{chunks:g} s, expected a whole number"
        raise SettingsError(f"{what}, such as a timestep of {1.0 / (chunks * count):.12g} s", key="mjcf")
    return count


def _ball(model: mujoco.MjModel, name: str, maze: Maze) -> tuple[int, int, int]:
    """Number of the ball's body, and addresses of its free joint in qpos and in qvel."""
    _, body = _find(model, "ball", name, "body")
    joint = int(model.body_jntadr[body])
    if model.body_jntnum[body] != 1 or int(model.jnt_type[joint]) != int(mujoco.mjtJoint.mjJNT_FREE):
        raise SettingsError(
            f"body {shown(name)} has no free joint, expected the body of the ball, with one", key="ball"
        )
    first, count = int(model.body_geomadr[body]), int(model.body_geomnum[body])
    spheres = [g for g in range(first, first + count) if int(model.geom_type[g]) == int(mujoco.mjtGeom.mjGEOM_SPHERE)]
    if not spheres:
        raise SettingsError(f"body {shown(name)} has no geom of type sphere", key="ball")
    radius, wanted = float(model.geom_size[spheres[0]][0]), maze.ball.radius
    if abs(radius - wanted) > RADIUS_TOLERANCE * wanted:
        what = f"its radius is {1e3 * radius:.3f} mm, expected {1e3 * wanted:.3f} mm as in map {maze.name!r}"
        raise SettingsError(what, key="ball")
    return body, int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])


def _drive(model: mujoco.MjModel, key: str, axis: AxisSection) -> _Drive:
    """An axis in MuJoCo's numbers. Raises SettingsError if the model does not fit."""
    _, joint = _find(model, f"{key}.joint", axis.joint, "joint")
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
        of = np.flatnonzero((model.actuator_trntype == kind) & (model.actuator_trnid[:, 0] == joint))
        if len(of) != 1:
            what = f"joint {shown(axis.joint)} has {len(of)} actuators; expected the name of one"
            raise SettingsError(what, key=f"{key}.actuator")
        number = int(of[0])
    affine = int(model.actuator_biastype[number]) == int(mujoco.mjtBias.mjBIAS_AFFINE)
    if not (affine and model.actuator_biasprm[number][1] < 0.0 and model.actuator_gainprm[number][0] > 0.0):
        raise SettingsError("this actuator holds no position, expected one of kind position", key=f"{key}.actuator")
    return number
