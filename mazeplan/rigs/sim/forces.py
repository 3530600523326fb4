"""Forces and friction of a simulated rig. A planner's model may lack them.

magnet    acceleration A c (s / d) (1 + s^2 / d^2)^-4 towards the magnet, at distance s along the plate and depth d: the
          gradient of the squared field of a dipole. The constant c makes A the strongest pull, at s = d / sqrt(7)
saddle    height H (r / R)^2 cos 2 (theta - phi) of the floor, R the outer radius of the maze. The ball accelerates
          downhill by g times the slope
drag      the ball slows down by (drag_per_s + drag_growth_per_s2 t + drag_per_m speed) times its speed. Its spin
          decreases at the same rate, on the floor alone and along a wall
pushes    accelerations along the ring, + counter-clockwise: a steady one, and A sin(n (theta - crest)) of a wavy floor.
          A torque adds the spin that belongs to the added speed. In the disc in the middle there are no pushes, because
          it has no direction along a ring
imbalance torque m g e d x down of a ball whose mass is off its middle by e in the direction d, which turns with the
          ball. On the floor, the ball accelerates towards its heavy side by up to A = g e / (r (1 + k))
wind      a steady force in the frame of the room, divided by the ball's mass; it does not tilt with the plate
rocking   gravity leans as on a table tilted by beta, gamma = amplitude sin(2 pi f t + phase)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mazeplan.core.constants import GRAVITY
from mazeplan.core.errors import SettingsError
from mazeplan.core.maths.angles import difference
from mazeplan.core.records import Array
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.sim.settings import SimulatedSettings

PULL = math.sqrt(7.0) * (8.0 / 7.0) ** 4  # the constant c: with it the strongest pull along the plate is 1
MIN_SPEED = 2e-3  # m/s; below this speed, the ball's direction and its spin of rolling are uncertain


@dataclass(frozen=True)
class Motion:
    """Position (m), velocity (m/s) and spin (rad/s) of the ball in the plate's frame, (3,) each."""

    place: Array
    velocity: Array
    spin: Array

    @property
    def radius(self) -> float:
        """Distance from the middle, m."""
        return math.hypot(self.place[0], self.place[1])

    @property
    def theta(self) -> float:
        """Angle in the plate, rad."""
        return math.atan2(self.place[1], self.place[0])

    @property
    def along(self) -> Array:
        """Unit vector (3,) along the ring, counter-clockwise."""
        theta = self.theta
        return np.array([-math.sin(theta), math.cos(theta), 0.0])


def heavy_side(settings: SimulatedSettings, theta: float) -> Array:
    """Unit vector (3,) from the ball's middle to its mass at the start, at an angle in the maze (rad)."""
    phase = math.radians(settings.imbalance_phase_deg)
    return np.array([-math.sin(theta) * math.sin(phase), math.cos(theta) * math.sin(phase), math.cos(phase)])


class Forces:
    """Forces and friction of one machine. The machine skips the groups that it does not have.

    Raises SettingsError for a ring that the maze does not have."""

    def __init__(self, settings: SimulatedSettings, maze: Maze) -> None:
        s = self._settings = settings
        for key, ring in (("sticky_ring", s.sticky_ring), ("kerb_ring", s.kerb_ring)):
            if ring > len(maze.rings):
                raise SettingsError(f"got {ring}, expected 1 to {len(maze.rings)}", key=key)
        self._maze = maze
        self._mass = maze.ball.mass
        self._radius = maze.ball.radius
        self.on_plate = s.magnet_m_s2 > 0.0 or s.warp_mm > 0.0
        pushes = (s.ring_push_m_s2, s.imbalance_m_s2, s.ripple_m_s2, *s.draught_m_s2, *s.rocking_deg)
        self.on_ball = any(value != 0.0 for value in (s.drag_per_s, s.drag_per_m, s.drag_growth_per_s2, *pushes))
        self.on_floor = s.sticky_m_s2 > 0.0 or s.nap_m_s2 != 0.0
        self.has_kerb = s.kerb_loss > 0.0
        self.any = self.on_plate or self.on_ball or self.on_floor or self.has_kerb
        self._spot = 1e-3 * np.array(s.magnet_mm)
        self._depth = 1e-3 * s.magnet_depth_mm
        self._edge = maze.rings[0].outer_radius
        self._cos, self._sin = (f(2.0 * math.radians(s.warp_deg)) for f in (math.cos, math.sin))
        self._inertia = s.ball_inertia * self._mass * self._radius**2
        # m of rolling friction for each m/s^2 by which a ball on the floor slows down
        self._metres = self._radius * (1.0 + s.ball_inertia) / GRAVITY
        start, end = (math.radians(angle) for angle in s.sticky_deg)
        self._start = start
        self._span = (end - start) % math.tau

    def of_plate(self, position: Array) -> Array:
        """Force (3,), N, of magnet and saddle in the plate's frame, at a position (3,), m."""
        out = np.zeros(3)
        s = (position[:2] - self._spot) / self._depth
        out[:2] -= self._settings.magnet_m_s2 * PULL * s / (1.0 + float(s @ s)) ** 4
        x, y = position[:2] / self._edge
        slope = 2e-3 * self._settings.warp_mm / self._edge
        out[:2] -= GRAVITY * slope * np.array([x * self._cos + y * self._sin, x * self._sin - y * self._cos])
        return self._mass * out

    def of_ball(self, t: float, motion: Motion, plate: Array, heavy: Array) -> tuple[Array, Array]:
        """Force (N) and torque (N m) by drag, pushes, imbalance, wind and rocking in the room's frame, (3,), at t, s.

        plate: rotation (3, 3) of the plate.
        heavy: unit vector (3,) from the ball's middle to its mass, in the frame of the room."""
        s = self._settings
        rate = s.drag_per_s + s.drag_growth_per_s2 * t + s.drag_per_m * float(np.linalg.norm(motion.velocity))
        faster, spun = -rate * motion.velocity, -rate * motion.spin
        push = self._push(motion)
        if push != 0.0:
            along = motion.along
            faster = faster + push * along
            spun = spun + push * self._spin_of_rolling(motion, along)
        wind = np.array([*s.draught_m_s2, 0.0])  # m/s^2, in the frame of the room
        force = plate @ (self._mass * faster) + self._mass * (wind + self._leaning(t))
        weight = (self._inertia + self._mass * self._radius**2) * s.imbalance_m_s2 / self._radius
        return force, plate @ (self._inertia * spun) + weight * np.array([-heavy[1], heavy[0], 0.0])

    def _push(self, motion: Motion) -> float:
        """Acceleration along the ring, m/s^2."""
        s = self._settings
        if self._maze.ring(self._maze.ring_at(motion.radius)).is_disc:
            return 0.0
        ripple = s.ripple_m_s2 * math.sin(s.ripple_waves * (motion.theta - math.radians(s.ripple_deg)))
        return s.ring_push_m_s2 + ripple

    def _spin_of_rolling(self, motion: Motion, along: Array) -> Array:
        """Spin (3,) of a ball that rolls along the ring, divided by its speed, 1/m.

        The floor turns the ball about the ring's radius, a wall turns it about the vertical."""
        speed, most = float(motion.velocity @ along), 1.0 / self._radius
        upright = float(motion.spin[2]) * speed / (speed * speed + MIN_SPEED * MIN_SPEED)
        return np.array([-along[1] * most, along[0] * most, min(max(upright, -most), most)])

    def _leaning(self, t: float) -> Array:
        """Change of gravity in the frame of the room by rocking, m/s^2, (3,)."""
        s = self._settings
        swing = math.sin(math.tau * s.rocking_hz * t + math.radians(s.rocking_phase_deg))
        b, c = (math.radians(amplitude) * swing for amplitude in s.rocking_deg)
        down = math.cos(b) * math.cos(c)
        return GRAVITY * np.array([math.sin(b), -math.sin(c) * math.cos(b), 1.0 - down])

    def friction(self, motion: Motion, gravity: Array) -> float:
        """Additional rolling friction by place and direction, m. gravity: (3,), m/s^2, in the plate's frame."""
        s, slows = self._settings, 0.0
        if (
            s.sticky_m_s2 > 0.0
            and self._maze.ring_at(motion.radius) == s.sticky_ring
            and (motion.theta - self._start) % math.tau <= self._span
        ):
            slows += s.sticky_m_s2
        if s.nap_m_s2 != 0.0:
            along = motion.along
            speed = float(motion.velocity @ along)
            if abs(speed) < MIN_SPEED:  # at rest, gravity decides whether the ball pushes against the nap
                speed = float(gravity @ along)
            slows += abs(s.nap_m_s2) if speed * s.nap_m_s2 > 0.0 else 0.0
        return slows * self._metres

    def passes_kerb(self, before: Motion, after: Motion) -> bool:
        """Whether the ball crossed the ridge, which takes a share of its speed."""
        if self._maze.ring_at(after.radius) != self._settings.kerb_ring:
            return False
        at = math.radians(self._settings.kerb_deg)
        was, way = difference(before.theta, at), difference(after.theta, before.theta)
        return (was < 0.0 <= was + way) or (was + way < 0.0 <= was)
