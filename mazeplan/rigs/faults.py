"""Faults of the simulated rig, on a schedule: they make the recoveries of a behaviour tree happen."""

from __future__ import annotations

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module tells type checkers nothing of its names)
import math
from collections.abc import Sequence

import mujoco
import numpy as np

from mazeplan.errors import SettingsError
from mazeplan.maze.geometry import Maze
from mazeplan.records import Array
from mazeplan.rigs.mjcf import PLUG_OFF, PLUG_ON, plug_name
from mazeplan.rigs.settings import Fault


class FaultBox:
    """Applies the faults of one run to a MuJoCo model and its data. Raises SettingsError for an opening that does
    not exist."""

    def __init__(self, faults: Sequence[Fault], model: mujoco.MjModel, data: mujoco.MjData, maze: Maze) -> None:
        self._faults, self._model, self._data = list(faults), model, data
        names = [opening.name for opening in maze.openings]
        for i, fault in enumerate(faults):
            if fault.kind == "blocked" and fault.opening not in names:
                raise SettingsError(
                    f"got {fault.opening!r}, expected one of {', '.join(names)}", key=f"faults[{i}].opening"
                )
        self._pushed: set[int] = set()
        self._glued: Array | None = None
        self._frozen: dict[int, float] = {}

    def add(self, fault: Fault) -> None:
        """Inject one more, also while running."""
        self._faults.append(fault)

    def active(self, kind: str, t: float) -> list[Fault]:
        """Faults of a kind that act at time t."""
        return [f for f in self._faults if f.kind == kind and f.at_s <= t < f.at_s + f.duration_s]

    def blackout(self, t: float) -> bool:
        """Whether the camera sees nothing."""
        return bool(self.active("blackout", t))

    def servo(self, t: float, wanted: Array) -> Array:
        """The set points that reach the servos: a dead axis keeps its last one."""
        out = np.array(wanted, dtype=float)
        dead = {("beta", "gamma").index(fault.axis) for fault in self.active("dead_axis", t)}
        for axis in range(2):
            if axis in dead:
                out[axis] = self._frozen.setdefault(axis, float(self._data.ctrl[axis]))
            else:
                self._frozen.pop(axis, None)
        return out

    def before_step(self, t: float) -> None:
        """Plugs and kicks."""
        blocked = {fault.opening for fault in self.active("blocked", t)}
        for fault in self._faults:
            if fault.kind == "blocked" and fault.opening is not None:
                geom = mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_GEOM, plug_name(fault.opening))
                on = PLUG_ON if fault.opening in blocked else PLUG_OFF
                self._model.geom_contype[geom] = self._model.geom_conaffinity[geom] = on
        for i, fault in enumerate(self._faults):
            if fault.kind == "push" and i not in self._pushed and t >= fault.at_s:
                self._pushed.add(i)
                angle = math.radians(fault.direction_deg)
                self._data.qvel[2] += fault.speed_m_s * math.cos(angle)
                self._data.qvel[3] += fault.speed_m_s * math.sin(angle)

    def after_step(self, t: float) -> None:
        """A glued ball goes with the plate: its pose in the plate's frame is put back after each step."""
        if not self.active("stuck", t):
            self._glued = None
            return
        plate = self._data.body("plate")
        rotation = plate.xmat.reshape(3, 3)
        if self._glued is None:
            self._glued = rotation.T @ self._data.qpos[2:5]
        self._data.qpos[2:5] = rotation @ self._glued
        self._data.qvel[2:8] = 0.0
