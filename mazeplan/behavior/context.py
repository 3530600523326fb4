"""What the leaves of one run share: maze, model, route graph, planners, the state of this tick and the command
given in it.

One context per run. A leaf reads `state`, gives at most one command a tick through `steer`, and reports through
`event` and
`fail`; it knows neither the rig nor the log.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from mazeplan.control.cost import CostParameters
from mazeplan.control.gate import GateOptions
from mazeplan.control.ilqg import RingPlanner
from mazeplan.control.tilt import Plate
from mazeplan.control.tracking import TrackingOptions
from mazeplan.maths.angles import difference
from mazeplan.maze.geometry import Maze, Opening
from mazeplan.maze.graph import RouteGraph
from mazeplan.records import Command, Failure, FailureKind, Plan, State


@dataclass(frozen=True)
class LeafOptions:
    """Settings of the leaves; gains and windows sit with their algorithms.

    cost: of a move along a ring. Its price on tilt rates keeps the plate from being thrown about just before an
    opening,
    where the servo's lag would carry the ball past; without it the 16 standard runs take 0.2 s longer."""

    tracking: TrackingOptions = field(default_factory=TrackingOptions)
    gate: GateOptions = field(default_factory=GateOptions)
    cost: CostParameters = field(default_factory=lambda: CostParameters(rate=0.1, control=0.02))


class TwoCommandsError(AssertionError):
    """Two leaves commanded the rig in one tick: a bug in a tree's leaf, never a user's mistake."""


@dataclass
class RunContext:
    """The shared side of one run. `clock` gives rig time; `on_event(kind, detail)` goes to log and display;
    `ahead(seconds)` is the state that much later if the last command is held."""

    maze: Maze
    graph: RouteGraph
    plate: Plate
    goal: int
    planners: dict[int, RingPlanner]
    ahead: Callable[[float], State]
    on_event: Callable[[str, dict[str, Any]], None]
    options: LeafOptions = field(default_factory=LeafOptions)
    now: float = 0.0
    state: State | None = None
    measured: State | None = None
    command: Command | None = None
    commanded_by: str = ""
    plan: Plan | None = None
    opening: Opening | None = None
    goal_theta: float | None = None
    failures: list[Failure] = field(default_factory=list)
    replans: int = 0
    planner_ms: list[float] = field(default_factory=list)

    def clock(self) -> float:
        """Rig time of this tick, s."""
        return self.now

    def begin(self, now: float, state: State, measured: State) -> None:
        """Start a tick."""
        self.now, self.state, self.measured = now, state, measured
        self.command, self.commanded_by = None, ""

    @property
    def here(self) -> State:
        """The state at which the command of this tick will act."""
        if self.state is None:
            raise RuntimeError("the tree was ticked before the first observation")
        return self.state

    def steer(self, leaf: str, command: Command) -> None:
        """Give the command of this tick; only one leaf may."""
        if self.command is not None:
            raise TwoCommandsError(f"{leaf} and {self.commanded_by} both command the rig at t = {self.now:.3f} s")
        self.command, self.commanded_by = command, leaf

    def failed(self, failure: Failure) -> None:
        """Keep a failure and tell log and display."""
        self.failures.append(failure)
        self.on_event("failure", {"kind": str(failure.kind), "where": failure.where, "detail": failure.detail})

    def recovering(self, recovery: str) -> None:
        """Name the recovery chosen for the last failure."""
        if self.failures:
            last = self.failures[-1]
            self.failures[-1] = Failure(last.kind, last.where, last.t, last.detail, recovery)
        self.on_event("recovery", {"recovery": recovery})

    @property
    def last_failure(self) -> Failure | None:
        """The newest failure, if any."""
        return self.failures[-1] if self.failures else None

    def count(self, kind: FailureKind) -> int:
        """How often this kind of failure has happened in this run."""
        return sum(failure.kind is kind for failure in self.failures)

    def turn_to(self, opening: Opening) -> float:
        """Signed angle from the ball to the opening, rad."""
        return difference(opening.angle, self.here.theta)
