"""One thing about a simulated rig that is not as its model says: what `improve` is tried on.

`KINDS` has them all, each with the effect that mazeplan names and the settings that it changes. A seed draws one of the
first seven (`surprise: drawn`): seeds 0 to 6 draw each of them once, in an order of chance, 7 to 13 again. Any kind can
be asked for by its name; then the seed draws direction and ring alone. All else stays as the settings have it.
`answer` tells what was drawn, with its true values; who plays fair asks it last.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mazeplan.maze.geometry import Maze
from mazeplan.rigs.settings import SimulatedSettings
from mazeplan.rigs.truths import Values, true_by_ring

DRAWN = ("table", "friction", "hollow", "magnet", "camera", "backlash", "warp")
MAGNETS = 3  # rings, from the outermost, in which what has a place may be


@dataclass(frozen=True)
class Draw:
    """What a seed says: a direction (rad) and a ring of the maze, for settings as they are without the surprise."""

    settings: SimulatedSettings
    maze: Maze
    angle: float
    ring: int

    @property
    def deg(self) -> float:
        """The direction."""
        return math.degrees(self.angle)

    def first(self, changed: Any, other: Any) -> tuple[Any, Any]:
        """A pair in which one of the two, beta or gamma, is changed."""
        return (changed, other) if self.angle < 0.0 else (other, changed)

    def arrow(self, length: float) -> tuple[float, float]:
        """x, y of an arrow in that direction."""
        return length * math.cos(self.angle), length * math.sin(self.angle)


@dataclass(frozen=True)
class Kind:
    """A surprise: the effect by its name, what it is, and the settings that it changes."""

    effect: str
    text: str
    changes: Callable[[Draw], dict[str, Any]]


def _table(d: Draw) -> dict[str, Any]:
    x, y = d.arrow(1.0)
    return {"table_x_deg": d.settings.table_x_deg + x, "table_y_deg": d.settings.table_y_deg + y}


def _magnet(d: Draw) -> dict[str, Any]:
    return {"magnet_m_s2": 0.35, "magnet_mm": d.arrow(1e3 * d.maze.track_radius(d.ring))}  # as strong as 2 deg of tilt


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
        "rolling_inertia", "the ball is a shell: its inertia is 2/3 m r^2", lambda d: {"ball_inertia": 2.0 / 3.0}
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
    # asked for by name
    "viscous": Kind("viscous_friction", "the ball loses 0.3 of its speed a second", lambda d: {"drag_per_s": 0.3}),
    "air": Kind("quadratic_drag", "the ball loses 0.02 of its speed every centimetre", lambda d: {"drag_per_m": 2.0}),
    "push": Kind(
        "constant_torque", "a steady push of 0.08 m/s^2 along the rings",
        lambda d: {"ring_push_m_s2": math.copysign(0.08, d.angle)},
    ),
    "drift": Kind(
        "friction_drift", "drag that grows by 0.005 per s every second", lambda d: {"drag_growth_per_s2": 0.005}
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
        "wall_friction", "walls slow a ball that turns against them", lambda d: {"wall_rolling_friction_m": 4e-4}
    ),
    "gain": Kind("servo_gain", "one servo goes 0.85 of the way", lambda d: {"servo_gain": d.first(0.85, 1.0)}),
    "slow_servo": Kind(
        "servo_lag", "gamma's servo is slower, and swings",
        lambda d: {"servo_gamma_frequency_rad_s": 15.0, "servo_gamma_damping": 0.6},
    ),
    "coupling": Kind(
        "axis_coupling", "one axis follows 0.12 of the other's command",
        lambda d: {"servo_coupling": d.first(0.12, 0.0)},
    ),
    "late_command": Kind(
        "command_delay", "servos hear commands 60 ms later",
        lambda d: {"command_delay_ms": d.settings.command_delay_ms + 60.0},
    ),
    "deadband": Kind("deadband", "servos pass over changes below 0.5 deg", lambda d: {"deadband_deg": 0.5}),
    "tilt_scale": Kind(
        "tilt_gain", "the tilt sensor says 1.15 of one axis", lambda d: {"tilt_scale": d.first(1.15, 1.0)}
    ),
    "turned_camera": Kind(
        "axis_misalignment", "the camera is turned by 3 deg",
        lambda d: {"camera_rotation_deg": math.copysign(3.0, d.angle)},
    ),
    "shifted_camera": Kind("camera_offset", "the camera is 2.5 mm beside the middle, in any direction", _offset),
    "scaled_camera": Kind("camera_scale", "the picture is 1.025 as large", lambda d: {"camera_scale": 1.025}),
    "lens": Kind("lens_distortion", "the lens bends the picture: 5 per m^2", lambda d: {"lens_per_m2": 5.0}),
}  # fmt: skip


@dataclass(frozen=True)
class Answer:
    """What was drawn: its kind, the effect by its name, settings that it changes; of each ring that has the effect its
    true parameters in mazeplan's units, and those without the surprise."""

    kind: str
    effect: str
    changes: dict[str, Any] = field(default_factory=dict)
    by_ring: dict[int, Values] = field(default_factory=dict)
    known_before: dict[int, Values] = field(default_factory=dict)

    @property
    def parameters(self) -> Values:
        """The true ones in the outermost ring that has the effect."""
        return next(iter(self.by_ring.values()), {})

    def told(self, ring: int | None = None) -> dict[str, Any]:
        """{"effect", "parameters"}, the true ones in a ring, or in the outermost ring that has the effect."""
        return {"effect": self.effect, "parameters": self.parameters if ring is None else self.by_ring.get(ring, {})}


def answer(settings: SimulatedSettings, maze: Maze) -> Answer | None:
    """What the settings have in store; None without a surprise."""
    if settings.surprise is None:
        return None
    seed = settings.surprise_seed
    block = np.random.default_rng([seed // len(DRAWN), len(DRAWN)])
    drawn = DRAWN[int(block.permutation(len(DRAWN))[seed % len(DRAWN)])]
    name = drawn if settings.surprise == "drawn" else settings.surprise
    rng = np.random.default_rng([seed, 1])
    angle = float(rng.uniform(-math.pi, math.pi))
    ring = 1 + int(rng.integers(min(MAGNETS, len(maze.rings) - 1)))
    kind = KINDS[name]
    changes = kind.changes(Draw(settings, maze, angle, ring))
    after = true_by_ring(kind.effect, settings.model_copy(update=changes), maze)
    before = true_by_ring(kind.effect, settings, maze)
    return Answer(name, kind.effect, changes, after, {n: values for n, values in before.items() if n in after})


def surprised(settings: SimulatedSettings, maze: Maze) -> SimulatedSettings:
    """The settings with what they have in store; as they are without a surprise."""
    drawn = answer(settings, maze)
    return settings if drawn is None else settings.model_copy(update={**drawn.changes, "surprise": None})
