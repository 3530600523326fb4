"""Checks that frozen options make of their own numbers, and the unit that a number out of its range may have had."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping
from dataclasses import fields
from typing import Any

from mazeplan.core.errors import SettingsError

# unit: what makes a number in it of one in a unit that is taken for it
CONVERSIONS = {
    "mm": (1e3, 10.0), "m": (1e-3, 1e-2), "m/s": (1e-3,), "g": (1e3, 1e-3), "s": (1e-3,), "ms": (1e3,), "us": (1e3,),
    "deg": (180.0 / math.pi,), "rad": (math.pi / 180.0,), "deg/s": (180.0 / math.pi,),
    "rad/s": (2.0 * math.pi, math.pi / 180.0),
}  # fmt: skip
# largest values of numbers in a unit, and of those without one: far beyond what is of use, so that nothing hangs
MOST = {
    "s": 1e3, "ms": 1e3, "mm": 500.0, "m": 1.0, "deg": 90.0, "rad": 2.0 * math.pi, "m/s": 10.0, "g": 1e3,
    "deg/s": 1e4, "rad/s": 1e3, "": 1e6,
}  # fmt: skip
TINY = {"mm": 0.05, "ms": 0.05}  # a smaller number that is not 0 is in another unit
WHOLE = 1000  # largest count
NEAR = 0.1  # share of a bound
_SUFFIX = re.compile(r"(?<!_per)_(rad_s|deg_s|m_s|mm|ms|deg|rad|m|g|s)$")


def unit_hint(value: float, unit: str, low: float, high: float) -> str:
    """The end of a message on a number out of its range: what it may mean in that unit. Empty if nothing fits, and for
    a number near its range, which is hardly in another unit."""
    if any(abs(value - bound) <= NEAR * abs(bound) for bound in (low, high) if math.isfinite(bound)):
        return ""
    meant = (factor * value for factor in CONVERSIONS.get(unit, ()))
    found = next((number for number in meant if number and low <= number <= high), None)
    return "" if found is None else f"; the unit is {unit}: did you mean {found:.4g}?"


def unit_of(key: str) -> str:
    """The unit at the end of a key: deg/s of servo_slew_deg_s. Empty without one."""
    found = _SUFFIX.search(key)
    return "" if found is None else found[1].replace("_s", "/s")


def check_numbers(
    options: Any, *, positive: Collection[str] = (), least: float = 0.0, most: Mapping[str, float] | None = None
) -> None:
    """Every number of a dataclass must be >= `least`, those named in `positive` > 0; whole where declared so.

    most: largest values by field; of the others see MOST. Raises SettingsError with the field's name."""
    for field in fields(options):
        value = getattr(options, field.name)
        if isinstance(value, bool) or not isinstance(value, int | float):
            if field.type in ("int", "float"):
                raise SettingsError(f"got {value!r}, expected a number", key=field.name)
            continue
        if field.type == "int" and not isinstance(value, int):
            raise SettingsError(f"got {value!r}, expected a whole number", key=field.name)
        if field.name in positive and not 0.0 < value < math.inf:
            raise SettingsError(f"got {value:g}, expected a number > 0", key=field.name)
        if not least <= value < math.inf:
            raise SettingsError(f"got {value:g}, expected a number >= {least:g}", key=field.name)
        unit = unit_of(field.name)
        if 0.0 < value < TINY.get(unit, 0.0) and (hint := unit_hint(value, unit, TINY[unit], math.inf)):
            raise SettingsError(f"got {value:g}, expected 0, or at least {TINY[unit]:g}{hint}", key=field.name)
        high = (most or {}).get(field.name, MOST[unit] if field.type == "float" else WHOLE)
        if value > high:
            hint = unit_hint(value, unit, least, high)
            raise SettingsError(f"got {value:g}, expected a number <= {high:g}{hint}", key=field.name)
