"""How far long work is, told by plain functions: who does the work calls them, who shows it hands them in."""

from __future__ import annotations

from collections.abc import Callable

Words = Callable[[str], None]  # what is being done
Advance = Callable[[float, float], None]  # how much is done, of how much


def no_words(text: str) -> None:
    """Nobody wants to know."""


def no_advance(done: float, total: float) -> None:
    """Nobody wants to know."""


def piece(advance: Advance, begin: float, size: float, total: float) -> Advance:
    """What a piece of the work calls: it is `size` of `total`, behind `begin`."""
    return lambda done, of: advance(begin + size * (min(done / of, 1.0) if of > 0.0 else 1.0), total)


def led_by(lead: str, tell: Words) -> Words:
    """Words that say first of what they are."""
    return lambda text: tell(f"{lead}{text}")


def of_total(advance: Advance, total: float) -> Callable[[float], None]:
    """For work that tells how much is done, and not of how much."""
    return lambda done: advance(done, total)
