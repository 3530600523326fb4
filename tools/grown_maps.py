"""Maps of mazes with any number of rings and openings, for tools/bench_growth.py."""

from __future__ import annotations

import math

import numpy as np
import yaml

CHANNEL_MM, WALL_MM, WIDTH_MM, APART_MM = 15.4, 4.0, 14.0, 6.0


def map_text(rings: int, openings: int) -> str:
    """A maze with so many rings, and openings that are shared out among the walls by their length."""
    inner = [APART_MM + (CHANNEL_MM + WALL_MM) * k for k in range(rings)][::-1]
    channels = [{"inner_radius_mm": round(r, 3), "outer_radius_mm": round(r + CHANNEL_MM, 3)} for r in inner]
    channels[-1]["inner_radius_mm"] = 0
    walls = np.array([ring["inner_radius_mm"] for ring in channels[:-1]])
    room = np.floor(math.tau * walls / (WIDTH_MM + APART_MM)).astype(int)
    share = np.maximum(1, np.minimum(room, np.floor(openings * room / room.sum()).astype(int)))
    places = [
        {"rings": [k + 1, k + 2], "angle_deg": round(360.0 * j / int(n), 6), "width_mm": WIDTH_MM}
        for k, n in enumerate(share)
        for j in range(n)
    ]
    return yaml.safe_dump({
        "name": "grown", "ball": {"radius_mm": 6.35, "mass_g": 8.4}, "tilt_limit_deg": 5, "wall_height_mm": 20,
        "rim_thickness_mm": 5, "rings": channels, "openings": places,
    })  # fmt: skip
