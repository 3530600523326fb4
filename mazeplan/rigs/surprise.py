"""One thing about a simulated rig that is not as its model says: what `improve` and the benchmark are tried on.

| surprise | what | effect by its name |
|---|---|---|
| table | the table is 1 deg off, in any direction | tilt_offset |
| friction | the ball's rolling friction is twice what it was | dry_friction |
| hollow | the ball is a shell: its inertia is 2/3 m r^2 | rolling_inertia |
| magnet | one under the plate, in one of the outer three rings | surface_bump |
| camera | the picture is 80 ms older | sensor_delay |
| backlash | 1 deg of play in one of the servos | backlash |
| warp | the plate is bent to a saddle, 1 mm at its edge | surface_profile |

`surprise: drawn` draws one of these: seeds 0 to 6 draw each kind once, in an order of chance, 7 to 13 again. The others
in KINDS come when they are asked for by name. All else stays as the settings have it. `answer` tells what is different;
who plays fair asks it last.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from mazeplan.maze.geometry import Maze
from mazeplan.rigs.settings import SimulatedSettings

DRAWN = ("table", "friction", "hollow", "magnet", "camera", "backlash", "warp")
MAGNETS = 3  # rings, from the outermost, in which a magnet may lie
ROLLS = 5.0 / 7.0  # what a force along the floor is worth to a solid ball that rolls

Changes = dict[str, Any]
Values = dict[str, float]


@dataclass(frozen=True)
class Answer:
    """What is different: kind, the effect by its name, settings that it changes; values: the effect's parameters, where
    they are the same in all rings; along: those in m/s^2, 1/s or 1/m along a ring, as a ball feels them that rolls on
    the floor alone (rad/s^2 are so many over the radius)."""

    kind: str
    effect: str
    changes: Changes = field(default_factory=dict)
    values: Values = field(default_factory=dict)
    along: Values = field(default_factory=dict)


class Drawn(NamedTuple):
    """What chance gave: a direction, rad; a spot on the plate, mm; what was there before, and the maze."""

    angle: float
    spot: tuple[float, float]
    had: SimulatedSettings
    maze: Maze


class Kind(NamedTuple):
    """effect: its name; changes: settings; values, along: see `Answer`."""

    effect: str
    changes: Callable[[Drawn], Changes]
    values: Callable[[Drawn], Values] = lambda _: {}
    along: Values = {}  # noqa: RUF012 (nobody writes into it)


def _always(**changes: Any) -> Callable[[Drawn], Changes]:
    return lambda _: changes


def _table(d: Drawn) -> Changes:
    return {"table_x_deg": d.had.table_x_deg + math.cos(d.angle), "table_y_deg": d.had.table_y_deg + math.sin(d.angle)}


def _axis(d: Drawn) -> str:
    return "beta" if d.angle < 0.0 else "gamma"


KINDS: dict[str, Kind] = {
    "table": Kind("tilt_offset", _table, lambda d: {"beta": math.radians(_table(d)["table_y_deg"]),
                                                    "gamma": math.radians(_table(d)["table_x_deg"])}),
    "friction": Kind("dry_friction", lambda d: {"rolling_friction_m": 2.0 * d.had.rolling_friction_m}),
    "hollow": Kind("rolling_inertia", _always(ball_inertia=2.0 / 3.0)),
    "magnet": Kind("surface_bump", lambda d: {"magnet_m_s2": 0.35, "magnet_mm": d.spot}),  # what 2 deg of tilt are
    "camera": Kind("sensor_delay", lambda d: {"camera_late_ms": d.had.camera_late_ms + 80.0}),
    "backlash": Kind("backlash", lambda d: {"backlash_deg": 1.0, "backlash_axis": _axis(d)},
                     lambda d: {_axis(d): math.radians(1.0)}),
    "warp": Kind("surface_profile", lambda d: {"warp_mm": 1.0, "warp_deg": math.degrees(d.angle)}),
    "drag": Kind("viscous_friction", _always(drag_per_s=0.7), along={"coefficient": 0.7 * ROLLS}),
    "thick_air": Kind("quadratic_drag", _always(drag_per_m=5.0), along={"coefficient": 5.0 * ROLLS}),
    "wet_paint": Kind("friction_drift", _always(drag_growth_per_s2=0.004), along={"rate": 0.004 * ROLLS}),
    "grip": Kind("wall_friction", lambda d: {"wall_grip": 3.0 * d.had.wall_grip}),
    "torque": Kind("constant_torque", _always(torque_m_s2=0.1), along={"acceleration": 0.1 * ROLLS}),
    "one_way": Kind("dry_friction", _always(one_way_m_s2=0.15), along={"asymmetry": 0.075 * ROLLS}),
    "dirt": Kind("local_friction", _always(dirt_m_s2=0.25, dirt_ring=2, dirt_deg=(60.0, 120.0)),
                 lambda _: {"start": math.radians(60.0), "end": math.radians(120.0)}, {"coefficient": 0.25 * ROLLS}),
    "kerb": Kind("gate_loss", _always(kerb_loss=0.5, kerb_ring=2, kerb_deg=70.0),
                 lambda _: {"angle": math.radians(70.0), "loss": 0.5}),
    "ripple": Kind("surface_ripple", _always(ripple_m_s2=0.15, ripple_waves=5), along={"cos5": 0.15 * ROLLS}),
    "draught": Kind("constant_force", _always(draught_m_s2=(0.12, -0.06)), lambda _: {"x": 0.12, "y": -0.06}),
    "rocking": Kind("table_rocking", _always(rocking_x_deg=0.3, rocking_y_deg=0.4, rocking_hz=0.7),
                    lambda _: {"frequency": 0.7, "beta": math.radians(0.4), "gamma": math.radians(0.3)}),
    "unbalanced": Kind("ball_imbalance", _always(imbalance_mm=0.05)),
    "gain": Kind("servo_gain", _always(servo_gain_beta=0.85), lambda _: {"beta": 0.85, "gamma": 1.0}),
    "slow": Kind("servo_lag", _always(servo_frequency_rad_s=12.0),
                 lambda _: {"beta_natural_frequency": 12.0, "gamma_natural_frequency": 12.0}),
    "coupling": Kind("axis_coupling", _always(coupling_beta_from_gamma=0.1), lambda _: {"beta_from_gamma": 0.1}),
    "command": Kind("command_delay", lambda d: {"command_delay_ms": d.had.command_delay_ms + 40.0},
                    lambda d: {"delay": 1e-3 * d.had.command_delay_ms + 0.04}),
    "sticky": Kind("deadband", _always(deadband_deg=0.6),
                   lambda _: {"beta": math.radians(0.6), "gamma": math.radians(0.6)}),
    "sensor": Kind("tilt_gain", _always(tilt_scale_beta=1.1), lambda _: {"beta": 1.1, "gamma": 1.0}),
    "turned": Kind("axis_misalignment", _always(camera_rotation_deg=3.0), lambda _: {"angle": math.radians(3.0)}),
    "moved": Kind("camera_offset", _always(camera_offset_mm=(3.0, -2.0)), lambda _: {"x": 3e-3, "y": -2e-3}),
    "scale": Kind("camera_scale", _always(camera_scale=1.03), lambda _: {"factor": 1.03}),
    "lens": Kind("lens_distortion", _always(lens_per_m2=5.0), lambda _: {"k": 5.0, "x": 0.0, "y": 0.0}),
}  # fmt: skip
EFFECTS = {name: KINDS[name].effect for name in DRAWN}


def answer(settings: SimulatedSettings, maze: Maze) -> Answer | None:
    """What the settings have in store; None without a surprise."""
    if settings.surprise is None:
        return None
    seed = settings.surprise_seed
    block = np.random.default_rng([seed // len(DRAWN), len(DRAWN)])
    drawn = DRAWN[int(block.permutation(len(DRAWN))[seed % len(DRAWN)])]
    kind = drawn if settings.surprise == "drawn" else settings.surprise
    rng = np.random.default_rng([seed, 1])
    angle = float(rng.uniform(-math.pi, math.pi))
    ring = 1 + int(rng.integers(min(MAGNETS, len(maze.rings) - 1)))
    spot = 1e3 * maze.track_radius(ring)
    chance = Drawn(angle, (spot * math.cos(angle), spot * math.sin(angle)), settings, maze)
    effect, changes, values, along = KINDS[kind]
    return Answer(kind, effect, changes(chance), values(chance), along)


def surprised(settings: SimulatedSettings, maze: Maze) -> SimulatedSettings:
    """The settings with what they have in store; as they are without a surprise."""
    drawn = answer(settings, maze)
    return settings if drawn is None else settings.model_copy(update={**drawn.changes, "surprise": None})
