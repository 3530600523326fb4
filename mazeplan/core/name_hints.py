"""Words for a name that is none of the known ones: all of those, and the one that may have been meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

LEAST = 0.6  # similarity of a name that may have been meant: difflib's ratio, 1 for the same name
MOST = 200  # names among which a guess is made: beyond that it takes too long


def nearest(got: object, names: Iterable[str], least: float = LEAST) -> str | None:
    """The name that `got` may be a slip for; None if there is none, or if it is one of them."""
    known = {name.lower().replace("-", "_").replace(" ", "_"): name for name in names}
    if not isinstance(got, str) or got in known.values() or len(known) > MOST:
        return None
    found = difflib.get_close_matches(got.lower().replace("-", "_").replace(" ", "_"), known, 1, least)
    return known[found[0]] if found else None


def guess(got: object, names: Iterable[str]) -> str:
    """`; did you mean dry_friction?`, or nothing: the end of a message about an unknown name."""
    near = nearest(got, names)
    return "" if near is None else f"; did you mean {near}?"


def one_of(names: Iterable[str], got: object = None, more: str = "") -> str:
    """`one of a, b, c`, and which of them `got` may be a slip for.

    more: what else is allowed, as ", or a file"; it comes before the guess."""
    known = list(names)
    return f"one of {', '.join(known) or 'none'}{more}{guess(got, known)}"
