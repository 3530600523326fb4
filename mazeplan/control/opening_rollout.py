"""Roll-outs before an opening: commands that are tried on the model first.

The law of an opening brakes the ball before it falls in, which takes time. The far edge can stop a faster ball
instead. The planar model knows edges and servo, so it can predict the outcome. Each tick simulates every command u of a
grid, held for n ticks. Then the law takes over, until the ball is in the middle of the wall:

    t(u, n) = mean time to the middle of the wall, over starts around the ball;    t(law): the same without u

The best u goes out if t(u, n) < t(law) - margin, else the command of the law. This is one step of policy iteration
(roll-out; Bertsekas, Dynamic Programming and Optimal Control, vol. 1, section 6.4): on the model it is never worse than
the law. The starts differ by the uncertainty of the ball's position and speed across the opening. So the choice does
not depend on an exact estimate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from mazeplan.control.opening import OpeningOptions
from mazeplan.control.tilt import Plate, room
from mazeplan.core.constants import GRAVITY
from mazeplan.core.errors import SettingsError
from mazeplan.core.field_checks import check_numbers
from mazeplan.core.maths.compiled import CALLEE, KERNEL, copy_into
from mazeplan.core.records import Array, Command, State
from mazeplan.maze.geometry import Maze, Opening
from mazeplan.physics.dynamics.planar import PlanarModel, ball_step, stage_step

TICK = 1.0 / 30.0  # s; how long one command of the law holds
LEAST_SUBSTEPS = 4
ASSUMED_SPEED = 0.1  # m/s; assumed speed after the horizon
HOLD_TICKS = (1, 2, 4)  # ticks that a command is held
_room = njit(**CALLEE)(room)


@dataclass(frozen=True)
class RolloutOptions:
    """Settings of the roll-outs. Raises SettingsError.

    doubt_mm, doubt_m_s:  offsets of the other starts across the opening, mm and m/s"""

    grid: int  # commands per axis, between the limits
    margin_s: float  # time by which a command must beat the law, s
    doubt_mm: float
    doubt_m_s: float
    horizon_s: float  # duration of one roll-out, s
    substeps: int  # steps of a simulation per tick
    late_s: float  # maximum delay of the measurements for roll-outs, s; with more, the position is too uncertain
    late_body_s: float  # the same for a ball predicted as a rigid body, s; that prediction is more certain

    def __post_init__(self) -> None:
        most = {"grid": 25, "horizon_s": 5.0, "substeps": 40}
        check_numbers(self, positive=("grid", "horizon_s", "substeps"), most=most)
        if self.substeps < LEAST_SUBSTEPS:
            expected = f"{LEAST_SUBSTEPS} to 40: with fewer, a simulated ball jumps over walls"
            raise SettingsError(f"got {self.substeps}, expected {expected}", key="substeps")

    def starts(self) -> Array:
        """Offsets (5, 2) of the starts across the opening, m and m/s: none, to either side, faster and slower."""
        place, speed = 1e-3 * self.doubt_mm, self.doubt_m_s
        return np.array([[0.0, 0.0], [place, 0.0], [-place, 0.0], [0.0, speed], [0.0, -speed]])


class OpeningRollout:
    """Roll-outs through the openings of one maze on one model. Commands are at most `plate.limit`, rad."""

    def __init__(
        self, maze: Maze, planar: PlanarModel, plate: Plate, gate: OpeningOptions, options: RolloutOptions,
        tick_s: float = TICK,
    ) -> None:  # fmt: skip
        """tick_s: time from command to command, s"""
        self._maze, self._planar, self._limit = maze, planar, plate.limit
        self._options = options
        # a command is held for a tick of the rig; a faster rig simulates no finer
        tick = tick_s * max(round(TICK / tick_s), 1)
        self._span = options.horizon_s, max(round(options.substeps * tick / TICK), LEAST_SUBSTEPS), tick
        axis = np.linspace(-plate.limit, plate.limit, options.grid)
        self._tried = np.array([[a, b] for a in axis for b in axis])
        push = GRAVITY * math.radians(gate.push_deg)
        self._law = np.array([gate.kp, gate.kd, gate.lead_s, push, plate.limit, plate.offset_beta, plate.offset_gamma])

    def improved_command(self, state: State, opening: Opening, towards: int) -> Command | None:
        """The command that brings the ball into ring `towards` sooner than the law by the margin, or None.

        state: at the moment when the command acts."""
        o = self._options
        z = np.array([state.x, state.y, state.vx, state.vy, state.beta, state.beta_dot, state.gamma, state.gamma_dot])
        sign = -1.0 if towards == opening.inner else 1.0
        wall = next(w for w in self._maze.walls if opening in w.openings)
        middle = 0.5 * (wall.inner_radius + wall.outer_radius)
        gap = np.array([math.cos(opening.angle), math.sin(opening.angle), sign, middle])
        which = _best(z, gap, self._law, self._tried, o.starts(), o.margin_s, self._span, *self._planar)
        return None if which < 0 else Command(float(self._tried[which, 0]), float(self._tried[which, 1]))

    def warm_up(self) -> None:
        """Compile or load everything before the rig moves."""
        opening = self._maze.openings[0]
        r = self._maze.track_radius(opening.outer)
        x, y = r * math.cos(opening.angle), r * math.sin(opening.angle)
        state = State(0.0, x, y, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, opening.outer)
        self.improved_command(state, opening, opening.inner)


@njit(**KERNEL)
def law_command(z, gap, law, out):
    """`opening_command` for a state z (8,), into out (2,). The look-ahead holds the present tilt."""
    c, s, sign = gap[0], gap[1], gap[2]
    kp, kd, lead, push, limit, beta0, gamma0 = law[0], law[1], law[2], law[3], law[4], law[5], law[6]
    across, speed = -s * z[0] + c * z[1], -s * z[2] + c * z[3]
    pull = 0.5 * GRAVITY * (-s * math.sin(z[4] + beta0) - c * math.sin(z[6] + gamma0))  # about 5/7, less along walls
    across += lead * speed + 0.5 * lead * lead * pull
    speed += lead * pull
    hold = -(kp * across + kd * speed)
    base_beta = min(max(-s * hold / GRAVITY - beta0, -limit), limit)
    base_gamma = min(max(-c * hold / GRAVITY - gamma0, -limit), limit)
    full_beta = (-s * hold + sign * push * c) / GRAVITY - beta0
    full_gamma = -(c * hold + sign * push * s) / GRAVITY - gamma0
    share = min(_room(base_beta, full_beta, limit), _room(base_gamma, full_gamma, limit))
    out[0] = min(max(base_beta + share * (full_beta - base_beta), -limit), limit)
    out[1] = min(max(base_gamma + share * (full_gamma - base_gamma), -limit), limit)


@njit(**KERNEL)
def passing_time(z, u, held, gap, law, span, scalars, stage, rings, walls, gaps):
    """Time, s, until the ball of z (8,), changed in place, reaches the radius gap[3]. span: horizon, s, steps per tick,
    and tick, s

    The command u (2,) is held for `held` ticks, then the law follows. A ball that has not arrived by the horizon needs
    the remaining distance over ASSUMED_SPEED in addition."""
    horizon, steps, tick = span
    h = tick / steps
    command = u.copy()
    touching = np.bool_(True)
    r = math.hypot(z[0], z[1])
    for k in range(round(horizon / tick)):
        if k >= held:
            law_command(z, gap, law, command)
        for i in range(steps):
            before = r
            stage_step(z, command[0], command[1], stage, h)
            touching = ball_step(z, h, scalars, rings, walls, gaps, touching)
            r = math.hypot(z[0], z[1])
            if gap[2] * (r - gap[3]) >= 0.0:
                part = (gap[3] - before) / (r - before) if gap[2] * (before - gap[3]) < 0.0 else 0.0
                return k * tick + (i + part) * h
    return horizon + abs(r - gap[3]) / ASSUMED_SPEED


@njit(**CALLEE)
def _total(z, u, held, gap, law, starts, most, span, scalars, stage, rings, walls, gaps):
    """Sum of the passing times over the starts; stops early at `most`."""
    total = 0.0
    start = np.empty(8)
    for q in range(starts.shape[0]):
        copy_into(start, z)
        start[0] -= gap[1] * starts[q, 0]
        start[1] += gap[0] * starts[q, 0]
        start[2] -= gap[1] * starts[q, 1]
        start[3] += gap[0] * starts[q, 1]
        total += passing_time(start, u, held, gap, law, span, scalars, stage, rings, walls, gaps)
        if total >= most:
            break
    return total


@njit(**KERNEL)
def _best(z, gap, law, tried, starts, margin, span, scalars, stage, rings, walls, gaps):
    """Index of the best command in `tried`; -1 if the law is to be used."""
    world = scalars, stage, rings, walls, gaps
    low = _total(z, np.zeros(2), 0, gap, law, starts, math.inf, span, *world) - margin * starts.shape[0]
    which = -1
    for j in range(tried.shape[0]):
        for held in HOLD_TICKS:
            total = _total(z, tried[j], held, gap, law, starts, low, span, *world)
            if total < low:
                low, which = total, j
    return which
