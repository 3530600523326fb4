"""Faults of the simulated machine, on a schedule. They test the recoveries of a behaviour tree."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mazeplan.core.errors import SettingsError
from mazeplan.core.name_hints import one_of
from mazeplan.core.records import Array
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.sim.gimbal import Gimbal
from mazeplan.rigs.sim.settings import Fault

ASIDE = 0.1  # m beside and above the plate's rim: place of a ball that is taken out


def check_fault(fault: Fault, key: str, maze: Maze) -> None:
    """Raises SettingsError for an opening, ring or ball that the maze does not have.

    key: key of the fault in the rig's file."""
    names = [opening.name for opening in maze.openings]
    if fault.kind == "blocked" and fault.opening not in names:
        raise SettingsError(f"got {fault.opening!r}, expected {one_of(names, fault.opening)}", key=f"{key}.opening")
    if fault.kind == "teleport" and fault.ring > len(maze.rings):
        raise SettingsError(f"got {fault.ring}, expected 1 to {len(maze.rings)}", key=f"{key}.ring")
    if fault.ball > maze.balls:
        raise SettingsError(f"got {fault.ball}, expected at most {maze.balls} on this map", key=f"{key}.ball")


class FaultBox:
    """Applies the faults of one run to a MuJoCo model. `check_fault` must have accepted the faults."""

    def __init__(self, faults: Sequence[Fault], gimbal: Gimbal, maze: Maze) -> None:
        self._faults, self._gimbal, self._maze = list(faults), gimbal, maze
        self._done: set[int] = set()
        self._held = dict[int, Array]()  # {index of a held ball: its place (3,) in the plate's frame}
        self._taken_from = dict[int, Array]()
        self._reached = np.zeros(2)  # set points of the servos after their faults
        self._at = 0.0

    def add(self, fault: Fault) -> None:
        """Add a fault, also while running. Raises SettingsError as `check_fault` does."""
        check_fault(fault, "fault", self._maze)
        self._faults.append(fault)

    def active(self, kind: str, t: float) -> list[Fault]:
        """Faults of a kind that act at time t."""
        return [f for f in self._faults if f.kind == kind and f.at_s <= t < f.at_s + f.duration_s]

    def blackout(self, t: float) -> bool:
        """Whether the camera sees nothing at time t."""
        return bool(self.active("blackout", t))

    def out(self, t: float, index: int = 0) -> bool:
        """Whether a ball is taken out at time t; the first ball has index 0."""
        return self._acts("removed", t, index)

    def _acts(self, kind: str, t: float, index: int) -> bool:
        return any(fault.ball == index + 1 for fault in self.active(kind, t))

    def servo(self, t: float, wanted: Array) -> Array:
        """Set points that reach the servos, (2,), rad. A dead axis keeps its last set point, at first its middle."""
        out, dt, last = np.array(wanted, dtype=float), t - self._at, self._reached
        for fault in self.active("slow_axis", t):
            most = math.radians(fault.slew_deg_s) * dt
            for axis in _axes(fault):
                out[axis] = min(max(out[axis], last[axis] - most), last[axis] + most)
        for fault in self.active("dead_axis", t):
            for axis in _axes(fault):
                out[axis] = last[axis]
        for fault in self.active("brown_out", t):
            for axis in _axes(fault):
                out[axis] = 0.0
        self._reached, self._at = out.copy(), t
        for fault in self.active("offset_axis", t):
            for axis in _axes(fault):
                out[axis] += math.radians(fault.offset_deg)
        return out

    def before_step(self, t: float) -> None:
        """Apply the faults that act before a step: plugs, kicks, and moves of a ball to another place."""
        blocked = {fault.opening for fault in self.active("blocked", t)}
        for fault in self._faults:
            if fault.kind == "blocked" and fault.opening is not None:
                self._gimbal.plug(fault.opening, fault.opening in blocked)
        for i, fault in enumerate(self._faults):
            if fault.kind in ("push", "teleport") and i not in self._done and t >= fault.at_s:
                self._done.add(i)
                angle = math.radians(fault.direction_deg)
                if fault.kind == "push":
                    x, y = fault.speed_m_s * math.cos(angle), fault.speed_m_s * math.sin(angle)
                    self._gimbal.kick(x, y, fault.ball - 1)
                else:
                    radius = self._maze.track_radius(fault.ring)
                    place = np.array([radius * math.cos(angle), radius * math.sin(angle), self._maze.ball.radius])
                    self._put(place, fault.ball - 1)

    def _put(self, position: Array, index: int) -> None:
        """Put a ball to rest at a position (3,), m, in the plate's frame."""
        self._gimbal.rest(self._gimbal.drawn() @ position, index)

    def after_step(self, t: float) -> None:
        """Make glued and removed balls move with the plate: restore their places in its frame after each step."""
        for index in range(self._maze.balls):
            self._hold(t, index)

    def _hold(self, t: float, index: int) -> None:
        glued, out, taken_from = self._acts("stuck", t, index), self.out(t, index), self._taken_from.get(index)
        if not (glued or out) and taken_from is None:
            self._held.pop(index, None)
            return
        here = self._gimbal.drawn().T @ self._gimbal.place_of(index)
        if out and taken_from is None:
            self._taken_from[index] = here
        elif not out and taken_from is not None:
            self._put(taken_from, index)
            del self._taken_from[index]
        if not (glued or out):
            self._held.pop(index, None)
            return
        held = self._held.get(index, here)
        if out:
            held = np.array([self._maze.walls[0].outer_radius + ASIDE * (1 + index), 0.0, ASIDE])
        self._held[index] = held
        self._put(held, index)


def _axes(fault: Fault) -> tuple[int, ...]:
    return {"beta": (0,), "gamma": (1,), "both": (0, 1)}[fault.axis]
