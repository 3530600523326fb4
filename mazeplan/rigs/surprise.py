"""One thing about a simulated rig that is not as its model says, drawn by a seed: what `improve` is tried on.

| surprise | what | effect by its name |
|---|---|---|
| table | the table is 1 deg off, in any direction | tilt_offset |
| friction | the ball's rolling friction is twice what it was | dry_friction |
| hollow | the ball is a shell: its inertia is 2/3 m r^2 | rolling_inertia |
| magnet | one under the plate, in one of the outer three rings | surface_bump |
| camera | the picture is 80 ms older | sensor_delay |
| backlash | 1 deg of play in one of the servos | backlash |
| warp | the plate is bent to a saddle, 1 mm at its edge | surface_profile |

Seeds 0 to 6 draw each kind once, in an order of chance, 7 to 13 again. All else stays as the settings have it.
`answer` tells what was drawn; who plays fair asks it last.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mazeplan.maze.geometry import Maze
from mazeplan.rigs.settings import SimulatedSettings

EFFECTS = {
    "table": "tilt_offset", "friction": "dry_friction", "hollow": "rolling_inertia", "magnet": "surface_bump",
    "camera": "sensor_delay", "backlash": "backlash", "warp": "surface_profile",
}  # fmt: skip
TABLE_DEG, LATE_MS, PLAY_DEG, WARP_MM = 1.0, 80.0, 1.0, 1.0
PULL = 0.35  # m/s^2; what 2 deg of tilt are
MAGNETS = 3  # rings, from the outermost, in which a magnet may lie


@dataclass(frozen=True)
class Answer:
    """What was drawn: its kind, the effect by its name, settings that it changes."""

    kind: str
    effect: str
    changes: dict[str, Any] = field(default_factory=dict)


def answer(settings: SimulatedSettings, maze: Maze) -> Answer | None:
    """What the settings have in store; None without a surprise."""
    if settings.surprise is None:
        return None
    kinds, seed = list(EFFECTS), settings.surprise_seed
    block = np.random.default_rng([seed // len(kinds), len(kinds)])
    drawn = kinds[int(block.permutation(len(kinds))[seed % len(kinds)])]
    kind = drawn if settings.surprise == "drawn" else settings.surprise
    rng = np.random.default_rng([seed, 1])
    angle = float(rng.uniform(-math.pi, math.pi))
    ring = 1 + int(rng.integers(min(MAGNETS, len(maze.rings) - 1)))
    spot = 1e3 * maze.track_radius(ring)
    changes: dict[str, dict[str, Any]] = {
        "table": {
            "table_x_deg": settings.table_x_deg + TABLE_DEG * math.cos(angle),
            "table_y_deg": settings.table_y_deg + TABLE_DEG * math.sin(angle),
        },
        "friction": {"rolling_friction_m": 2.0 * settings.rolling_friction_m},
        "hollow": {"ball_inertia": 2.0 / 3.0},
        "magnet": {"magnet_m_s2": PULL, "magnet_mm": (spot * math.cos(angle), spot * math.sin(angle))},
        "camera": {"camera_late_ms": settings.camera_late_ms + LATE_MS},
        "backlash": {"backlash_deg": PLAY_DEG, "backlash_axis": "beta" if angle < 0.0 else "gamma"},
        "warp": {"warp_mm": WARP_MM, "warp_deg": math.degrees(angle)},
    }
    return Answer(kind, EFFECTS[kind], changes[kind])


def surprised(settings: SimulatedSettings, maze: Maze) -> SimulatedSettings:
    """The settings with what they have in store; as they are without a surprise."""
    drawn = answer(settings, maze)
    return settings if drawn is None else settings.model_copy(update={**drawn.changes, "surprise": None})
