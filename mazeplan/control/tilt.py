"""Tilt commands for a wanted acceleration of the ball, inside the limits.

The inverse of the gravity part of the ball's equation at small angles, without its rolling factor:

    a_x = g (beta + beta_0),   a_y = -g (gamma + gamma_0)

where (beta_0, gamma_0) is the tilt of the table. Acceleration here means tilt times g; the ball gets at most 5/7 of it.
"""

from __future__ import annotations

from dataclasses import dataclass

from mazeplan.core.constants import GRAVITY
from mazeplan.core.records import Command


@dataclass(frozen=True, slots=True)
class Plate:
    """Tilt limit per axis and tilt of the table, rad."""

    limit: float
    offset_beta: float = 0.0
    offset_gamma: float = 0.0

    def clip(self, u_beta: float, u_gamma: float) -> Command:
        """The command inside the limits."""
        limit = self.limit
        return Command(min(max(u_beta, -limit), limit), min(max(u_gamma, -limit), limit))

    def acceleration(self, command: Command) -> tuple[float, float]:
        """Tilt times g along x and y under a command, m/s^2."""
        return GRAVITY * (command.u_beta + self.offset_beta), -GRAVITY * (command.u_gamma + self.offset_gamma)

    def command(self, ax: float, ay: float) -> Command:
        """The command for a wanted acceleration, m/s^2, clipped per axis."""
        return self.clip(ax / GRAVITY - self.offset_beta, -ay / GRAVITY - self.offset_gamma)

    def command_along(self, first: tuple[float, float], then: tuple[float, float]) -> Command:
        """The command for the acceleration `first`, plus the share of `then` that the limits allow, m/s^2.

        `then` never changes the direction of `first`: braking comes before pushing.
        """
        base = self.command(*first)
        full = (first[0] + then[0]) / GRAVITY - self.offset_beta, -(first[1] + then[1]) / GRAVITY - self.offset_gamma
        share = min(room(base.u_beta, full[0], self.limit), room(base.u_gamma, full[1], self.limit))
        return self.clip(base.u_beta + share * (full[0] - base.u_beta), base.u_gamma + share * (full[1] - base.u_gamma))


def room(start, end, limit):
    """Share, 0 to 1, of the way from start to end that stays within +-limit. start must be within the limit."""
    step = end - start
    if step > 0.0:
        return min(1.0, max(0.0, (limit - start) / step))
    if step < 0.0:
        return min(1.0, max(0.0, (-limit - start) / step))
    return 1.0
