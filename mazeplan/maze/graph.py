"""Routes through the maze with the shortest expected time, from the map and the memory of openings.

Rings are nodes, openings are edges. The cost of a ring depends on the place of entry, so the search runs over states
(opening, ring entered by it): the directed line graph of the maze. From an opening at the angle
theta_1 to the next one at theta_2 the ball travels s = r |theta_2 - theta_1| along its ring. At best it accelerates for
half of s and brakes for the rest:

    travel = 2 sqrt(s / a) + servo lag,    a = f g sin(tilt limit),   f = 5/9 for a ball that rolls on floor and wall

In a ring with radial walls, |theta_2 - theta_1| is the length of the open way. The ring does not join openings in
different sectors, so a route may leave the ring and come back.

The passage of an opening costs a fixed time, the extra cost in the map, and a fixed loss for every expected attempt
beyond the first. With the probability of success p ~ Beta(A, B), A = prior + successes and B = prior + failures, the
expected number of attempts is E[1/p] = (A + B - 1) / (A - 1). Successes and failures fade with time.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field
from itertools import permutations
from typing import Any

import networkx as nx

from mazeplan.core.constants import GRAVITY
from mazeplan.maze.geometry import Maze, Opening

ROLLING_FACTOR = 5.0 / 9.0  # share of gravity along the ring that accelerates the ball
SERVO_LAG_S = 0.1  # lag of the plate
PASSAGE_S = 0.25  # time through an opening
DISC_S = 0.2  # time across the disc in the centre
RETRY_S = 1.5  # time lost with every failed attempt
PRIOR_SUCCESSES, PRIOR_FAILURES = 3.0, 0.3  # Beta prior of an untried opening; successes > 1, or E[1/p] is infinite
FADING_S = 120.0  # s of rig time in which counts of the memory fall to 1/e
_START, _GOAL = "start", "goal"


@dataclass
class OpeningMemory:
    """Counts of successes and failures by opening, over all goals of a run.

    A failure may be temporary. Therefore the counts decay with rig time by exp(-t / fading_s): recent attempts count
    most, and an opening that is no longer tried returns to the prior.

    fading_s: rig time until counts fall to 1/e, s
    attempts: number of recorded attempts, without fading
    """

    fading_s: float = FADING_S
    _counts: dict[str, tuple[float, float, float]] = field(default_factory=dict)  # successes, failures, when
    attempts: int = field(default=0, compare=False)

    def record(self, name: str, success: bool, now: float) -> None:
        """Record one attempt at an opening at rig time now, s."""
        successes, failures = self.tries(name, now)
        self._counts[name] = (successes + success, failures + (not success), now)
        self.attempts += 1

    def tries(self, name: str, now: float) -> tuple[float, float]:
        """Faded successes and failures of an opening at rig time now, s."""
        successes, failures, when = self._counts.get(name, (0.0, 0.0, now))
        kept = math.exp(-max(now - when, 0.0) / self.fading_s)
        return successes * kept, failures * kept

    def at_end(self, now: float) -> dict[str, tuple[float, float]]:
        """Faded successes and failures of all tried openings at rig time now, s."""
        return {name: self.tries(name, now) for name in self._counts}


@dataclass(frozen=True, slots=True)
class Leg:
    """One ring of a route: the ball turns by `turn_rad` to `opening` and leaves by it, in `expected_s`.

    turn_rad is signed. It is more than half a turn only if radial walls leave no shorter way."""

    ring: int
    opening: Opening
    turn_rad: float
    expected_s: float


@dataclass(frozen=True, slots=True)
class Route:
    """The legs from the start ring to the goal ring, and their expected time in s. No legs: the ball is in the goal
    ring."""

    legs: tuple[Leg, ...]
    expected_s: float

    @property
    def openings(self) -> tuple[str, ...]:
        """Names of the openings, in the order in which they are passed."""
        return tuple(leg.opening.name for leg in self.legs)


@dataclass(frozen=True, slots=True)
class Choice:
    """An opening by which the ball can leave its ring: expected time, s, until the ball is in front of it, and from
    there to the goal."""

    opening: Opening
    travel_s: float
    onward_s: float

    @property
    def expected_s(self) -> float:
        """Expected time to the goal, s."""
        return self.travel_s + self.onward_s


class RouteGraph:
    """The maze as a graph, with the memory of its openings.

    Openings that are closed in the map start closed. The caller sets `now`, the rig time (s) of all answers.
    memory: of the same run towards another goal.
    """

    def __init__(self, maze: Maze, memory: OpeningMemory | None = None) -> None:
        self.maze = maze
        self._closed = {opening.name for opening in maze.openings if opening.closed}
        self.memory = OpeningMemory() if memory is None else memory
        self.now = 0.0
        self._acceleration = ROLLING_FACTOR * GRAVITY * math.sin(maze.tilt_limit)
        self._states = self._line_graph()

    @property
    def closed(self) -> frozenset[str]:
        """Names of the closed openings."""
        return frozenset(self._closed)

    def close(self, name: str) -> None:
        """Exclude an opening from routes. Raises KeyError for an unknown name."""
        self._closed.add(self.maze.opening(name).name)

    def reopen(self, name: str) -> None:
        """Open an opening, even one closed in the map. Raises KeyError for an unknown name."""
        self._closed.discard(self.maze.opening(name).name)

    def record(self, name: str, success: bool) -> None:
        """Record one attempt at an opening. Raises KeyError for an unknown name."""
        self.memory.record(self.maze.opening(name).name, success, self.now)

    def tries(self, name: str) -> tuple[float, float]:
        """Faded successes and failures at an opening. Raises KeyError for an unknown name."""
        return self.memory.tries(self.maze.opening(name).name, self.now)

    def expected_attempts(self, name: str) -> float:
        """Expected number of attempts until the ball passes an opening, at least 1."""
        successes, failures = self.memory.tries(name, self.now)
        a = PRIOR_SUCCESSES + successes
        b = PRIOR_FAILURES + failures
        return (a + b - 1.0) / (a - 1.0)

    def travel_s(self, ring: int, turn_rad: float) -> float:
        """Expected time to turn by an angle in a ring and be at rest there; a constant in the disc."""
        radius = self.maze.track_radius(ring)
        if radius == 0.0:
            return DISC_S
        length = radius * abs(turn_rad)
        return 2.0 * math.sqrt(length / self._acceleration) + SERVO_LAG_S if length > 0.0 else 0.0

    def passage_s(self, name: str) -> float:
        """Expected time, s, to pass an opening when the ball is in front of it. It includes the expected further
        attempts and the extra cost of the map."""
        retries = self.expected_attempts(name) - 1.0
        return PASSAGE_S + retries * RETRY_S + self.maze.opening(name).extra_cost

    def cost(self, name: str, ring: int, theta: float) -> float:
        """Expected time, s, from angle theta in a ring until the ball is through an opening of that ring; infinite if
        radial walls block the way."""
        turn = self.maze.turn(ring, theta, self.maze.opening(name).angle)
        return math.inf if turn is None else self.travel_s(ring, turn) + self.passage_s(name)

    def route(self, start: int, goal: int, theta: float, avoid: Collection[str] = ()) -> Route | None:
        """The fastest route from angle theta in ring `start` to ring `goal`; None if there is none.

        Closed openings and those in `avoid` are not used. Raises IndexError for a ring that the maze does not have,
        ValueError for an angle that is not finite.
        """
        if not math.isfinite(theta):
            raise ValueError(f"theta: got {theta}, expected a finite angle in rad")
        if self.maze.ring(start) == self.maze.ring(goal):
            return Route((), 0.0)
        usable = (opening.name for opening in self.maze.openings if opening.name not in self._closed)
        passages = {name: self.passage_s(name) for name in usable if name not in avoid}

        def weight(_: Any, target: Any, edge: dict[str, Any]) -> float | None:
            """Time of an edge; None hides it. Edges from the start and to the goal exist for every ring."""
            if target == _GOAL:
                return 0.0 if edge["ring"] == goal else None
            opening = edge["opening"]
            if opening.name not in passages:
                return None
            travel = edge["travel_s"]
            if travel is None:
                if edge["ring"] != start:
                    return None
                turn = self.maze.turn(start, theta, opening.angle)
                if turn is None:
                    return None
                travel = self.travel_s(start, turn)
            return travel + passages[opening.name]

        try:
            path = nx.dijkstra_path(self._states, _START, _GOAL, weight=weight)
        except nx.NetworkXNoPath:
            return None
        return self._along(path[1:-1], theta)

    def choices(self, ring: int, goal: int, theta: float) -> list[Choice]:
        """Openings of a ring that lead to the goal, the soonest first. Raises as `route` does."""
        found = []
        for opening in self.maze.openings_of(ring):
            turn = self.maze.turn(ring, theta, opening.angle)
            if opening.name in self._closed or turn is None:
                continue
            onward = self.route(opening.leads_to(ring), goal, opening.angle, avoid=(opening.name,))
            if onward is not None:
                travel = self.travel_s(ring, turn)
                found.append(Choice(opening, travel, self.passage_s(opening.name) + onward.expected_s))
        return sorted(found, key=lambda choice: choice.expected_s)

    def _along(self, states: list[Any], theta: float) -> Route:
        legs: list[Leg] = []
        for name, entered in states:
            opening = self.maze.opening(name)
            ring = opening.leads_to(entered)
            turn = self.maze.turn(ring, theta, opening.angle) or 0.0  # never None on a route
            legs.append(Leg(ring, opening, turn, self.cost(name, ring, theta)))
            theta = opening.angle
        return Route(tuple(legs), sum(leg.expected_s for leg in legs))

    def _line_graph(self) -> nx.DiGraph:
        """The graph of states (opening, ring entered by it). An edge is the way along a ring and through the opening at
        its end."""
        states = nx.DiGraph()
        for opening in self.maze.openings:
            for entered in (opening.inner, opening.outer):
                left, node = opening.leads_to(entered), (opening.name, entered)
                states.add_edge(_START, node, ring=left, opening=opening, travel_s=None)
                states.add_edge(node, _GOAL, ring=entered)
        for ring in range(1, len(self.maze.rings) + 1):
            for a, b in permutations(self.maze.openings_of(ring), 2):
                turn = self.maze.turn(ring, a.angle, b.angle)
                if turn is None:
                    continue
                travel = self.travel_s(ring, turn)
                states.add_edge((a.name, ring), (b.name, b.leads_to(ring)), ring=ring, opening=b, travel_s=travel)
        return states
