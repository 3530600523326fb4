"""Simulated rigs with one effect that the planner's model lacks, and the true values of that effect.

`KINDS` lists the kinds of change, each with the name of the effect and the settings that it changes. A seed draws
direction and ring. The true values are parameters of mazeplan's effects: rad, m, s, and rad/s^2 along a ring. They
follow from the settings, without a fit. Those for gravity and for the floor's friction (table, friction, hollow,
magnet, warp, nap, sticky, unbalanced) hold for a ball that rolls on the floor alone. For a ball that also rolls along a
wall, they are (1 + k) / (1 + 2 k) times as large; the ball's inertia is k m r^2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from mazeplan.core.constants import GRAVITY
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.files import validated
from mazeplan.rigs.registry import rig_file
from mazeplan.rigs.sim.settings import SimulatedSettings

PLACES = 3  # an effect with a place is in one of this many outermost rings
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


@dataclass(frozen=True)
class Draw:
    """The draw of a seed.

    settings: settings of the rig without the change.
    maze: maze of the rig.
    angle: drawn direction, rad.
    ring: drawn ring."""

    settings: SimulatedSettings
    maze: Maze
    angle: float
    ring: int

    @property
    def deg(self) -> float:
        """The direction, deg."""
        return math.degrees(self.angle)

    def first(self, changed: Any, other: Any) -> tuple[Any, Any]:
        """A pair (beta, gamma) with the value `changed` for one axis and `other` for the other axis."""
        return (changed, other) if self.angle < 0.0 else (other, changed)

    def arrow(self, length: float) -> tuple[float, float]:
        """x, y of a vector of this length in the drawn direction."""
        return length * math.cos(self.angle), length * math.sin(self.angle)


@dataclass(frozen=True)
class Kind:
    """A change: name of the effect, text, and the settings that it changes."""

    effect: str
    text: str
    changes: Callable[[Draw], dict[str, Any]] | dict[str, Any]


def _table(d: Draw) -> dict[str, Any]:
    x, y = d.arrow(1.0)
    return {"table_x_deg": d.settings.table_x_deg + x, "table_y_deg": d.settings.table_y_deg + y}


def _magnet(d: Draw) -> dict[str, Any]:
    # the pull is as strong as a tilt of 2 deg
    return {"magnet_m_s2": 0.35, "magnet_mm": d.arrow(1e3 * d.maze.track_radius(d.ring))}


def _sticky(d: Draw) -> dict[str, Any]:
    return {"sticky_m_s2": 0.15, "sticky_ring": d.ring, "sticky_deg": (d.deg - 30.0, d.deg + 30.0)}


def _offset(d: Draw) -> dict[str, Any]:
    x, y = d.arrow(2.5)
    return {"camera_offset_mm": (d.settings.camera_offset_mm[0] + x, d.settings.camera_offset_mm[1] + y)}


KINDS: dict[str, Kind] = {
    "table": Kind("tilt_offset", "the table is 1 deg off, in any direction", _table),
    "friction": Kind(
        "dry_friction", "the ball's rolling friction is twice what it was",
        lambda d: {"rolling_friction_m": 2.0 * d.settings.rolling_friction_m},
    ),
    "hollow": Kind(
        "rolling_inertia", "the ball is a shell: its inertia is 2/3 m r^2", {"ball_inertia": 2.0 / 3.0}
    ),
    "magnet": Kind("surface_bump", "one under the plate, in one of the outer three rings", _magnet),
    "camera": Kind(
        "sensor_delay", "the picture is 80 ms older", lambda d: {"camera_late_ms": d.settings.camera_late_ms + 80.0}
    ),
    "backlash": Kind(
        "backlash", "1 deg of play in one of the servos",
        lambda d: {"backlash_deg": 1.0, "backlash_axis": d.first("beta", "gamma")[0]},
    ),
    "warp": Kind(
        "surface_profile", "the plate is bent to a saddle, 1 mm at its edge",
        lambda d: {"warp_mm": 1.0, "warp_deg": d.deg},
    ),
    "viscous": Kind("viscous_friction", "the ball loses 0.3 of its speed a second", {"drag_per_s": 0.3}),
    "air": Kind("quadratic_drag", "the ball loses 0.02 of its speed every centimetre", {"drag_per_m": 2.0}),
    "push": Kind(
        "constant_torque", "a steady push of 0.08 m/s^2 along the rings",
        lambda d: {"ring_push_m_s2": math.copysign(0.08, d.angle)},
    ),
    "drift": Kind(
        "friction_drift", "drag that grows by 0.005 per s every second", {"drag_growth_per_s2": 0.005}
    ),
    "nap": Kind(
        "dry_friction", "dry friction of 0.12 m/s^2 one way round", lambda d: {"nap_m_s2": math.copysign(0.12, d.angle)}
    ),
    "sticky": Kind("local_friction", "60 deg of a ring with dry friction of 0.15 m/s^2", _sticky),
    "kerb": Kind(
        "gate_loss", "a kerb in a ring takes 0.35 of the speed",
        lambda d: {"kerb_loss": 0.35, "kerb_ring": d.ring, "kerb_deg": d.deg},
    ),
    "draught": Kind(
        "constant_force", "a draught of 0.1 m/s^2, in any direction", lambda d: {"draught_m_s2": d.arrow(0.1)}
    ),
    "rocking": Kind(
        "table_rocking", "the table rocks by 0.5 and 0.3 deg, 1.3 times a second",
        lambda d: {"rocking_deg": d.first(0.5, 0.3), "rocking_hz": 1.3, "rocking_phase_deg": d.deg},
    ),
    "unbalanced": Kind(
        "ball_imbalance", "the ball is heavier on one side: 0.15 m/s^2",
        lambda d: {"imbalance_m_s2": 0.15, "imbalance_phase_deg": d.deg},
    ),
    "ripple": Kind(
        "surface_ripple", "the floor has six waves: 0.2 m/s^2",
        lambda d: {"ripple_m_s2": 0.2, "ripple_waves": 6, "ripple_deg": d.deg},
    ),
    "wall": Kind(
        "wall_friction", "walls slow a ball that turns against them", {"wall_rolling_friction_m": 4e-4}
    ),
    "gain": Kind("servo_gain", "one servo goes 0.85 of the way", lambda d: {"servo_gain": d.first(0.85, 1.0)}),
    "slow_servo": Kind(
        "servo_lag", "gamma's servo is slower, and swings",
        {"servo_gamma_frequency_rad_s": 15.0, "servo_gamma_damping": 0.6},
    ),
    "coupling": Kind(
        "axis_coupling", "one axis follows 0.12 of the other's command",
        lambda d: {"servo_coupling": d.first(0.12, 0.0)},
    ),
    "late_command": Kind(
        "command_delay", "servos hear commands 60 ms later",
        lambda d: {"command_delay_ms": d.settings.command_delay_ms + 60.0},
    ),
    "deadband": Kind("deadband", "servos pass over changes below 0.5 deg", {"deadband_deg": 0.5}),
    "tilt_scale": Kind(
        "tilt_gain", "the tilt sensor says 1.15 of one axis", lambda d: {"tilt_scale": d.first(1.15, 1.0)}
    ),
    "turned_camera": Kind(
        "axis_misalignment", "the camera is turned by 3 deg",
        lambda d: {"camera_rotation_deg": math.copysign(3.0, d.angle)},
    ),
    "shifted_camera": Kind("camera_offset", "the camera is 2.5 mm off the middle, in any direction", _offset),
    "scaled_camera": Kind("camera_scale", "the picture is 1.025 as large", {"camera_scale": 1.025}),
    "lens": Kind("lens_distortion", "the lens bends the picture: 5 per m^2", {"lens_per_m2": 5.0}),
}  # fmt: skip


@dataclass(frozen=True)
class HiddenEffect:
    """A change of a rig that its model does not know.

    kind: key of `KINDS`.
    effect: name of the effect.
    changes: settings that it changes, with the new values.
    by_ring: {ring: true parameters of the effect}, for the rings that have the effect.
    known_before: {ring: true parameters without the change}, for the same rings."""

    kind: str
    effect: str
    changes: dict[str, Any]
    by_ring: dict[int, Values]
    known_before: dict[int, Values]

    @property
    def parameters(self) -> Values:
        """The true parameters in the outermost ring that has the effect."""
        return next(iter(self.by_ring.values()), {})


def hidden_effect(kind: str, settings: SimulatedSettings, maze: Maze, seed: int = 0) -> HiddenEffect:
    """The change of this kind, with its direction and ring drawn by the seed."""
    rng = np.random.default_rng([seed, 1])
    angle = float(rng.uniform(-math.pi, math.pi))
    ring = 1 + int(rng.integers(min(PLACES, len(maze.rings) - 1)))
    chosen = KINDS[kind]
    changes = chosen.changes(Draw(settings, maze, angle, ring)) if callable(chosen.changes) else chosen.changes
    after = true_by_ring(chosen.effect, settings.model_copy(update=changes), maze)
    before = true_by_ring(chosen.effect, settings, maze)
    return HiddenEffect(kind, chosen.effect, changes, after, {n: values for n, values in before.items() if n in after})


def write_hidden_rig(file: Path, kind: str, maze: Maze, seed: int = 0) -> HiddenEffect:
    """Write the file of a rig: the toy with a change of this kind. Returns the change."""
    toy = rig_file("toy")
    assert toy is not None
    data = yaml.safe_load(toy.read_text(encoding="utf-8"))
    hidden = hidden_effect(kind, validated(SimulatedSettings, data), maze, seed)
    changes = {key: list(value) if isinstance(value, tuple) else value for key, value in hidden.changes.items()}
    file.write_text(yaml.safe_dump(data | changes), encoding="utf-8")
    return hidden
