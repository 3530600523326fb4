"""The keys of a map file: their types and ranges, as pydantic models.

Ranges are wide enough for any maze on a table; they catch a length in the wrong unit and an angle in radians times 100.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from mazeplan.maze.sections import Section

NAME_PATTERN = r"^[A-Za-z0-9_.@+-][A-Za-z0-9_.@+ -]{0,39}$"
MAX_RINGS = 60
MAX_OPENINGS = 2000
MAX_RADIAL_WALLS = 2000
MAX_BALLS = 2

Name = Annotated[str, Field(pattern=NAME_PATTERN)]
RingNumber = Annotated[int, Field(ge=1, le=MAX_RINGS)]


def default_name(outer: int, inner: int, angle_deg: float) -> str:
    """Default name of an opening."""
    return f"{outer}-{inner}@{angle_deg:.10g}"


def default_wall_name(ring: int, angle_deg: float) -> str:
    """Default name of a radial wall."""
    return f"wall{ring}@{angle_deg:.10g}"


class BallSection(Section):
    """The ball."""

    radius_mm: float = Field(ge=1, le=50)
    mass_g: float = Field(gt=0, le=5000)


class RingSection(Section):
    """One channel: clear floor between two radii."""

    inner_radius_mm: float = Field(ge=0, le=1000)
    outer_radius_mm: float = Field(ge=1, le=1000)


class OpeningSection(Section):
    """One gap in the wall between two neighbouring rings."""

    rings: tuple[RingNumber, RingNumber]
    angle_deg: float = Field(ge=0, lt=360)
    width_mm: float = Field(ge=2, le=1000)
    name: Name | None = None
    closed: bool = False
    extra_cost_s: float = Field(default=0.0, ge=0, le=3600)

    @property
    def label(self) -> str:
        """Name in the file, or the default name: rings and angle, such as "1-2@45"."""
        return self.name or default_name(min(self.rings), max(self.rings), self.angle_deg)


class RadialWallSection(Section):
    """One wall across the channel of a ring."""

    ring: RingNumber
    angle_deg: float = Field(ge=0, lt=360)
    thickness_mm: float = Field(ge=1, le=100)
    name: Name | None = None

    @property
    def label(self) -> str:
        """Name in the file, or the default name: ring and angle, such as "wall2@100"."""
        return self.name or default_wall_name(self.ring, self.angle_deg)


class MapFile(Section):
    """A whole map file."""

    name: Name
    ball: BallSection
    tilt_limit_deg: float = Field(ge=0.5, le=30)
    wall_height_mm: float = Field(ge=1, le=200)
    rim_thickness_mm: float = Field(default=5.0, ge=1, le=100)
    balls: int = Field(default=1, ge=1, le=MAX_BALLS)
    rings: tuple[RingSection, ...] = Field(min_length=2, max_length=MAX_RINGS)
    openings: tuple[OpeningSection, ...] = Field(max_length=MAX_OPENINGS)
    radial_walls: tuple[RadialWallSection, ...] = Field(default=(), max_length=MAX_RADIAL_WALLS)
