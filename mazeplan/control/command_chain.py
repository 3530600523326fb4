"""The way of a command from the leaf that wants it to the rig:

    wanted --safety filter--> --slew--> --gears--> sent; the gears pass on what the estimators expect

Leaves clip their commands to the tilt limit (`tilt.Plate.clip`): a rig refuses a command beyond it, which is a leaf's
mistake.

- The safety filter changes commands by which a kept ball would leave the centre (`keeping`).
- The slew limit allows a change of at most slew / rate a sample.
- Gears with backlash b are led by b/2, in the direction of motion:

    sent_k   = wanted_k + b/2 if the gears must turn up, wanted_k - b/2 if down, else sent_(k-1)
    passed_k = clip(passed_(k-1), sent_k - b/2, sent_k + b/2)
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mazeplan.control.keeping import SafetyFilter
from mazeplan.core.records import LEVEL, Array, Command, State
from mazeplan.physics.rig.stage import StageModel


class CommandChain:
    """The chain of one run.

    slew: fastest change of commands, rad/s
    wanted: the last command before the gears
    sent: the last command that the rig got
    """

    def __init__(self, rate_hz: float, slew: float = math.inf) -> None:
        self.wanted = self.sent = LEVEL
        self._most = slew / rate_hz
        self._keeper: SafetyFilter | None = None
        self._gears: Gears | None = None

    def adopt(self, stage: StageModel, limit: float, keeper: SafetyFilter | None) -> None:
        """Use this stage, tilt limit (rad) and safety filter from now on."""
        self._keeper = keeper
        self._gears = Gears(stage, limit) if stage.beta.backlash or stage.gamma.backlash else None

    def limited(self, wanted: Command | None, kept: Sequence[State] = (), led: State | None = None) -> Command:
        """A wanted command after safety filter and slew limit; None: level.

        kept, led: the balls that must stay in the centre, and the ball that is led"""
        command = LEVEL if wanted is None else wanted
        if wanted is not None and kept and led is not None and self._keeper is not None:
            command = self._keeper.command(command, kept, led)
        last, most = self.wanted, self._most
        return Command(
            min(max(command.u_beta, last.u_beta - most), last.u_beta + most),
            min(max(command.u_gamma, last.u_gamma - most), last.u_gamma + most),
        )

    def send(self, command: Command, *, lead: bool) -> Command:
        """Take a limited command to the rig: `sent` is then what the rig gets. Returns what the gears pass on.

        lead: compensate the backlash"""
        self.wanted = self.sent = command
        if self._gears is None:
            return command
        self.sent = self._gears.lead(command) if lead else command
        return self._gears.pass_on(self.sent)


class Gears:
    """State of the gears of both axes in one run. limit: largest command per axis, rad."""

    def __init__(self, stage: StageModel, limit: float) -> None:
        self._half = 0.5 * np.array([stage.beta.backlash, stage.gamma.backlash])
        self._limit = limit
        self._sent, self._passed = np.zeros(2), np.zeros(2)

    def lead(self, wanted: Command) -> Command:
        """The command that makes the gears pass on the wanted command, clipped to the limit."""
        target = np.array([wanted.u_beta, wanted.u_gamma])
        step = target - self._passed
        ahead = np.where(np.abs(step) < 1e-9, self._sent, target + np.sign(step) * self._half)
        ahead = np.where(self._half > 0.0, np.clip(ahead, -self._limit, self._limit), target)
        return Command(float(ahead[0]), float(ahead[1]))

    def pass_on(self, command: Command) -> Command:
        """Record a command that was sent. Returns the command that the gears pass on."""
        self._sent = np.array([command.u_beta, command.u_gamma])
        self._passed: Array = np.clip(self._passed, self._sent - self._half, self._sent + self._half)
        return Command(float(self._passed[0]), float(self._passed[1]))
