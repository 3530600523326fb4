"""Checks for the numbers of frozen options."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import fields
from typing import Any

from mazeplan.core.errors import SettingsError

WHOLE, MOST = 1000, 1e6  # maximum of a whole and of another number: far beyond useful values, so that nothing hangs


def check_numbers(options: Any, *, positive: Collection[str] = (), most: Mapping[str, float] | None = None) -> None:
    """Check the numbers of a dataclass: at least 0; fields declared as int must be whole. Raises SettingsError with the
    field.

    positive: fields that must be > 0; most: maximum by field, else WHOLE or MOST"""
    for field in fields(options):
        if field.type not in ("int", "float"):
            continue
        value, whole = getattr(options, field.name), field.type == "int"
        if isinstance(value, bool) or not isinstance(value, int if whole else int | float):
            raise SettingsError(f"got {value!r}, expected a {'whole ' * whole}number", key=field.name)
        if field.name in positive and not 0.0 < value < math.inf:
            raise SettingsError(f"got {value:g}, expected a number > 0", key=field.name)
        high = (most or {}).get(field.name, WHOLE if whole else MOST)
        if not 0.0 <= value <= high:
            raise SettingsError(f"got {value:g}, expected a number of 0 to {high:g}", key=field.name)
