"""Keep a ball in the centre while the plate tilts for another ball.

A ball in the disc leaves it when the plate tilts towards the opening of the disc. Therefore every command for another
ball goes through this filter. It predicts each kept ball with the planar model:

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
from mazeplan.core.records import Array, Command, State
from mazeplan.maze.geometry import Maze
from mazeplan.physics.dynamics.planar import SUBSTEP, PlanarModel, ball_step, stage_step

HOLD_S, RESCUE_S = 0.067, 0.35  # s; for which a command acts before the rescue, and the rescue
MARGIN = 2e-3  # m; how much further out a ball may go than where the wall stops it
DOUBT, DOUBT_SPEED = 1.5e-3, 0.02  # m, m/s; offsets of the starts around the estimate
ACROSS = 0.2  # price of a change across the ring of the other ball; a change along the ring has price 1
LEANS = 9  # number of commands tried across the ring, besides the wanted one
SHARES = (1.0, 0.6, 0.25, 0.0, -0.5)  # shares of the wanted command along the ring of the other ball


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
