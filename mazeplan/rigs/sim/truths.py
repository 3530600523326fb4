"""True values of a simulated rig, as parameters of mazeplan's effects: rad, m, s, and rad/s^2 along a ring.

The values follow from the settings, without a fit. The values for gravity and for the floor's friction (table,
friction, hollow, magnet, warp, nap, sticky, unbalanced) hold for a ball that rolls on the floor alone. For a ball that
also rolls along a wall, they are (1 + k) / (1 + 2 k) times as large; the ball's inertia is k m r^2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from mazeplan.core.constants import GRAVITY
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.sim.settings import SimulatedSettings

Values = dict[str, float]
AXES = ("beta", "gamma")


@dataclass(frozen=True)
class RigInRing:
    """Settings of a rig, and one ring of its maze."""

    settings: SimulatedSettings
    maze: Maze
    ring: int

    @property
    def radius(self) -> float:
        """Radius of the ball's track, m."""
        return self.maze.track_radius(self.ring)

    @property
    def rolling(self) -> float:
        """Acceleration of a ball that rolls on the floor, divided by that of a ball that slides without friction."""
        return 1.0 / (1.0 + self.settings.ball_inertia)


def true_by_ring(effect: str, settings: SimulatedSettings, maze: Maze) -> dict[int, Values]:
    """{ring: {parameter: value}} of an effect, for the rings that have it, without the disc in the middle."""
    rings = [ring.number for ring in maze.rings if not ring.is_disc]
    found = {ring: TRUE[effect](RigInRing(settings, maze, ring)) for ring in rings}
    return {ring: values for ring, values in found.items() if values}


# -- the ball --------------------------------------------------------------------------------------------------------


def _dry_friction(a: RigInRing) -> Values:
    s = a.settings
    even = a.rolling * GRAVITY * s.rolling_friction_m / a.maze.ball.radius
    return {"coefficient": (even + 0.5 * abs(s.nap_m_s2)) / a.radius, "asymmetry": 0.5 * s.nap_m_s2 / a.radius}


def _wall_friction(a: RigInRing) -> Values:
    """The force of the wall on the ball, divided by the ball's mass, is (1 + k) v^2 / R.

    On a curve the floor turns the direction of the ball's spin, and so pushes the ball outwards; this adds the k."""
    k = a.settings.ball_inertia
    return {"coefficient": (1.0 + k) / (1.0 + 2.0 * k) * a.settings.wall_rolling_friction_m / a.maze.ball.radius}


def _surface_profile(a: RigInRing) -> Values:
    """Angular acceleration downhill on the saddle: 2 g H / R^2 sin 2 (theta - phi), R the radius of the edge."""
    edge, phi = a.maze.rings[0].outer_radius, math.radians(a.settings.warp_deg)
    size = a.rolling * 2e-3 * GRAVITY * a.settings.warp_mm / edge**2
    return {"cos2": -size * math.sin(2.0 * phi), "sin2": size * math.cos(2.0 * phi)}


def _surface_bump(a: RigInRing) -> Values:
    """A magnet as a bump: its pull is strongest at the distance depth / sqrt(7) along the plate."""
    x, y = (1e-3 * part for part in a.settings.magnet_mm)
    if a.maze.ring_at(math.hypot(x, y)) != a.ring:
        return {}
    width = 1e-3 * a.settings.magnet_depth_mm / math.sqrt(7.0) / a.radius
    return {
        "centre": math.atan2(y, x), "width": width, "height": -a.rolling * a.settings.magnet_m_s2 / a.radius
    }  # fmt: skip


def _surface_ripple(a: RigInRing) -> Values:
    s = a.settings
    n, size, crest = s.ripple_waves, s.ripple_m_s2 / a.radius, math.radians(s.ripple_deg)
    return {f"cos{n}": -size * math.sin(n * crest), f"sin{n}": size * math.cos(n * crest)}


def _local_friction(a: RigInRing) -> Values:
    s = a.settings
    if s.sticky_ring != a.ring:
        return {}
    start, end = (math.radians(angle) for angle in s.sticky_deg)
    return {"ring": float(a.ring), "start": start, "end": end, "coefficient": s.sticky_m_s2 / a.radius}


def _gate_loss(a: RigInRing) -> Values:
    s = a.settings
    return {"angle": math.radians(s.kerb_deg), "loss": s.kerb_loss} if s.kerb_ring == a.ring else {}


def _table_rocking(a: RigInRing) -> Values:
    s = a.settings
    swing = {axis: math.radians(size) for axis, size in zip(AXES, s.rocking_deg, strict=True)}
    return {"frequency": s.rocking_hz, **swing, "phase": math.radians(s.rocking_phase_deg)}


# -- servos and sensors ----------------------------------------------------------------------------------------------


def _servo_lag(a: RigInRing) -> Values:
    s = a.settings
    return {
        "beta_natural_frequency": s.servo_frequency_rad_s,
        "beta_damping": s.servo_damping,
        "gamma_natural_frequency": s.servo_gamma_frequency_rad_s or s.servo_frequency_rad_s,
        "gamma_damping": s.servo_gamma_damping or s.servo_damping,
    }


def _backlash(a: RigInRing) -> Values:
    s = a.settings
    return {axis: math.radians(s.backlash_deg) * (s.backlash_axis in ("both", axis)) for axis in AXES}


def _sensor_delay(a: RigInRing) -> Values:
    s = a.settings
    return {"delay": s.camera_delay_frames / s.rate_hz + 1e-3 * s.camera_late_ms}


def _lens(a: RigInRing) -> Values:
    x, y = (1e-3 * part for part in a.settings.lens_mm)
    return {"k": a.settings.lens_per_m2, "x": x, "y": y}


def _pair(values: tuple[float, float], names: tuple[str, str] = AXES, factor: float = 1.0) -> Values:
    return {name: factor * value for name, value in zip(names, values, strict=True)}


TRUE: dict[str, Callable[[RigInRing], Values]] = {
    "tilt_offset": lambda a: _pair((math.radians(a.settings.table_y_deg), math.radians(a.settings.table_x_deg))),
    "rolling_inertia": lambda a: {"factor": a.rolling},
    "dry_friction": _dry_friction,
    "wall_friction": _wall_friction,
    "viscous_friction": lambda a: {"coefficient": a.settings.drag_per_s},
    "quadratic_drag": lambda a: {"coefficient": a.settings.drag_per_m * a.radius},
    "friction_drift": lambda a: {"rate": a.settings.drag_growth_per_s2, "start": 0.0},
    "constant_torque": lambda a: {"acceleration": a.settings.ring_push_m_s2 / a.radius},
    "constant_force": lambda a: _pair(a.settings.draught_m_s2, ("x", "y")),
    "ball_imbalance": lambda a: {"amplitude": a.settings.imbalance_m_s2 / a.radius},  # the phase is lost in slips
    "surface_profile": _surface_profile,
    "surface_bump": _surface_bump,
    "surface_ripple": _surface_ripple,
    "local_friction": _local_friction,
    "gate_loss": _gate_loss,
    "table_rocking": _table_rocking,
    "servo_gain": lambda a: _pair(a.settings.servo_gain),
    "servo_lag": _servo_lag,
    "axis_coupling": lambda a: _pair(a.settings.servo_coupling, ("beta_from_gamma", "gamma_from_beta")),
    "command_delay": lambda a: {"delay": 1e-3 * a.settings.command_delay_ms},
    "deadband": lambda a: dict.fromkeys(AXES, math.radians(a.settings.deadband_deg)),
    "backlash": _backlash,
    "tilt_gain": lambda a: _pair(a.settings.tilt_scale),
    "axis_misalignment": lambda a: {"angle": math.radians(a.settings.camera_rotation_deg)},
    "camera_offset": lambda a: _pair(a.settings.camera_offset_mm, ("x", "y"), 1e-3),
    "camera_scale": lambda a: {"factor": a.settings.camera_scale},
    "lens_distortion": _lens,
    "sensor_delay": _sensor_delay,
}  # fmt: skip
