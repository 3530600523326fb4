"""Plate and ball in a MuJoCo model that a user brings: which joints, actuators and bodies are meant, and whether they
can be those.

The plate's frame is that of a body or site: x and y as in the map, z out of its floor, its origin in the middle of the
maze. beta = sign (q - zero) of its joint, gamma likewise; an actuator of kind position is told scale times the joint's
angle, scale being its gear unless said.
"""

from __future__ import annotations

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module tells type checkers nothing of its names)
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from mazeplan.errors import RigError, SettingsError
from mazeplan.maze.geometry import Maze
from mazeplan.maze.yamltree import shown
from mazeplan.records import Array
from mazeplan.rigs.gimbal import Gimbal, rotation

NUDGE = 1e-3  # rad, by which each joint is moved to see what it does
AWRY = 0.02  # of a nudge, or rad of a level plate: more is no mistake of rounding
ALIKE = 0.02  # by how much the ball's radius may differ from the map's
LYING_S, SUNK = 0.2, 0.5  # s for which a ball must lie where it was put; of its radius, by which it may rise or sink
WHOLE = 1e-6  # by how much a number of steps may differ from a whole one, relative
BODY, SITE = mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_SITE
KINDS = {
    "joint": mujoco.mjtObj.mjOBJ_JOINT, "actuator": mujoco.mjtObj.mjOBJ_ACTUATOR, "body": BODY, "site": SITE,
}  # fmt: skip
UNSTABLE = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)


@dataclass(frozen=True)
class Axis:
    """A joint, its actuator (None: the one of that joint), whether it turns the other way round (-1), what the
    actuator is told per rad of the joint (None: by its gear), and where the joint is when the plate is level, deg."""

    joint: str
    actuator: str | None = None
    sign: int = 1
    scale: float | None = None
    zero_deg: float = 0.0


@dataclass(frozen=True)
class Described:
    """What is what in a model: axes, the ball's body, the plate's body or site, and the floor's height in its frame,
    m."""

    beta: Axis
    gamma: Axis
    ball: str
    plate: str
    floor: float = 0.0


@dataclass(frozen=True)
class _Drive:
    """An axis in MuJoCo's numbers: addresses of the joint in qpos and qvel, the actuator, and what it is told per
    rad."""

    q: int
    v: int
    actuator: int
    sign: float
    zero: float
    scale: float


def read_model(path: Path) -> mujoco.MjModel:
    """A model out of a file. Raises SettingsError in one line."""
    if not path.is_file():
        raise SettingsError(f"no such file: {path}", key="mjcf")
    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except Exception as problem:  # MuJoCo's own kinds differ from version to version
        raise SettingsError(f"{path}: {' '.join(str(problem).split())}", key="mjcf") from None


class UserGimbal(Gimbal):
    """See `Gimbal`; chunks: a second. Raises SettingsError, with its key, where the model cannot be as described."""

    def __init__(self, model: mujoco.MjModel, plan: Described, maze: Maze, chunks: float) -> None:
        super().__init__(model, _steps(model, chunks))
        self._plan = plan
        self._body, self._q, self._v = _ball(model, plan.ball, maze)
        self._frame = _find(model, "plate", plan.plate, "body", "site")
        self._drives = tuple(
            _drive(model, key, axis, maze) for key, axis in (("beta", plan.beta), ("gamma", plan.gamma))
        )
        for name in ("q", "actuator"):
            if getattr(self._drives[0], name) == getattr(self._drives[1], name):
                key = "joint" if name == "q" else "actuator"
                raise SettingsError("is that of beta, too; expected another", key=f"gamma.{key}")
        self._check_level()
        for i in range(2):
            self._check_axis(i)
        self._check_floor(maze)

    # -- whether it can be so ---------------------------------------------------------------------------------------

    def _check_level(self) -> None:
        """The plate's z axis is up where both joints are at their zeros."""
        self._pose((0.0, 0.0))
        up = self._turned()[:, 2]
        gravity = np.array(self.model.opt.gravity)
        if not np.linalg.norm(gravity) > 0.0:
            raise SettingsError("this model has no gravity", key="mjcf")
        off = math.degrees(math.acos(float(np.clip(-up @ gravity / np.linalg.norm(gravity), -1.0, 1.0))))
        if off > 10.0:  # a table that leans by a few degrees is a fine thing to simulate
            what = f"the frame of {self._plan.plate!r} has its z axis {off:.0f} deg off the vertical at level joints"
            raise SettingsError(f"{what}, expected it to point up", key="plate")

    def _check_axis(self, i: int) -> None:
        """Positive beta lowers the +x side, positive gamma lifts the +y side, and neither does the other's."""
        name, other = ("beta", "gamma")[i], ("gamma", "beta")[i]
        self._pose((0.0, 0.0))
        level = self._turned()
        self._pose((NUDGE, 0.0) if i == 0 else (0.0, NUDGE))
        turn = level.T @ self._turned()
        got = (-turn[2, 0] / NUDGE, turn[2, 1] / NUDGE)  # how far +x went down, +y up
        joint = shown((self._plan.beta, self._plan.gamma)[i].joint)
        if abs(got[i] - 1.0) < AWRY and abs(got[1 - i]) < AWRY:
            return
        if abs(got[i] + 1.0) < AWRY and abs(got[1 - i]) < AWRY:
            does = "lifts the +x side" if i == 0 else "lowers the +y side"
            sign = -(self._plan.beta, self._plan.gamma)[i].sign
            raise SettingsError(f"with this sign joint {joint} {does}; expected {sign}", key=f"{name}.sign")
        if abs(abs(got[1 - i]) - 1.0) < AWRY and abs(got[i]) < AWRY:
            what = f"joint {joint} tilts the plate as {other} does; expected the other joint, or a turned frame"
            raise SettingsError(what, key=f"{name}.joint")
        about = "beta about y, " if i == 0 else "gamma about x, "
        down, up = (round(one, 2) + 0.0 for one in got)  # without -0
        what = f"1 rad of joint {joint} lowers the +x side by {down} rad and lifts the +y side by {up} rad"
        raise SettingsError(f"{what}; expected {about}1 and 0 of the other", key=f"{name}.joint")

    def _check_floor(self, maze: Maze) -> None:
        """A ball that is put down in the middle of a ring stays there on the level plate."""
        radius = maze.ball.radius
        for ring in maze.rings:
            far, theta = ring.track_radius, maze.clear_angle(ring.number, 0.0)
            self.reset(np.array([far * math.cos(theta), far * math.sin(theta), radius]))
            mujoco.mj_step(self.model, self.data, nstep=max(1, round(LYING_S / float(self.model.opt.timestep))))
            if self._wild():  # which a run tells
                return
            self.settle()
            above = float(self._turned()[:, 2] @ self.place()) - radius
            if not abs(above) < SUNK * radius:
                where = f"{1e3 * abs(above):.1f} mm {'above' if above > 0.0 else 'below'} it after {LYING_S:g} s"
                what = f"a ball that is put on the floor in the middle of ring {ring.number} is {where}"
                raise SettingsError(f"{what}; expected a floor at {1e3 * self._plan.floor:g} mm", key="floor_mm")

    # -- as the machine needs it ------------------------------------------------------------------------------------

    def reset(self, position: Array) -> None:
        """Level plate, everything at rest, time 0, the ball at a position (3,) in the plate's frame, m."""
        model, data = self.model, self.data
        mujoco.mj_resetData(model, data)
        self._pose((0.0, 0.0))
        self.drive(np.zeros(2))
        data.qvel[:] = 0.0
        data.qpos[self._q : self._q + 3] = self._centre() + self._turned() @ position
        data.qpos[self._q + 3 : self._q + 7] = 1.0, 0.0, 0.0, 0.0
        mujoco.mj_forward(model, data)

    def drive(self, tilt: Array) -> None:
        """Set points of the servos: beta, gamma, rad, (2,)."""
        for drive, angle in zip(self._drives, tilt.tolist(), strict=True):
            self.data.ctrl[drive.actuator] = drive.scale * (drive.zero + drive.sign * angle)

    def advance(self) -> None:
        """Let one chunk pass. Raises RigError where the model goes wild."""
        mujoco.mj_step(self.model, self.data, nstep=self.steps)
        if self._wild():
            raise RigError(f"the model became unstable at t = {self.data.time:.3f} s; expected a smaller time step")
        self.settle()

    def _wild(self) -> bool:
        return any(self.data.warning[int(kind)].number for kind in UNSTABLE)

    def settle(self) -> None:
        """Frames go with the joints again."""
        mujoco.mj_kinematics(self.model, self.data)

    @property
    def tilt(self) -> tuple[float, float]:
        """beta, gamma, rad."""
        beta, gamma = (drive.sign * (float(self.data.qpos[drive.q]) - drive.zero) for drive in self._drives)
        return beta, gamma

    def plate(self) -> tuple[Array, Array]:
        """Rotation (3, 3) from the plate frame to the room, and the plate's angular velocity (3,) in its own frame."""
        turned = self._turned()
        return turned, turned.T @ self._motion()[:3]

    def drawn(self) -> Array:
        """The rotation now, (3, 3)."""
        return self._turned()

    def place(self) -> Array:
        """The ball's, (3,), m."""
        return self.data.qpos[self._q : self._q + 3] - self._centre()

    def velocity(self) -> Array:
        """The ball's, (3,), m/s."""
        return self.data.qvel[self._v : self._v + 3] - self._drift()

    def spin(self) -> Array:
        """The ball's, (3,), rad/s."""
        return self._ball_turned() @ self.data.qvel[self._v + 3 : self._v + 6]

    def put(self, place: Array, velocity: Array, spin: Array) -> None:
        """The ball's state, (3,) each; all else goes on as it was."""
        data = self.data
        data.qpos[self._q : self._q + 3] = self._centre() + place
        data.qvel[self._v : self._v + 3] = velocity + self._drift()
        data.qvel[self._v + 3 : self._v + 6] = self._ball_turned().T @ spin

    def rest(self, place: Array) -> None:
        """Put the ball there, (3,), without speed."""
        self.data.qpos[self._q : self._q + 3] = self._centre() + place
        self.data.qvel[self._v : self._v + 6] = 0.0

    def kick(self, x: float, y: float) -> None:
        """Add to the ball's velocity, m/s."""
        self.data.qvel[self._v] += x
        self.data.qvel[self._v + 1] += y

    def pull(self, force: Array) -> None:
        """Force on the ball from now on, (3,), N."""
        self.data.xfrc_applied[self._body, :3] = force

    # -- frames -----------------------------------------------------------------------------------------------------

    def _pose(self, tilt: tuple[float, float]) -> None:
        """Joints at a tilt, and the frames with them."""
        for drive, angle in zip(self._drives, tilt, strict=True):
            self.data.qpos[drive.q] = drive.zero + drive.sign * angle
        mujoco.mj_kinematics(self.model, self.data)

    def _turned(self) -> Array:
        kind, number = self._frame
        return np.array((self.data.xmat if kind == BODY else self.data.site_xmat)[number]).reshape(3, 3)

    def _centre(self) -> Array:
        """The middle of the maze's floor, in the room."""
        kind, number = self._frame
        origin = (self.data.xpos if kind == BODY else self.data.site_xpos)[number]
        return origin + self._plan.floor * self._turned()[:, 2]

    def _motion(self) -> Array:
        """Angular and linear velocity (6,) of the plate's frame, in the room."""
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_comVel(self.model, self.data)
        kind, number = self._frame
        out = np.empty(6)
        of = mujoco.mjtObj.mjOBJ_XBODY if kind == BODY else SITE
        mujoco.mj_objectVelocity(self.model, self.data, of, number, out, 0)
        return out

    def _drift(self) -> Array:
        """Velocity of the middle of the floor, in the room."""
        motion, up = self._motion(), self._turned()[:, 2]
        return motion[3:] + np.cross(motion[:3], self._plan.floor * up)

    def _ball_turned(self) -> Array:
        return rotation(self.data.qpos[self._q + 3 : self._q + 7])


# -- names to numbers ------------------------------------------------------------------------------------------------


def _names(model: mujoco.MjModel, kind: str) -> list[str]:
    count = {"joint": model.njnt, "actuator": model.nu, "body": model.nbody, "site": model.nsite}[kind]
    names = (mujoco.mj_id2name(model, KINDS[kind], i) for i in range(count))
    return [name for name in names if name and name != "world"]


def _find(model: mujoco.MjModel, key: str, name: str, *kinds: str) -> tuple[Any, int]:
    """MuJoCo's kind and number of what bears the name. Raises SettingsError with the names that there are."""
    for kind in kinds:
        number = mujoco.mj_name2id(model, KINDS[kind], name)
        if number >= 0:
            return KINDS[kind], number
    there = "; ".join(f"{kind}: {', '.join(_names(model, kind)) or 'none with a name'}" for kind in kinds)
    raise SettingsError(f"got {shown(name)}, which the model does not have; {there}", key=key)


def _steps(model: mujoco.MjModel, chunks: float) -> int:
    """MuJoCo's steps in a chunk, of which there are so many a second."""
    step, exact = float(model.opt.timestep), 1.0 / (chunks * float(model.opt.timestep))
    count = max(1, round(exact))
    if abs(exact - count) > WHOLE * count:
        near = 1.0 / (chunks * count)
        what = f"its timestep is {step:g} s, of which {exact:.4g} are in 1/{chunks:g} s; expected a whole number"
        raise SettingsError(f"{what}, such as a timestep of {near:.12g} s", key="mjcf")
    return count


def _ball(model: mujoco.MjModel, name: str, maze: Maze) -> tuple[int, int, int]:
    """The ball's body, and where its free joint is in qpos and qvel."""
    _, body = _find(model, "ball", name, "body")
    joint = int(model.body_jntadr[body])
    free = int(mujoco.mjtJoint.mjJNT_FREE)
    if model.body_jntnum[body] != 1 or int(model.jnt_type[joint]) != free:
        others = [_name(model, int(model.jnt_bodyid[j])) for j in range(model.njnt) if int(model.jnt_type[j]) == free]
        raise SettingsError(
            f"body {shown(name)} has no free joint; bodies with one: {', '.join(others) or 'none'}", key="ball"
        )
    first, count = int(model.body_geomadr[body]), int(model.body_geomnum[body])
    spheres = [g for g in range(first, first + count) if int(model.geom_type[g]) == int(mujoco.mjtGeom.mjGEOM_SPHERE)]
    if not spheres:
        raise SettingsError(f"body {shown(name)} has no geom of type sphere", key="ball")
    radius, wanted = float(model.geom_size[spheres[0]][0]), maze.ball.radius
    if abs(radius - wanted) > ALIKE * wanted:
        what = f"its radius is {1e3 * radius:.3f} mm, expected {1e3 * wanted:.3f} mm as in map {maze.name!r}"
        raise SettingsError(what, key="ball")
    return body, int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])


def _name(model: mujoco.MjModel, body: int) -> str:
    return mujoco.mj_id2name(model, BODY, body) or f"number {body}"


def _drive(model: mujoco.MjModel, key: str, axis: Axis, maze: Maze) -> _Drive:
    """An axis in MuJoCo's numbers."""
    if axis.sign not in (-1, 1):
        raise SettingsError(f"got {axis.sign}, expected 1 or -1", key=f"{key}.sign")
    _, joint = _find(model, f"{key}.joint", axis.joint, "joint")
    if int(model.jnt_type[joint]) != int(mujoco.mjtJoint.mjJNT_HINGE):
        raise SettingsError(f"joint {shown(axis.joint)} is no hinge", key=f"{key}.joint")
    number = _actuator(model, key, axis, joint)
    scale = axis.scale
    if scale is None:
        if int(model.actuator_trntype[number]) != int(mujoco.mjtTrn.mjTRN_JOINT):
            what = "is missing: what the actuator is told per rad of the joint, which its transmission does not tell"
            raise SettingsError(what, key=f"{key}.scale")
        scale = -float(model.actuator_gear[number][0] * model.actuator_biasprm[number][1])
        scale /= float(model.actuator_gainprm[number][0])
    drive = _Drive(
        int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint]), number, float(axis.sign),
        math.radians(axis.zero_deg), scale,
    )  # fmt: skip
    _check_reach(model, key, axis, joint, drive, maze.tilt_limit)
    return drive


def _actuator(model: mujoco.MjModel, key: str, axis: Axis, joint: int) -> int:
    """The actuator of an axis, which holds a position."""
    if axis.actuator is not None:
        _, number = _find(model, f"{key}.actuator", axis.actuator, "actuator")
    else:
        kind = int(mujoco.mjtTrn.mjTRN_JOINT)
        of = [
            i for i in range(model.nu) if int(model.actuator_trntype[i]) == kind and model.actuator_trnid[i][0] == joint
        ]
        if len(of) != 1:
            there = ", ".join(_names(model, "actuator")) or "none with a name"
            what = f"joint {shown(axis.joint)} has {len(of)} actuators; expected the name of one: {there}"
            raise SettingsError(what, key=f"{key}.actuator")
        number = of[0]
    affine = int(model.actuator_biastype[number]) == int(mujoco.mjtBias.mjBIAS_AFFINE)
    if not (affine and model.actuator_biasprm[number][1] < 0.0 and model.actuator_gainprm[number][0] > 0.0):
        raise SettingsError("this actuator holds no position, expected one of kind position", key=f"{key}.actuator")
    return number


def _check_reach(model: Any, key: str, axis: Axis, joint: int, drive: _Drive, limit: float) -> None:
    """Raises SettingsError where joint or actuator end before the map's tilt limit."""
    ends = [drive.zero - limit, drive.zero + limit]
    if model.jnt_limited[joint] and not _within(ends, model.jnt_range[joint]):
        low, high = (math.degrees(float(end)) for end in model.jnt_range[joint])
        what = f"joint {shown(axis.joint)} goes from {low:.3g} to {high:.3g} deg"
        raise SettingsError(f"{what}, expected {_degrees(ends)}: the map's tilt limit", key=f"{key}.joint")
    told = sorted(drive.scale * end for end in ends)
    if model.actuator_ctrllimited[drive.actuator] and not _within(told, model.actuator_ctrlrange[drive.actuator]):
        low, high = (float(end) for end in model.actuator_ctrlrange[drive.actuator])
        what = f"its ctrlrange is {low:.4g} to {high:.4g}, expected {told[0]:.4g} to {told[1]:.4g}"
        raise SettingsError(f"{what}: the map's tilt limit", key=f"{key}.actuator")


def _within(ends: list[float], allowed: Any) -> bool:
    return bool(allowed[0] <= ends[0] + WHOLE and ends[1] - WHOLE <= allowed[1])


def _degrees(ends: list[float]) -> str:
    low, high = (math.degrees(end) for end in ends)
    return f"{low:.3g} to {high:.3g} deg"
