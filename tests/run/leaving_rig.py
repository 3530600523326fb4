"""Rigs whose ball is outside the rim from the tenth step on: for good, or only in every third sample."""

from __future__ import annotations

from dataclasses import replace

from mazeplan.apps.testing.lightrig import LightRig


class Leaving(LightRig):
    """It stays there."""

    k = 0

    def observe(self):
        """The next sample."""
        self.k += 1
        sample = super().observe()
        return replace(sample, x=0.12, y=0.0) if self.outside() else sample

    def outside(self) -> bool:
        """Whether the ball is seen there; the first sample is that of the reset."""
        return self.k > 10


class Blinking(Leaving):
    """Only the camera errs."""

    def outside(self) -> bool:
        """Whether the ball is seen there."""
        return self.k > 10 and self.k % 3 == 0
