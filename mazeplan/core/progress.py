"""Progress of long work, by plain functions: the work calls them, the display provides them."""

from __future__ import annotations

from collections.abc import Callable

Words = Callable[[str], None]  # the step under way
Advance = Callable[[float, float], None]  # amount done, total


def no_words(text: str) -> None:
    """Nobody wants to know."""


def no_advance(done: float, total: float) -> None:
    """Nobody wants to know."""


def piece(advance: Advance, begin: float, size: float, total: float) -> Advance:
    """Progress of a part of the work: `size` of `total`, after `begin`."""
    return lambda done, of: advance(begin + size * (min(done / of, 1.0) if of > 0.0 else 1.0), total)


def led_by(lead: str, tell: Words) -> Words:
    """Words with a lead before them."""
    return lambda text: tell(f"{lead}{text}")


def of_total(advance: Advance, total: float) -> Callable[[float], None]:
    """For work that reports the amount done without the total."""
    return lambda done: advance(done, total)
