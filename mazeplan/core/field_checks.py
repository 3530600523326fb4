"""Checks for the numbers of frozen options, and a guess of the unit in which a wrong number was given."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping
from dataclasses import fields
from typing import Any

from mazeplan.core.errors import SettingsError

# by unit: factors that convert a number given in another unit, which people confuse with it
CONVERSIONS = {
    "mm": (1e3, 10.0), "m": (1e-3, 1e-2), "m/s": (1e-3,), "g": (1e3, 1e-3), "s": (1e-3,), "ms": (1e3,), "us": (1e3,),
    "deg": (180.0 / math.pi,), "rad": (math.pi / 180.0,), "deg/s": (180.0 / math.pi,),
    "rad/s": (2.0 * math.pi, math.pi / 180.0),
}  # fmt: skip
# maximum of a number by its unit, "" for none: far beyond useful values, so that nothing hangs
MOST = {
    "s": 1e3, "ms": 1e3, "mm": 500.0, "m": 1.0, "deg": 90.0, "rad": 2.0 * math.pi, "m/s": 10.0, "g": 1e3,
    "deg/s": 1e4, "rad/s": 1e3, "": 1e6,
}  # fmt: skip
TINY = {"mm": 0.05, "ms": 0.05}  # by unit; a smaller number, except 0, is in another unit
WHOLE = 1000  # maximum of a whole number
NEAR = 0.1  # share of a bound; a number that is this near to the bound gets no hint
_SUFFIX = re.compile(r"(?<!_per)_(rad_s|deg_s|m_s|mm|ms|deg|rad|m|g|s)$")


def unit_hint(value: float, unit: str, low: float, high: float) -> str:
    """End of a message about a number out of its range: the number that was probably meant, in `unit`.

    Empty if no conversion fits, and for a number near its range, which is hardly in another unit."""
    if any(abs(value - bound) <= NEAR * abs(bound) for bound in (low, high) if math.isfinite(bound)):
        return ""
    meant = (factor * value for factor in CONVERSIONS.get(unit, ()))
    found = next((number for number in meant if number and low <= number <= high), None)
    return "" if found is None else f"; the unit is {unit}: did you mean {found:.4g}?"


def unit_of(key: str) -> str:
    """The unit at the end of a key, such as deg/s for servo_slew_deg_s. Empty without a unit."""
    found = _SUFFIX.search(key)
    return "" if found is None else found[1].replace("_s", "/s")


def check_numbers(
    options: Any, *, positive: Collection[str] = (), least: float = 0.0, most: Mapping[str, float] | None = None
) -> None:
    """Check the numbers of a dataclass; fields declared as int must be whole. Raises SettingsError with the field.

    positive: fields that must be > 0
    least:    minimum of all numbers
    most:     maximum by field; the default is MOST for the field's unit, or WHOLE for a whole number
    """
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
