"""Progress of long operations, by plain functions, and of a run, by a display: the command line provides them."""

from __future__ import annotations

from collections.abc import Callable

Words = Callable[[str], None]  # the step under way
Advance = Callable[[float, float], None]  # amount done, total


class Display:
    """Shows a run to a person; the methods here show nothing."""

    def ring_entered(self, ring: int, t: float) -> None:
        """The ball entered another ring."""

    def passed(self, ring: int, opening: str, t: float) -> None:
        """The ball left `ring` through an opening."""

    def event(self, t: float, text: str) -> None:
        """Show an event, as one line of text."""

    def tick(self, t: float, ring: int, text: str) -> None:
        """A tick ended."""


def no_words(text: str) -> None:
    """The default: the step is not shown."""


def no_advance(done: float, total: float) -> None:
    """The default: the progress is not shown."""


def piece(advance: Advance, begin: float, size: float, total: float) -> Advance:
    """Progress of a part of the work: `size` of `total`, after `begin`."""
    return lambda done, of: advance(begin + size * (min(done / of, 1.0) if of > 0.0 else 1.0), total)


def led_by(lead: str, tell: Words) -> Words:
    """A function that calls `tell` with `lead` before the text."""
    return lambda text: tell(f"{lead}{text}")


def of_total(advance: Advance, total: float) -> Callable[[float], None]:
    """A function for work that reports the amount done without the total."""
    return lambda done: advance(done, total)
