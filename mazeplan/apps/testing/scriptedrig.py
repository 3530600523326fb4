"""The light rig, on which a script of mishaps happens."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

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
from mazeplan.maze.geometry import Maze
from mazeplan.run.specification import PUT_BACK_S

SAME_PLACE = math.radians(0.5)  # a ball nearer to an angle than this is at that angle


class _Sticking:
    """Notices when the ball comes to the place where a mishap holds it."""

    def __init__(self, stuck: BallStuck) -> None:
        self.stuck = stuck
        self.theta = None if stuck.theta_deg is None else math.radians(stuck.theta_deg)
        self.held = False
        self._last: float | None = None

    def catches(self, t: float, rig: LightRig) -> bool:
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

    def place(self, t: float, rig: LightRig) -> tuple[float, float] | None:
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


class ScriptedRig(LightRig):
    """The light rig, on which a script of mishaps happens."""

    def __init__(
        self, maze: Maze, settings: Mapping[str, Any] | None = None, *, mishaps: Sequence[Mishap] = ()
    ) -> None:
        super().__init__(maze, mishap=lambda _: self._happen())
        self.mishaps = tuple(mishaps)
        back = any(isinstance(m, BallOut) and m.to_s < FOR_EVER for m in self.mishaps)
        self.out_s = PUT_BACK_S if back else None  # s that a run waits for a ball that is out, as on a real rig

    def reset(self, *, ring: int, theta: float, rng: np.random.Generator | None) -> None:
        """The script begins anew, too."""
        super().reset(ring=ring, theta=theta, rng=rng)
        self._once = [m for m in self.mishaps if isinstance(m, BallPushed | BallTeleported)]
        self._sticking = [_Sticking(m) for m in self.mishaps if isinstance(m, BallStuck)]
        self._outside = [_Outside(m, self.maze) for m in self.mishaps if isinstance(m, BallOut)]

    def _happen(self) -> None:
        t = self.t
        due = [m for m in self._once if t >= m.at_s - 1e-9 and m.in_ring in (None, self.ring)]
        self._once = [m for m in self._once if m not in due]
        for mishap in due:
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
