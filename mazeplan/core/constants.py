"""Constants that several packages use."""

from __future__ import annotations

GRAVITY = 9.81  # m/s^2
SOLID = 2.0 / 5.0  # inertia of a solid sphere over m r^2
FREE_ROLLING = 1.0 / (1.0 + SOLID)  # 5/7: share of gravity that moves a solid sphere that rolls on the floor
WALL_ROLLING = 1.0 / (1.0 + 2.0 * SOLID)  # 5/9: the same share for a sphere that rolls on floor and wall at once
TIME_LIMIT = 20.0  # s of rig time for one goal; the limit under which the published figures were taken
