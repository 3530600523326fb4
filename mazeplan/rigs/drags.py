"""What slows and pushes the ball of the simulated rig as it moves, beside what lies under the plate (`forces`).

drag        - m (c + g t + q |v|) v
torque      m a, around the maze, counter-clockwise
friction    - m s v / |v|: counter-clockwise only, or where the floor is dirty
ripple      m a cos(n theta), around the maze: a wavy floor
draught     m (x, y) in the room
rocking     m times what the table's swinging adds to gravity in the room
kerb        where the ball passes an angle of a ring, it keeps a share of its speed and spin
"""

from __future__ import annotations

import math

import numpy as np

from mazeplan.maze.geometry import Maze
from mazeplan.records import Array
from mazeplan.rigs.forces import GRAVITY
from mazeplan.rigs.gimbal import Gimbal
from mazeplan.rigs.settings import SimulatedSettings

CREEP = 5e-3  # m/s; a friction grows up to its full size below this speed, as time goes on in steps
NEAR = 0.5  # rad; a ball that is further from a kerb does not meet it in a step


class Drags:
    """Forces on the ball; false where there are none. kerb: whether there is one."""

    def __init__(self, settings: SimulatedSettings, maze: Maze) -> None:
        self._s, self._maze, self._mass = settings, maze, maze.ball.mass
        self.kerb = settings.kerb_loss > 0.0
        self._still = _lean(settings, 0.0)
        self._moves = any(
            (
                settings.drag_per_s, settings.drag_per_m, settings.drag_growth_per_s2, settings.torque_m_s2,
                settings.one_way_m_s2, settings.dirt_m_s2, settings.ripple_m_s2, settings.rocking_x_deg,
                settings.rocking_y_deg, *settings.draught_m_s2,
            )
        )  # fmt: skip

    def __bool__(self) -> bool:
        return self._moves

    def on(self, position: Array, velocity: Array, t: float) -> Array:
        """Force (3,), N, in the plate's frame, at a position and velocity (3,) there, m, m/s, and a time, s."""
        s, (x, y), v = self._s, position[:2], velocity[:2]
        r, speed = math.hypot(x, y), float(np.hypot(*v))
        out = np.zeros(3)
        out[:2] -= (s.drag_per_s + s.drag_growth_per_s2 * t + s.drag_per_m * speed) * v
        if r < 1e-3:
            return self._mass * out
        around = np.array([-y, x]) / r
        out[:2] += (s.torque_m_s2 + s.ripple_m_s2 * math.cos(s.ripple_waves * math.atan2(y, x))) * around
        friction = s.one_way_m_s2 if float(v @ around) > 0.0 else 0.0
        if s.dirt_m_s2 > 0.0 and self._dirty(r, math.atan2(y, x)):
            friction += s.dirt_m_s2
        out[:2] -= friction * v / max(speed, CREEP)
        return self._mass * out

    def in_room(self, t: float) -> Array:
        """Force (3,), N, in the frame of the room."""
        force = np.array([*self._s.draught_m_s2, 0.0])
        if self._s.rocking_x_deg or self._s.rocking_y_deg:
            force = force + _lean(self._s, math.sin(2.0 * math.pi * self._s.rocking_hz * t)) - self._still
        return self._mass * force

    def angle(self, gimbal: Gimbal) -> float:
        """The ball's, from the kerb on, rad, -pi to pi."""
        plate, _ = gimbal.plate()
        x, y, _ = plate.T @ gimbal.place()
        away = math.atan2(y, x) - math.radians(self._s.kerb_deg)
        return math.remainder(away, 2.0 * math.pi)

    def met(self, gimbal: Gimbal, before: float) -> bool:
        """Whether the ball has passed the kerb; before: `angle` at the beginning of the step."""
        plate, _ = gimbal.plate()
        x, y, _ = plate.T @ gimbal.place()
        if self._maze.ring_at(math.hypot(x, y)) != self._s.kerb_ring:
            return False
        after = self.angle(gimbal)
        return before * after <= 0.0 and before != after and abs(before) < NEAR and abs(after) < NEAR

    def _dirty(self, r: float, angle: float) -> bool:
        first, last = (math.radians(value) for value in self._s.dirt_deg)
        inside = (angle - first) % (2.0 * math.pi) <= (last - first) % (2.0 * math.pi)
        return inside and self._maze.ring_at(r) == self._s.dirt_ring


def _lean(settings: SimulatedSettings, swing: float) -> Array:
    """Gravity (3,), m/s^2, along the table as it leans; swing: -1 to 1."""
    x = math.radians(settings.table_x_deg + swing * settings.rocking_x_deg)
    y = math.radians(settings.table_y_deg + swing * settings.rocking_y_deg)
    return GRAVITY * np.array([math.sin(y), -math.sin(x) * math.cos(y), -math.cos(x) * math.cos(y)])


def stage_mix(settings: SimulatedSettings) -> Array | None:
    """What becomes of both commands, (2, 2): each servo's gain, and the share of the other's; None: nothing."""
    beta, gamma = settings.servo_gain_beta, settings.servo_gain_gamma
    mixed = np.array(
        [[beta, beta * settings.coupling_beta_from_gamma], [gamma * settings.coupling_gamma_from_beta, gamma]]
    )
    return None if np.array_equal(mixed, np.eye(2)) else mixed
