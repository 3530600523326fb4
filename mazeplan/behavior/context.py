"""What the leaves of one run share: maze, model, route graph, planners, the state of this tick and its command.

There is one context for each tree of a run. A leaf reads `state`, gives at most one command a tick through `steer`, and
reports events and failures through `report` and `failed`. It knows neither the rig nor the log.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from mazeplan.behavior.current_leg import CurrentLeg
from mazeplan.behavior.trees import choices_of
from mazeplan.btree.blame import CommandError
from mazeplan.btree.ports import shown
from mazeplan.control.cost import CostParameters
from mazeplan.control.estimation.sample_check import Out
from mazeplan.control.opening import OpeningOptions
from mazeplan.control.opening_rollout import OpeningRollout, RolloutOptions
from mazeplan.control.policy import Policy
from mazeplan.control.ring_planner import RingPlanner
from mazeplan.control.tilt import Plate, TrackingOptions
from mazeplan.core.events import FailureReported, LawChanged, OtherEvent, RecoveryChosen, RunEvent
from mazeplan.core.field_checks import check_numbers
from mazeplan.core.maths.angles import difference
from mazeplan.core.records import Command, Failure, FailureKind, Plan, State
from mazeplan.maze.geometry import Maze, Opening
from mazeplan.maze.graph import RouteGraph
from mazeplan.physics.rig.stage import StageModel

USUAL_LAG = StageModel().lag  # s
SAME = 0.004  # s; lag of the servos on which `gate.lead_s` and `gate.entry_s` were set: as the usual one within this
ENTRY = 1.4  # of the change of the lag; set in trials on seven rigs whose servos follow at once


@dataclass(frozen=True)
class TravelOptions:
    """How the ball travels along a ring to an opening. Raises SettingsError."""

    lean_deg: float  # tilt towards the next ring on the way
    speed_m_s: float  # along the ring on arrival
    fastest_m_s: float  # highest speed on arrival, used if the delay is short (`arrival_speed`)
    blind_rad: float  # turn of the ball during the delay, before the plate answers to what the camera sees
    deadline_ms: float  # time that a plan may take
    horizon: int  # length of a plan, ticks
    planned_choices: int  # openings to which plans are made before one is chosen; they share the deadline

    def __post_init__(self) -> None:
        most = {"planned_choices": 50, "deadline_ms": 1e9, "horizon": 1000}
        check_numbers(self, positive=("planned_choices", "horizon"), most=most)


@dataclass(frozen=True)
class SettleOptions:
    """How the ball comes to rest in the goal ring. Raises SettingsError."""

    damping: float  # 1/s

    def __post_init__(self) -> None:
        check_numbers(self)


@dataclass(frozen=True)
class LeafOptions:
    """Settings of the leaves; the option classes are defined beside their algorithms, and have no defaults: the numbers
    stand in `run/settings.yaml`. A port in a tree overrides its setting."""

    cost: CostParameters
    travel: TravelOptions
    gate: OpeningOptions
    rollout: RolloutOptions
    tracking: TrackingOptions
    settle: SettleOptions

    def on_stage(self, stage: StageModel) -> LeafOptions:
        """The options for this stage. A servo with less lag than the usual one has less of `gate.lead_s` and
        `gate.entry_s`: commands of the next move would hold a ball back that is not in yet."""
        more = stage.lag - USUAL_LAG
        if more > -SAME:
            return self
        lead, entry = max(self.gate.lead_s + more, 0.0), max(self.gate.entry_s + ENTRY * more, 0.0)
        return replace(self, gate=replace(self.gate, lead_s=lead, entry_s=entry))


@dataclass(frozen=True, slots=True)
class BallView:
    """One ball at a tick."""

    state: State  # estimate for the time when the command of the tick will act
    measured: State  # estimate for the time of the last sample with the ball


@dataclass
class BallRoles:
    """All balls of a run by their numbers, from 1 on, and which of them the leaves lead now."""

    aheads: tuple[Callable[..., State], ...] = ()  # for each ball, its `RunContext.ahead`
    views: tuple[BallView, ...] = ()  # each ball at this tick
    led: int = 1  # the ball that the leaves lead; `state`, `measured` and `ahead` of the context belong to it
    kept: frozenset[int] = frozenset()  # balls that must stay in the centre meanwhile
    sought: frozenset[int] = frozenset()  # balls lost when `led` was chosen: those found in the centre are kept, too


@dataclass
class RunHistory:
    """What has happened so far in a run."""

    failures: list[Failure] = field(default_factory=list)  # all, oldest first
    since: int = 0  # index of the first failure on the way to this goal
    replans: int = 0  # recoveries by planning again
    planner_ms: list[float] = field(default_factory=list)  # computing time of each plan, ms


@dataclass(frozen=True)
class Steering:
    """What steers by the model. A run replaces it if the rig shows another stage."""

    planners: Mapping[int, RingPlanner]  # for each channel, by ring
    options: LeafOptions
    late_s: float = 0.0  # from a sample until a command computed from it acts, as the model states
    rollout: OpeningRollout | None = None  # tries commands in front of an opening; None: only the law for openings


@dataclass
class RunContext:
    """What the leaves of one tree share. `clock` gives rig time.

    ahead: `ahead(seconds, beside)` predicts the state if the last command is held; beside: shift of the ball, (x, y) m
    report: takes events and plans for log and display
    policy: a learned policy, for `FollowPolicy`
    balls: all balls; most runs have one
    now: rig time of this tick, s
    state: the estimate for the time when the command of this tick will act
    measured: the estimate when the ball was seen last
    out: a ball that has left the maze, and where it is; None: none has
    leg: the way out of the ball's ring by one opening
    history: failures and counts
    heading: the ring to which the tree planned its last route; None: no route yet
    rerouted: whether closed or opened openings have changed the route since it was planned
    law: the law that steers along a ring now
    """

    maze: Maze
    graph: RouteGraph
    plate: Plate
    goal: int
    steering: Steering
    ahead: Callable[..., State]
    report: Callable[[RunEvent | Plan], None]
    policy: Policy | None = None
    balls: BallRoles = field(default_factory=BallRoles)
    now: float = 0.0
    state: State | None = None
    measured: State | None = None
    out: Out | None = None
    command: Command | None = None
    commanded_by: str = ""
    leg: CurrentLeg = field(default_factory=CurrentLeg)
    history: RunHistory = field(default_factory=RunHistory)
    heading: int | None = None
    rerouted: bool = False
    law: str = ""

    def carry_on(self, before: RunContext) -> None:
        """Go on where the tree of another goal stopped: keep its time, its failures and counts, and the led ball's fall
        into a ring, if this tree leads the same ball. Only failures from now on affect the choice of recoveries."""
        self.now = self.graph.now = before.now
        self.history, self.history.since = before.history, len(before.history.failures)
        self.leg = before.leg.passage() if before.balls.led == self.balls.led else CurrentLeg()
        self.law = before.law

    def edit(self, closed: Mapping[str, bool]) -> None:
        """Close (True) or open (False) openings while the run goes on. Sets `rerouted` if this changes the route."""
        before = self._openings_ahead()
        for name, shut in closed.items():
            (self.graph.close if shut else self.graph.reopen)(name)
        self.rerouted = self.rerouted or before != self._openings_ahead()

    def _openings_ahead(self) -> tuple[str, ...] | None:
        """Openings of the route from here; None if there is no route, or the position of the ball is unknown."""
        if self.state is None or not math.isfinite(self.state.theta):
            return None
        route = self.graph.route(self.state.ring, self.target, self.state.theta)
        return None if route is None else route.openings

    @property
    def target(self) -> int:
        """The ring to which the tree is on its way: the goal of its last route; before the first route that of the
        run."""
        return self.goal if self.heading is None else self.heading

    def choices(self, name: str) -> tuple[Any, ...]:
        """The values of a port with these choices (`trees.choices_of`)."""
        return choices_of(self.maze, name)

    def clock(self) -> float:
        """Rig time of this tick, s."""
        return self.now

    def begin(
        self, now: float, state: State, measured: State, out: Out | None = None, others: tuple[BallView, ...] = ()
    ) -> None:
        """Start a tick. state, measured: of the first ball."""
        self.now = self.graph.now = now
        self.balls.views = (BallView(state, measured), *others)
        led = self.balls.views[self.balls.led - 1]
        self.state, self.measured, self.out = self.leg.entered(led.state, now, self.maze, self.graph), led.measured, out
        self.command, self.commanded_by, self.leg.followed = None, "", False
        self.leg.approach(led.measured, self.maze)

    def lead(self, ball: int, kept: frozenset[int]) -> None:
        """From now on the leaves lead the ball with this number. The balls in `kept` must stay in the centre."""
        self.balls.kept = kept - {ball}
        if ball == self.balls.led:
            return
        self.balls.led, self.ahead, self.leg = ball, self.balls.aheads[ball - 1], CurrentLeg()
        self.state, self.measured = self.balls.views[ball - 1].state, self.balls.views[ball - 1].measured

    @property
    def here(self) -> State:
        """The state at which the command of this tick will act."""
        if self.state is None:
            raise RuntimeError("the tree was ticked before the first observation")
        return self.state

    def steer(self, leaf: str, command: Command) -> None:
        """Give the command of this tick. Only one leaf may do so.

        Raises CommandError for a second command, and for numbers that are not finite. If a leaf raises it, it becomes a
        TreeError at the leaf's line."""
        if not isinstance(command, Command):
            raise CommandError(f"command: got {shown(command)}, expected a Command")
        if not (math.isfinite(command.u_beta) and math.isfinite(command.u_gamma)):
            got = f"u_beta = {command.u_beta}, u_gamma = {command.u_gamma}"
            raise CommandError(f"command: got {got}, expected finite numbers, rad")
        if self.commanded_by:
            both = f"{leaf} and {self.commanded_by} both command the rig"
            raise CommandError(f"{both} at t = {self.now:.3f} s, expected one of them")
        self.command, self.commanded_by = command, leaf

    def on_event(self, kind: str, detail: Mapping[str, Any]) -> None:
        """Write an event of your own to the log; detail: plain data."""
        self.report(OtherEvent(kind, detail))

    def log_law(self, law: str) -> None:
        """Log the law that steers the ball along its ring, if it has changed (`events.LawChanged`)."""
        if law != self.law:
            self.law = law
            self.report(LawChanged(law))

    def failed(self, failure: Failure) -> None:
        """Keep a failure with the place of the ball, and report it to log and display."""
        seen = self.measured
        place = self.out or (None if seen is None or seen.lost or not math.isfinite(seen.r) else seen)
        if place is not None:
            failure = replace(failure, x=round(place.x, 6), y=round(place.y, 6))
        self.history.failures.append(failure)
        self.report(FailureReported(str(failure.kind), failure.where, failure.words))

    def recovering(self, recovery: str) -> None:
        """Name the recovery chosen for the last failure."""
        last = self.last_failure
        if last is not None:
            self.history.failures[-1] = replace(last, recovery=recovery)
        self.report(RecoveryChosen(recovery))

    @property
    def last_failure(self) -> Failure | None:
        """The newest failure on the way to this goal, if any."""
        history = self.history
        return history.failures[-1] if len(history.failures) > history.since else None

    def count(self, kind: FailureKind | str) -> int:
        """How often this kind of failure has happened on the way to this goal."""
        return sum(failure.kind == kind for failure in self.history.failures[self.history.since :])

    def turn_to(self, opening: Opening, ball: State | None = None) -> float:
        """Signed angle from a ball to the opening, rad, along the way that radial walls leave.

        ball: None: the ball that the leaves lead"""
        here = self.here if ball is None else ball
        turn = self.maze.turn(here.ring, here.theta, opening.angle)
        return difference(opening.angle, here.theta) if turn is None else turn
