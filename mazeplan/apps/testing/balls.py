"""Ball behaviours: where a ball is over time, whatever the plate does. `PlayedRig` is a rig whose ball follows one.

A behaviour has a start, a list of moves, and stretches of time in which the camera does not see the ball. A move is:
rolling along the ring, resting, passing an opening into the next ring inwards or outwards, or jumping to another ring.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mazeplan.core.errors import InputError, RigError
from mazeplan.core.maths.angles import difference, wrap
from mazeplan.core.records import Array, Observation, State
from mazeplan.maze.geometry import Maze

DT = 1.0 / 30.0  # s between samples
FASTEST = 1.0  # m/s; a faster change of place is a jump, not a speed
PASSAGE_S = 0.3  # s from the middle of one ring to the middle of the next


@dataclass(frozen=True)
class Roll:
    """The ball rolls along the ring at an even speed.

    seconds: duration, s
    turn_deg: change of the ball's angle, deg"""

    seconds: float
    turn_deg: float


@dataclass(frozen=True)
class Rest:
    """The ball does not move for some seconds, as if stuck."""

    seconds: float


@dataclass(frozen=True)
class Pass:
    """The ball rolls the short way to an opening of its ring, then through it, inwards or outwards.

    opening: name
    speed_m_s: speed along the ring, m/s"""

    opening: str
    speed_m_s: float = 0.15


@dataclass(frozen=True)
class Jump:
    """The ball jumps at once into any ring, as when a hand moves it or the camera mistakes something else for it."""

    ring: int
    theta_deg: float


Move = Roll | Rest | Pass | Jump


@dataclass(frozen=True)
class BallBehaviour:
    """Where a ball is over time. After the last move the ball rests.

    ring, theta_deg: start
    moves: in order of time
    unseen: times when the ball is not seen, pairs (from, to), s"""

    ring: int = 1
    theta_deg: float = 0.0
    moves: tuple[Move, ...] = ()
    unseen: tuple[tuple[float, float], ...] = ()

    def path(self, maze: Maze) -> Array:
        """Places of the ball at its samples, 1/30 s apart, m, shape (N, 2). Raises InputError for a move that the map
        does not allow."""
        return np.array(_Walk(maze, self).samples)

    def seen(self, t: float) -> bool:
        """Whether the ball is seen at t, s."""
        return not any(start - 1e-9 <= t < end - 1e-9 for start, end in self.unseen)


class _Walk:
    """Turns the moves into places of the ball, one for each sample."""

    def __init__(self, maze: Maze, ball: BallBehaviour) -> None:
        self.maze, self.ring, self.theta = maze, ball.ring, math.radians(ball.theta_deg)
        self.samples: list[tuple[float, float]] = []
        self._stand(1)
        for move in ball.moves:
            self._go(move)

    def _stand(self, n: int) -> None:
        r = self.maze.track_radius(self.ring)
        self.samples += [(r * math.cos(self.theta), r * math.sin(self.theta))] * n

    def _turn(self, angle: float, n: int) -> None:
        for _ in range(n):
            self.theta = wrap(self.theta + angle / n)
            self._stand(1)

    def _go(self, move: Move) -> None:
        match move:
            case Roll(seconds, turn_deg):
                self._turn(math.radians(turn_deg), max(1, round(seconds / DT)))
            case Rest(seconds):
                self._stand(max(1, round(seconds / DT)))
            case Jump(ring, theta_deg):
                self.ring, self.theta = ring, math.radians(theta_deg)
                self._stand(1)
            case Pass(name, speed):
                self._pass(name, speed)

    def _pass(self, name: str, speed: float) -> None:
        known = [opening.name for opening in self.maze.openings_of(self.ring)]
        if name not in known:
            raise InputError(f"got {name!r}, expected one of ring {self.ring}: {', '.join(known)}", key="Pass")
        opening = self.maze.opening(name)
        first, turn = self.maze.track_radius(self.ring), self.maze.turn(self.ring, self.theta, opening.angle)
        turn = difference(opening.angle, self.theta) if turn is None else turn
        if first > 0.0:
            self._turn(turn, max(1, round(abs(turn) * first / max(speed, 1e-3) / DT)))
        self.theta, self.ring = opening.angle, opening.leads_to(self.ring)
        last, n = self.maze.track_radius(self.ring), round(PASSAGE_S / DT)
        for k in range(1, n + 1):
            r = first + (last - first) * k / n
            self.samples.append((r * math.cos(self.theta), r * math.sin(self.theta)))


class PlayedRig:
    """A rig whose ball follows a `BallBehaviour`, whatever the commands are. The plate follows commands at once.

    The rig accepts every command, so that a test can see a command beyond the limits."""

    rate_hz = 1.0 / DT
    realtime = False

    def __init__(
        self, maze: Maze, settings: Mapping[str, Any] | None = None, *, ball: BallBehaviour | None = None
    ) -> None:
        self.maze, self.ball = maze, ball or BallBehaviour()
        self._path = self.ball.path(maze)
        self._k: int | None = None
        self._placed = False

    def reset(self, *, ring: int, theta: float, rng: Any) -> None:
        """Start at time 0, with the ball at the start of its behaviour."""
        self._k, self._u, self._placed = None, (0.0, 0.0), True

    @property
    def ring(self) -> int:
        """The ring that the ball is in."""
        return self.maze.ring_at(float(np.hypot(*self._place())))

    @property
    def theta(self) -> float:
        """Angle of the ball, rad."""
        x, y = self._place()
        return math.atan2(y, x)

    def _place(self) -> Array:
        return self._path[min(self._k or 0, len(self._path) - 1)]

    def observe(self) -> Observation:
        """The next sample."""
        if not self._placed:
            raise RigError("the played rig was used before reset()")
        self._k = 0 if self._k is None else self._k + 1
        t = self._k * DT
        x, y = map(float, self._place()) if self.ball.seen(t) else (None, None)
        return Observation(t, x, y, *self._u)

    def command(self, u_beta: float, u_gamma: float) -> None:
        """Keep the command; the next sample shows it as the tilt of the plate."""
        self._u = (u_beta, u_gamma)

    def level(self) -> None:
        """Level the plate."""
        self._u = (0.0, 0.0)

    def close(self) -> None:
        """Do nothing: there is nothing to release."""


def states(ball: BallBehaviour, maze: Maze, lost_after: float) -> list[State]:
    """The states that an estimator without errors gives for a behaviour, one for each sample.

    lost_after: time without the ball after which it counts as lost, s"""
    path, out = ball.path(maze), []
    last_seen, place, velocity = 0.0, path[0], np.zeros(2)
    for k in range(len(path)):
        t, seen = k * DT, ball.seen(k * DT)
        if seen:
            step = path[max(k, 1)] - path[max(k, 1) - 1] if len(path) > 1 else np.zeros(2)
            velocity = step / DT if math.hypot(step[0], step[1]) < FASTEST * DT else np.zeros(2)  # a jump is no speed
            place, last_seen = path[k], t
        ring = maze.ring_at(float(np.hypot(*place)))
        lost = t - last_seen > lost_after
        (x, y), (vx, vy) = map(float, place), map(float, velocity)
        out.append(State(t, x, y, vx, vy, 0.0, 0.0, 0.0, 0.0, ring, seen, lost))
    return out


def after(state: State, t: float) -> State:
    """The state at time t of a ball that rests where its behaviour left it."""
    return replace(state, t=t, vx=0.0, vy=0.0)
