"""Compensation of gear backlash b: the command leads the wanted tilt by b/2, in the direction of motion.

    sent_k   = wanted_k + b/2 if the gears must turn up, wanted_k - b/2 if down, else sent_(k-1)
    passed_k = clip(passed_(k-1), sent_k - b/2, sent_k + b/2)

sent: the command; passed: the tilt that the gears pass on.
"""

from __future__ import annotations

import numpy as np

from mazeplan.core.records import Array, Command
from mazeplan.physics.rig.stage import StageModel


class BacklashCompensator:
    """State of the gears of both axes in one run."""

    def __init__(self, stage: StageModel, limit: float) -> None:
        """limit: largest command per axis, rad."""
        self._half = 0.5 * np.array([stage.beta.backlash, stage.gamma.backlash])
        self._limit = limit
        self._sent, self._passed = np.zeros(2), np.zeros(2)

    @property
    def has_backlash(self) -> bool:
        """Whether an axis has backlash."""
        return bool(self._half.any())

    def lead(self, wanted: Command) -> Command:
        """The command that makes the gears pass on the wanted command, clipped to the limit."""
        target = np.array([wanted.u_beta, wanted.u_gamma])
        step = target - self._passed
        ahead = np.where(np.abs(step) < 1e-9, self._sent, target + np.sign(step) * self._half)
        ahead = np.where(self._half > 0.0, np.clip(ahead, -self._limit, self._limit), target)
        return Command(float(ahead[0]), float(ahead[1]))

    def sent(self, command: Command) -> Command:
        """Record a command that was sent. Returns the command that the gears pass on."""
        self._sent = np.array([command.u_beta, command.u_gamma])
        self._passed: Array = np.clip(self._passed, self._sent - self._half, self._sent + self._half)
        return Command(float(self._passed[0]), float(self._passed[1]))
