"""Commands for a plate whose servos have play: half of it ahead of the wish, on the side to which the plate is to go.

sent_k   = wished_k + b/2 where the gears must go up to pass it on, - b/2 where down, else as before
passed_k = clip(passed_(k-1), sent_k - b/2, sent_k + b/2)
"""

from __future__ import annotations

import numpy as np

from mazeplan.physics.stage import StageModel
from mazeplan.records import Array, Command


class Gears:
    """The gears of both axes in one run: what to send, and what they pass on of it."""

    def __init__(self, stage: StageModel, limit: float) -> None:
        """limit: of a command, rad per axis."""
        self._half = 0.5 * np.array([stage.beta.backlash, stage.gamma.backlash])
        self._limit = limit
        self._sent, self._passed = np.zeros(2), np.zeros(2)

    @property
    def loose(self) -> bool:
        """Whether there is any play."""
        return bool(self._half.any())

    def lead(self, wished: Command) -> Command:
        """The command that makes the gears pass on the wish, as far as the limit lets them."""
        target = np.array([wished.u_beta, wished.u_gamma])
        step = target - self._passed
        ahead = np.where(np.abs(step) < 1e-9, self._sent, target + np.sign(step) * self._half)
        ahead = np.where(self._half > 0.0, np.clip(ahead, -self._limit, self._limit), target)
        return Command(float(ahead[0]), float(ahead[1]))

    def sent(self, command: Command) -> Command:
        """Note what was sent; what the gears pass on."""
        self._sent = np.array([command.u_beta, command.u_gamma])
        self._passed: Array = np.clip(self._passed, self._sent - self._half, self._sent + self._half)
        return Command(float(self._passed[0]), float(self._passed[1]))
