"""The keys of a map file: their types and ranges, as pydantic models, and pydantic's errors in our words.

Ranges are wide enough for any maze on a table; they catch a length in the wrong unit and an angle in radians times 100.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic.fields import FieldInfo

from mazeplan.core.field_checks import unit_hint, unit_of
from mazeplan.core.name_hints import one_of, unknown_keys_first
from mazeplan.maze.yamltree import Key, shown

NAME_PATTERN = r"^[A-Za-z0-9_.@+-][A-Za-z0-9_.@+ -]{0,39}$"
_NAME_WORDS = "1 to 40 letters, digits, spaces or _ . @ + -"
MAX_RINGS = 60
MAX_OPENINGS = 2000
MAX_RADIAL_WALLS = 2000
MAX_BALLS = 2

Name = Annotated[str, Field(pattern=NAME_PATTERN)]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class BallSection(_Section):
    """The ball."""

    radius_mm: float = Field(ge=1, le=50)
    mass_g: float = Field(gt=0, le=5000)


class RingSection(_Section):
    """One channel: clear floor between two radii."""

    inner_radius_mm: float = Field(ge=0, le=1000)
    outer_radius_mm: float = Field(ge=1, le=1000)


class OpeningSection(_Section):
    """One gap in the wall between two neighbouring rings."""

    rings: list[Annotated[int, Field(ge=1, le=MAX_RINGS)]] = Field(min_length=2, max_length=2)
    angle_deg: float = Field(ge=0, lt=360)
    width_mm: float = Field(ge=2, le=1000)
    name: Name | None = None
    closed: bool = False
    extra_cost_s: float = Field(default=0.0, ge=0, le=3600)


class RadialWallSection(_Section):
    """One wall across the channel of a ring."""

    ring: int = Field(ge=1, le=MAX_RINGS)
    angle_deg: float = Field(ge=0, lt=360)
    thickness_mm: float = Field(ge=1, le=100)
    name: Name | None = None


class MapFile(_Section):
    """A whole map file."""

    name: Name
    ball: BallSection
    tilt_limit_deg: float = Field(ge=0.5, le=30)
    wall_height_mm: float = Field(ge=1, le=200)
    rim_thickness_mm: float = Field(default=5.0, ge=1, le=100)
    balls: int = Field(default=1, ge=1, le=MAX_BALLS)
    rings: list[RingSection] = Field(min_length=2, max_length=MAX_RINGS)
    openings: list[OpeningSection] = Field(max_length=MAX_OPENINGS)
    radial_walls: list[RadialWallSection] = Field(default_factory=list, max_length=MAX_RADIAL_WALLS)


_SECTIONS: dict[str, type[BaseModel]] = {
    "ball": BallSection,
    "rings": RingSection,
    "openings": OpeningSection,
    "radial_walls": RadialWallSection,
}
OUTSIDE = ("greater_than", "greater_than_equal", "less_than", "less_than_equal")
_TYPES = {
    "float_type": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "text (in quotes if it looks like a number)",
    "string_pattern_mismatch": _NAME_WORDS,
    "bool_type": "true or false",
    "list_type": "a list",
    "model_type": "a mapping of keys to values",
    "model_attributes_type": "a mapping of keys to values",
}


def complaints(error: ValidationError) -> list[tuple[Key, str]]:
    """The errors that pydantic found, as (key path, "got X, expected Y") pairs."""
    return [(tuple(item["loc"]), _sentence(item)) for item in unknown_keys_first(error.errors(include_url=False))]


def _sentence(item: Any) -> str:
    kind, loc, context = item["type"], tuple(item["loc"]), item.get("ctx", {})
    if kind == "extra_forbidden":
        return f"unknown key, expected {one_of(_section(loc[:-1]).model_fields, loc[-1])}"
    if kind == "missing":
        return f"missing, expected {_expected(loc)}"
    if kind in ("too_long", "too_short"):
        bound = "at most" if kind == "too_long" else "at least"
        limit = context.get("max_length", context.get("min_length"))
        return f"got {len(item['input'])} entries, expected {bound} {limit}"
    expected = _TYPES.get(kind, "")
    bounds = _bounds(loc)
    if kind in ("float_type", "int_type", "int_from_float") and bounds:
        expected += f", {bounds}"
    elif not expected or kind == "finite_number":
        expected = bounds or item["msg"]
    return f"got {shown(item['input'])}, expected {expected}{_hint(item) if kind in OUTSIDE else ''}"


def _hint(item: Any) -> str:
    """A hint at the unit that was perhaps meant, for a number out of its range."""
    field = _field(tuple(item["loc"]))
    low, high = -math.inf, math.inf
    for bound in field.metadata if field else ():
        low = getattr(bound, "ge", getattr(bound, "gt", low))
        high = getattr(bound, "le", getattr(bound, "lt", high))
    return unit_hint(item["input"], unit_of(str(item["loc"][-1])), low, high)


def _section(loc: Key) -> type[BaseModel]:
    return _SECTIONS[str(loc[0])] if loc else MapFile


def _field(loc: Key) -> FieldInfo | None:
    if len(loc) == 1:
        return MapFile.model_fields.get(str(loc[0]))
    *_, last = loc
    key = loc[2] if len(loc) > 2 else last  # ("rings", 0, "inner_radius_mm") or ("ball", "mass_g")
    return _section(loc).model_fields.get(str(key))


def _bounds(loc: Key) -> str:
    """The range in words, such as `0 <= angle_deg < 360`; empty for a key without bounds."""
    if not loc:
        return ""
    key = loc[len(loc) - 1]
    if isinstance(key, int):
        return f"a ring from 1 to {MAX_RINGS}" if "rings" in loc[1:] else ""
    field = _field(loc)
    low = high = ""
    for bound in field.metadata if field else ():
        for attribute, before, after in (("ge", "<=", ""), ("gt", "<", ""), ("le", "", "<="), ("lt", "", "<")):
            if (value := getattr(bound, attribute, None)) is not None:
                low = f"{value:g} {before} " if before else low
                high = f" {after} {value:g}" if after else high
    return f"{low}{key}{high}" if low or high else ""


def _expected(loc: Key) -> str:
    if bounds := _bounds(loc):
        return bounds
    words: dict[Key, str] = {
        ("ball",): "radius_mm and mass_g",
        ("name",): _NAME_WORDS,
        ("rings",): "a list of rings",
        ("openings",): "a list of openings",
    }
    return words.get(loc, "the two rings that the opening joins")  # the only other required key
