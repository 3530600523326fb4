"""A surprise is one effect of a simulated rig that its model lacks. `improve` is tested on surprises.

`KINDS` lists the kinds, each with the name of the effect and the settings that it changes. With `surprise: drawn` the
seed draws one of the first seven kinds. Seeds 0 to 6 draw each of the seven once, in random order; so do seeds 7 to 13.
`surprise: KIND` names a kind; then the seed draws only direction and ring. `drawn_surprise` gives the drawn effect with
its true values.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mazeplan.maze.geometry import Maze
from mazeplan.rigs.sim.settings import SimulatedSettings
from mazeplan.rigs.sim.truths import Values, true_by_ring

DRAWN = ("table", "friction", "hollow", "magnet", "camera", "backlash", "warp")
PLACES = 3  # an effect with a place is in one of this many outermost rings


@dataclass(frozen=True)
class Draw:
    """The draw of a seed.

    settings: settings of the rig without the surprise.
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
class SurpriseKind:
    """A surprise: name of the effect, text, and the settings that it changes."""

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


KINDS: dict[str, SurpriseKind] = {
    "table": SurpriseKind("tilt_offset", "the table is 1 deg off, in any direction", _table),
    "friction": SurpriseKind(
        "dry_friction", "the ball's rolling friction is twice what it was",
        lambda d: {"rolling_friction_m": 2.0 * d.settings.rolling_friction_m},
    ),
    "hollow": SurpriseKind(
        "rolling_inertia", "the ball is a shell: its inertia is 2/3 m r^2", {"ball_inertia": 2.0 / 3.0}
    ),
    "magnet": SurpriseKind("surface_bump", "one under the plate, in one of the outer three rings", _magnet),
    "camera": SurpriseKind(
        "sensor_delay", "the picture is 80 ms older", lambda d: {"camera_late_ms": d.settings.camera_late_ms + 80.0}
    ),
    "backlash": SurpriseKind(
        "backlash", "1 deg of play in one of the servos",
        lambda d: {"backlash_deg": 1.0, "backlash_axis": d.first("beta", "gamma")[0]},
    ),
    "warp": SurpriseKind(
        "surface_profile", "the plate is bent to a saddle, 1 mm at its edge",
        lambda d: {"warp_mm": 1.0, "warp_deg": d.deg},
    ),
    # kinds that `surprise: drawn` never draws
    "viscous": SurpriseKind("viscous_friction", "the ball loses 0.3 of its speed a second", {"drag_per_s": 0.3}),
    "air": SurpriseKind("quadratic_drag", "the ball loses 0.02 of its speed every centimetre", {"drag_per_m": 2.0}),
    "push": SurpriseKind(
        "constant_torque", "a steady push of 0.08 m/s^2 along the rings",
        lambda d: {"ring_push_m_s2": math.copysign(0.08, d.angle)},
    ),
    "drift": SurpriseKind(
        "friction_drift", "drag that grows by 0.005 per s every second", {"drag_growth_per_s2": 0.005}
    ),
    "nap": SurpriseKind(
        "dry_friction", "dry friction of 0.12 m/s^2 one way round", lambda d: {"nap_m_s2": math.copysign(0.12, d.angle)}
    ),
    "sticky": SurpriseKind("local_friction", "60 deg of a ring with dry friction of 0.15 m/s^2", _sticky),
    "kerb": SurpriseKind(
        "gate_loss", "a kerb in a ring takes 0.35 of the speed",
        lambda d: {"kerb_loss": 0.35, "kerb_ring": d.ring, "kerb_deg": d.deg},
    ),
    "draught": SurpriseKind(
        "constant_force", "a draught of 0.1 m/s^2, in any direction", lambda d: {"draught_m_s2": d.arrow(0.1)}
    ),
    "rocking": SurpriseKind(
        "table_rocking", "the table rocks by 0.5 and 0.3 deg, 1.3 times a second",
        lambda d: {"rocking_deg": d.first(0.5, 0.3), "rocking_hz": 1.3, "rocking_phase_deg": d.deg},
    ),
    "unbalanced": SurpriseKind(
        "ball_imbalance", "the ball is heavier on one side: 0.15 m/s^2",
        lambda d: {"imbalance_m_s2": 0.15, "imbalance_phase_deg": d.deg},
    ),
    "ripple": SurpriseKind(
        "surface_ripple", "the floor has six waves: 0.2 m/s^2",
        lambda d: {"ripple_m_s2": 0.2, "ripple_waves": 6, "ripple_deg": d.deg},
    ),
    "wall": SurpriseKind(
        "wall_friction", "walls slow a ball that turns against them", {"wall_rolling_friction_m": 4e-4}
    ),
    "gain": SurpriseKind("servo_gain", "one servo goes 0.85 of the way", lambda d: {"servo_gain": d.first(0.85, 1.0)}),
    "slow_servo": SurpriseKind(
        "servo_lag", "gamma's servo is slower, and swings",
        {"servo_gamma_frequency_rad_s": 15.0, "servo_gamma_damping": 0.6},
    ),
    "coupling": SurpriseKind(
        "axis_coupling", "one axis follows 0.12 of the other's command",
        lambda d: {"servo_coupling": d.first(0.12, 0.0)},
    ),
    "late_command": SurpriseKind(
        "command_delay", "servos hear commands 60 ms later",
        lambda d: {"command_delay_ms": d.settings.command_delay_ms + 60.0},
    ),
    "deadband": SurpriseKind("deadband", "servos pass over changes below 0.5 deg", {"deadband_deg": 0.5}),
    "tilt_scale": SurpriseKind(
        "tilt_gain", "the tilt sensor says 1.15 of one axis", lambda d: {"tilt_scale": d.first(1.15, 1.0)}
    ),
    "turned_camera": SurpriseKind(
        "axis_misalignment", "the camera is turned by 3 deg",
        lambda d: {"camera_rotation_deg": math.copysign(3.0, d.angle)},
    ),
    "shifted_camera": SurpriseKind("camera_offset", "the camera is 2.5 mm off the middle, in any direction", _offset),
    "scaled_camera": SurpriseKind("camera_scale", "the picture is 1.025 as large", {"camera_scale": 1.025}),
    "lens": SurpriseKind("lens_distortion", "the lens bends the picture: 5 per m^2", {"lens_per_m2": 5.0}),
}  # fmt: skip


@dataclass(frozen=True)
class SurpriseTruth:
    """A drawn surprise.

    kind: key of `KINDS`.
    effect: name of the effect.
    changes: settings that it changes, with the new values.
    by_ring: {ring: true parameters of the effect}, for the rings that have the effect.
    known_before: {ring: true parameters without the surprise}, for the same rings."""

    kind: str
    effect: str
    changes: dict[str, Any] = field(default_factory=dict)
    by_ring: dict[int, Values] = field(default_factory=dict)
    known_before: dict[int, Values] = field(default_factory=dict)

    @property
    def parameters(self) -> Values:
        """The true parameters in the outermost ring that has the effect."""
        return next(iter(self.by_ring.values()), {})

    def told(self, ring: int | None = None) -> dict[str, Any]:
        """{"effect", "parameters"} in a ring, by default in the outermost ring that has the effect."""
        return {"effect": self.effect, "parameters": self.parameters if ring is None else self.by_ring.get(ring, {})}


def drawn_surprise(settings: SimulatedSettings, maze: Maze) -> SurpriseTruth | None:
    """The surprise of the settings, or None."""
    if settings.surprise is None:
        return None
    seed = settings.surprise_seed
    block = np.random.default_rng([seed // len(DRAWN), len(DRAWN)])
    drawn = DRAWN[int(block.permutation(len(DRAWN))[seed % len(DRAWN)])]
    name = drawn if settings.surprise == "drawn" else settings.surprise
    rng = np.random.default_rng([seed, 1])
    angle = float(rng.uniform(-math.pi, math.pi))
    ring = 1 + int(rng.integers(min(PLACES, len(maze.rings) - 1)))
    kind = KINDS[name]
    changes = kind.changes(Draw(settings, maze, angle, ring)) if callable(kind.changes) else kind.changes
    after = true_by_ring(kind.effect, settings.model_copy(update=changes), maze)
    before = true_by_ring(kind.effect, settings, maze)
    return SurpriseTruth(name, kind.effect, changes, after, {n: values for n, values in before.items() if n in after})


def surprised(settings: SimulatedSettings, maze: Maze) -> SimulatedSettings:
    """The settings with the changes of their surprise applied."""
    drawn = drawn_surprise(settings, maze)
    return settings if drawn is None else settings.model_copy(update={**drawn.changes, "surprise": None})
