"""What shows a run to a person while it goes on."""

from __future__ import annotations

from typing import Protocol


class Display(Protocol):
    """What shows a run to a person; `NullDisplay` shows nothing."""

    def ring_entered(self, ring: int, t: float) -> None:
        """The ball is in another ring."""

    def passed(self, ring: int, opening: str, t: float) -> None:
        """The ball left `ring` by an opening."""

    def event(self, t: float, text: str) -> None:
        """Something worth a line."""

    def tick(self, t: float, ring: int, text: str) -> None:
        """One tick is over."""


class NullDisplay:
    """Shows nothing."""

    def ring_entered(self, ring: int, t: float) -> None:
        """Nothing."""

    def passed(self, ring: int, opening: str, t: float) -> None:
        """Nothing."""

    def event(self, t: float, text: str) -> None:
        """Nothing."""

    def tick(self, t: float, ring: int, text: str) -> None:
        """Nothing."""
