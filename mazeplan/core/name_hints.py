"""Hints for messages about an unknown name: the known names, and the name that was probably meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from typing import Any

LEAST = 0.6  # minimum similarity of a guess: difflib's ratio, 1 for the same name
MOST = 200  # maximum number of names for a guess; with more, a guess takes too long


def nearest(got: object, names: Iterable[str], least: float = LEAST) -> str | None:
    """The known name that `got` probably misspells; None without a similar name, or if `got` is a known name."""
    known = {name.lower().replace("-", "_").replace(" ", "_"): name for name in names}
    if not isinstance(got, str) or got in known.values() or len(known) > MOST:
        return None
    found = difflib.get_close_matches(got.lower().replace("-", "_").replace(" ", "_"), known, 1, least)
    return known[found[0]] if found else None


def guess(got: object, names: Iterable[str]) -> str:
    """End of a message about an unknown name: `; did you mean dry_friction?`, or nothing."""
    near = nearest(got, names)
    return "" if near is None else f"; did you mean {near}?"


def one_of(names: Iterable[str], got: object = None, more: str = "") -> str:
    """`one of a, b, c`, and a guess which of these names `got` misspells.

    more: what else is allowed, such as ", or a file"; it comes before the guess."""
    known = list(names)
    return f"one of {', '.join(known) or 'none'}{more}{guess(got, known)}"


def unknown_keys_first(errors: Sequence[Any]) -> list[Any]:
    """The errors of a pydantic ValidationError, in another order: unknown keys come first where the same section lacks
    a key. A misspelled key causes both errors; only its name shows the mistake."""
    lacking = {error["loc"][:-1] for error in errors if error["type"] == "missing"}
    return sorted(errors, key=lambda e: not (e["type"] == "extra_forbidden" and e["loc"][:-1] in lacking))
