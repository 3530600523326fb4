"""Checks that frozen options make of their own numbers."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import fields
from typing import Any

from mazeplan.core.errors import SettingsError


def check_numbers(options: Any, *, positive: Collection[str] = (), least: float = 0.0) -> None:
    """Every number of a dataclass must be finite and >= `least`, those named in `positive` > 0; whole where declared
    so. Raises SettingsError with the field's name."""
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
