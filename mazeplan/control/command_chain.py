"""The way of a command from the leaf that wants it to the rig:

    wanted --safety filter--> --slew--> --gears--> sent; the gears pass on what the estimators expect

Leaves clip their commands to the tilt limit (`tilt.Plate.clip`): a rig refuses a command beyond it, which is a leaf's
mistake.

- The safety filter changes commands by which a kept ball would leave the centre.
- The slew limit allows a change of at most slew / rate a sample.
- Gears with backlash b are led by b/2, in the direction of motion:

    sent_k   = wanted_k + b/2 if the gears must turn up, wanted_k - b/2 if down, else sent_(k-1)
    passed_k = clip(passed_(k-1), sent_k - b/2, sent_k + b/2)

A ball in the disc leaves it when the plate tilts towards the opening of the disc. Therefore every command for another
ball goes through the safety filter. It predicts each kept ball with the planar model:

    the command for HOLD_S, then the rescue for RESCUE_S: the plate tilts away from the opening, as far as the limit

The predictions start from several states around the ball's estimate. A command is safe if, in all of them, the ball
goes at most MARGIN further out than where the wall stops it: the rescue can then follow the command. A safe command
goes out unchanged. Otherwise the filter takes, from a set of commands, the nearest one that keeps the ball. Commands of
the set have a share of the wanted tilt along the ring of the other ball. Across that ring they differ freely, because a
wall holds the other ball. (Predictive safety filter; Wabersich, Zeilinger, Automatica 129, 2021.)
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numba import njit

from mazeplan.control.tilt import Plate
from mazeplan.core.constants import GRAVITY
from mazeplan.core.maths.compiled import KERNEL
from mazeplan.core.records import LEVEL, Array, Command, State
from mazeplan.maze.geometry import Maze
from mazeplan.physics.dynamics.planar import SUBSTEP, PlanarModel, ball_step, stage_step
from mazeplan.physics.rig.stage import StageModel

HOLD_S, RESCUE_S = 0.067, 0.35  # s; for which a command acts before the rescue, and the rescue
MARGIN = 2e-3  # m; how much further out a ball may go than where the wall stops it
DOUBT, DOUBT_SPEED = 1.5e-3, 0.02  # m, m/s; offsets of the starts around the estimate
ACROSS = 0.2  # price of a change across the ring of the other ball; a change along the ring has price 1
LEANS = 9  # number of commands tried across the ring, besides the wanted one
SHARES = (1.0, 0.6, 0.25, 0.0, -0.5)  # shares of the wanted command along the ring of the other ball


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


class SafetyFilter:
    """Keeps balls in the disc of one maze, on one model; see the module."""

    def __init__(self, maze: Maze, planar: PlanarModel, plate: Plate) -> None:
        self._planar, self._plate = planar, plate
        disc = maze.rings[-1]
        self._openings = [opening.angle for opening in maze.openings_of(disc.number)]
        self._out = disc.outer_radius + maze.ball.radius  # m: a ball that far out is not predicted further
        self._limit = disc.outer_radius - maze.ball.radius + MARGIN
        self._steps = np.array([round(HOLD_S / SUBSTEP), round(RESCUE_S / SUBSTEP)])

    def command(self, wanted: Command, kept: Sequence[State], led: State) -> Command:
        """The command `wanted` for the ball `led`, or the nearest command that keeps the balls `kept`.

        The states are those at the moment when the command acts. If no command keeps all balls, the result is the
        command under which the farthest ball stays nearest to the centre."""
        if self.farthest(wanted, kept) <= self._limit:
            return wanted
        best, least = wanted, math.inf
        for candidate in self._candidates(wanted, kept, led):
            far = self.farthest(candidate, kept)
            if far <= self._limit:
                return candidate
            if far < least:
                best, least = candidate, far
        return best

    def farthest(self, command: Command, kept: Sequence[State]) -> float:
        """Largest distance of any kept ball from the centre, m, under a command and the rescue that follows."""
        most = 0.0
        for state in kept:
            rescue = self._rescue(state)
            commands = np.array([[command.u_beta, command.u_gamma], [rescue.u_beta, rescue.u_gamma]])
            starts = _around(state, DOUBT, DOUBT_SPEED, self._nearest(state))
            most = max(most, _max_radius(starts, commands, self._steps, self._out, *self._planar))
        return most

    def _nearest(self, state: State) -> float:
        """Angle of the opening nearest to a ball, rad."""
        return min(self._openings, key=lambda angle: -(math.cos(angle) * state.x + math.sin(angle) * state.y))

    def _rescue(self, state: State) -> Command:
        angle, pull = self._nearest(state), -GRAVITY * math.tan(self._plate.limit)
        return self._plate.command(pull * math.cos(angle), pull * math.sin(angle))

    def _candidates(self, wanted: Command, kept: Sequence[State], led: State) -> list[Command]:
        """Commands to try: the nearest to the wanted one first, then the rescue of each kept ball."""
        plate = self._plate
        ax, ay = plate.acceleration(wanted)
        c, s = math.cos(led.theta), math.sin(led.theta)
        across, along = c * ax + s * ay, -s * ax + c * ay
        most = GRAVITY * math.sqrt(2.0) * plate.limit
        priced = []
        for share in SHARES:
            for lean in (across, *np.linspace(-most, most, LEANS).tolist()):
                command = plate.command(c * lean - s * share * along, s * lean + c * share * along)
                bx, by = plate.acceleration(command)
                price = (-s * bx + c * by - along) ** 2 + ACROSS * (c * bx + s * by - across) ** 2
                priced.append((price, command))
        priced.sort(key=lambda item: item[0])
        return [command for _, command in priced] + [self._rescue(state) for state in kept]

    def warm_up(self) -> None:
        """Compile or load everything before the rig moves."""
        self.farthest(Command(0.0, 0.0), [State(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1)])


def _around(state: State, place: float, speed: float, angle: float) -> Array:
    """States (5, 8) to start from.

    They are the estimate; beside it on either side, across an opening at `angle`; nearer to the opening; and faster."""
    z = np.array([state.x, state.y, state.vx, state.vy, state.beta, state.beta_dot, state.gamma, state.gamma_dot])
    starts = np.tile(z, (5, 1))
    c, s = math.cos(angle), math.sin(angle)
    starts[1, :2] += -s * place, c * place
    starts[2, :2] -= -s * place, c * place
    starts[3, :2] += c * place, s * place
    starts[4, 2:4] += c * speed, s * speed
    return starts


@njit(**KERNEL)
def _max_radius(starts, commands, steps, out, scalars, stage, rings, walls, gaps):
    """Largest distance of the ball from the centre, m, over all starts (N, 8), which are changed in place.

    commands[i] acts for steps[i] sub-steps."""
    most = 0.0
    for j in range(starts.shape[0]):
        z = starts[j]
        touching = np.bool_(False)  # a constant would compile what it is passed to once more
        for i in range(commands.shape[0]):
            for _ in range(steps[i]):
                stage_step(z, commands[i, 0], commands[i, 1], stage, SUBSTEP)
                touching = ball_step(z, SUBSTEP, scalars, rings, walls, gaps, touching)
                most = max(most, z[0] * z[0] + z[1] * z[1])
            if most > out * out:
                break
    return math.sqrt(most)
