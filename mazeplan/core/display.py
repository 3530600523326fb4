"""The display of a run: shows it to a person while it goes on."""

from __future__ import annotations

from typing import Protocol


class Display(Protocol):
    """Shows a run to a person; the methods here show nothing."""

    def ring_entered(self, ring: int, t: float) -> None:
        """The ball entered another ring."""

    def passed(self, ring: int, opening: str, t: float) -> None:
        """The ball left `ring` through an opening."""

    def event(self, t: float, text: str) -> None:
        """Show an event, as one line of text."""

    def tick(self, t: float, ring: int, text: str) -> None:
        """A tick ended."""


class NullDisplay(Display):
    """Shows nothing."""
