"""Rigs on which a script of mishaps happens: the light rig, or a rig simulated in MuJoCo."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from mazeplan.apps.testing.lightrig import LightRig
from mazeplan.apps.testing.mishapfile import (
    FOR_EVER,
    AxisDead,
    BallOut,
    BallPushed,
    BallStuck,
    BallTeleported,
    CameraBlind,
    Mishap,
    OpeningBlocked,
)
from mazeplan.core.maths.angles import difference
from mazeplan.core.records import Observation
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.sim.settings import Fault, SimulatedSettings, settings_from
from mazeplan.rigs.sim.simulated import SimulatedRig
from mazeplan.run.specification import PUT_BACK_S

SAME_PLACE = math.radians(0.5)  # a ball nearer to an angle than this is at that angle


class _Placed(Protocol):
    @property
    def ring(self) -> int: ...

    @property
    def theta(self) -> float: ...


class _Sticking:
    """Notices when the ball comes to the place where a mishap holds it."""

    def __init__(self, stuck: BallStuck) -> None:
        self.stuck = stuck
        self.theta = None if stuck.theta_deg is None else math.radians(stuck.theta_deg)
        self.held = False
        self._last: float | None = None

    def catches(self, t: float, rig: _Placed) -> bool:
        """Whether the mishap holds the ball at this sample."""
        last, self._last = self._last, rig.theta
        if not self.stuck.active(t):
            self.held = False
        elif not self.held and self.stuck.ring in (None, rig.ring):
            self.held = self.theta is None or self._came_by(self.theta, rig.theta, last)
        return self.held

    def _came_by(self, place: float, now: float, last: float | None) -> bool:
        left = difference(place, now)
        if abs(left) < SAME_PLACE:
            return True
        before = left if last is None else difference(place, last)
        return before * left < 0.0 and abs(before) + abs(left) < 0.5 * math.pi  # not on the far side of the ring


class _Outside:
    """Where a mishap puts the ball: out of the maze for a while, then back into a ring."""

    def __init__(self, mishap: BallOut, maze: Maze) -> None:
        self._mishap, self._maze, self._theta, self._out = mishap, maze, 0.0, False

    def place(self, t: float, rig: _Placed) -> tuple[float, float] | None:
        """Radius (m) and angle (rad) where the mishap puts the ball at this sample; None: it leaves the ball alone."""
        active, mishap = self._mishap.active(t), self._mishap
        if active == self._out:
            return (self._beyond, self._theta) if active else None
        self._out = active
        if active:
            self._theta = rig.theta
            return self._beyond, self._theta
        theta = self._theta if mishap.theta_deg is None else math.radians(mishap.theta_deg)
        return self._maze.track_radius(mishap.ring), theta

    @property
    def _beyond(self) -> float:
        return self._maze.walls[0].outer_radius + 2.0 * self._maze.ball.radius


def _put_back(mishaps: Sequence[Mishap]) -> float | None:
    """How long a run waits for a ball that is out, s: as on a real rig; None if no mishap puts the ball back."""
    return PUT_BACK_S if any(isinstance(m, BallOut) and m.to_s < FOR_EVER for m in mishaps) else None


class _Happened:
    """The mishaps that happen once and have not happened yet."""

    def __init__(self, mishaps: Sequence[Mishap]) -> None:
        self._left = [m for m in mishaps if isinstance(m, BallPushed | BallTeleported)]

    def due(self, t: float, ring: int) -> list[BallPushed | BallTeleported]:
        """The mishaps that happen now, at rig time t with the ball in this ring."""
        now = [m for m in self._left if t >= m.at_s - 1e-9 and m.in_ring in (None, ring)]
        self._left = [m for m in self._left if m not in now]
        return now


class ScriptedRig(LightRig):
    """The light rig, on which a script of mishaps happens."""

    def __init__(
        self, maze: Maze, settings: Mapping[str, Any] | None = None, *, mishaps: Sequence[Mishap] = ()
    ) -> None:
        super().__init__(maze, mishap=lambda _: self._happen())
        self.mishaps = tuple(mishaps)
        self.out_s = _put_back(self.mishaps)

    def reset(self, *, ring: int, theta: float, rng: np.random.Generator | None) -> None:
        """The script begins anew, too."""
        super().reset(ring=ring, theta=theta, rng=rng)
        self._once = _Happened(self.mishaps)
        self._sticking = [_Sticking(m) for m in self.mishaps if isinstance(m, BallStuck)]
        self._outside = [_Outside(m, self.maze) for m in self.mishaps if isinstance(m, BallOut)]

    def _happen(self) -> None:
        t = self.t
        for mishap in self._once.due(t, self.ring):
            if isinstance(mishap, BallTeleported):
                self.place(mishap.ring, math.radians(mishap.theta_deg))
            else:
                self.push(mishap.speed_m_s, math.radians(mishap.direction_deg))
        self.glued = False
        for sticking in self._sticking:
            held = sticking.held
            if sticking.catches(t, self):
                self.glued = True
                if not held:  # put it exactly there, even if it rolled beyond the place in this sample
                    self.put(math.hypot(self.z[0], self.z[1]), self.theta if sticking.theta is None else sticking.theta)
        for outside in self._outside:
            if (place := outside.place(t, self)) is not None:
                self.put(*place)
        self.hidden = any(isinstance(m, CameraBlind) and m.active(t) for m in self.mishaps)
        self.dead = frozenset(axis for m in self.mishaps if isinstance(m, AxisDead) and m.active(t) for axis in m.axes)
        self.block(frozenset(m.opening for m in self.mishaps if isinstance(m, OpeningBlocked) and m.active(t)))


class ScriptedSimulation(SimulatedRig):
    """A rig simulated in MuJoCo, on which a script of mishaps happens.

    Faults of the simulated rig block openings, blind the camera and kill axes. `observe` does what happens to the
    ball."""

    def __init__(
        self,
        maze: Maze,
        settings: Mapping[str, Any] | SimulatedSettings | None = None,
        *,
        mishaps: Sequence[Mishap] = (),
    ) -> None:
        self.mishaps = tuple(mishaps)
        settings = settings if isinstance(settings, SimulatedSettings) else settings_from(settings or {})
        faults = (*settings.faults, *(fault for mishap in mishaps for fault in _faults(mishap)))
        super().__init__(maze, settings.model_copy(update={"faults": faults}))
        self.out_s = _put_back(self.mishaps)

    @property
    def ring(self) -> int:
        """The ring that the ball is in."""
        x, y = self.truth()[:2]
        return self.maze.ring_at(math.hypot(x, y))

    @property
    def theta(self) -> float:
        """Angle of the ball, rad."""
        x, y = self.truth()[:2]
        return math.atan2(y, x)

    def reset(self, *, ring: int, theta: float, rng: np.random.Generator) -> None:
        """The script begins anew, too."""
        super().reset(ring=ring, theta=theta, rng=rng)
        self._once = _Happened(self.mishaps)
        self._sticking = [_Sticking(m) for m in self.mishaps if isinstance(m, BallStuck)]
        self._outside = [_Outside(m, self.maze) for m in self.mishaps if isinstance(m, BallOut)]

    def observe(self) -> Observation:
        """The next sample. Mishaps of the ball act after it, so that the sample after it is the first to show them."""
        observation = super().observe()
        t = observation.t
        for mishap in self._once.due(t, self.ring):
            if isinstance(mishap, BallTeleported):
                self._put(self.maze.track_radius(mishap.ring), math.radians(mishap.theta_deg))
            else:
                self.inject(Fault(kind="push", at_s=t, speed_m_s=mishap.speed_m_s, direction_deg=mishap.direction_deg))
        for sticking in self._sticking:
            held = sticking.held
            if sticking.catches(t, self) and not held:
                self.inject(Fault(kind="stuck", at_s=t, duration_s=sticking.stuck.to_s - t))
        for outside in self._outside:
            if (place := outside.place(t, self)) is not None:
                self._put(*place)
        return observation

    def _put(self, r: float, theta: float) -> None:
        """Put the ball at rest on the floor, at a radius r, m, and an angle theta, rad."""
        place = np.array([r * math.cos(theta), r * math.sin(theta), self.maze.ball.radius])
        self.set_ball(place, np.zeros(3), np.zeros(3))


def _faults(mishap: Mishap) -> list[Fault]:
    """The faults of the simulated rig that produce a mishap; none for what happens to the ball."""
    match mishap:
        case OpeningBlocked(from_s=start, to_s=end):
            return [Fault(kind="blocked", at_s=start, duration_s=end - start, opening=mishap.opening)]
        case CameraBlind(from_s=start, to_s=end):
            return [Fault(kind="blackout", at_s=start, duration_s=end - start)]
        case AxisDead(from_s=start, to_s=end):
            return [Fault(kind="dead_axis", at_s=start, duration_s=end - start, axis=axis) for axis in mishap.axes]
        case _:
            return []
