"""What the leaves of one run share: maze, model, route graph, planners, the state of this tick and the command
given in it.

One context per run. A leaf reads `state`, gives at most one command a tick through `steer`, and reports events and
failures through `report` and `failed`. It knows neither the rig nor the log.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from mazeplan.behavior.blame import CommandError
from mazeplan.behavior.ports import shown
from mazeplan.control.cost import CostParameters
from mazeplan.control.estimation.rim_watch import Out
from mazeplan.control.keeping import Keeper
from mazeplan.control.opening import OpeningOptions
from mazeplan.control.opening_rollout import OpeningRollout, RolloutOptions
from mazeplan.control.policy import Policy
from mazeplan.control.ring_planner import RingPlanner
from mazeplan.control.tilt import Plate
from mazeplan.control.tracking import TrackingOptions
from mazeplan.core.events import FailureReported, LawChanged, OtherEvent, RecoveryChosen, RunEvent
from mazeplan.core.field_checks import check_numbers
from mazeplan.core.maths.angles import difference
from mazeplan.core.records import Command, Failure, FailureKind, Plan, State
from mazeplan.maze.geometry import Maze, Opening
from mazeplan.maze.graph import RouteGraph


@dataclass(frozen=True)
class TravelOptions:
    """lean_deg: tilt towards the next ring on the way to an opening; speed_m_s: along the ring, on arrival, up to
    fastest_m_s where the ball turns by no more than blind_rad before the plate answers to what is seen
    (`arrival_speed`); deadline_ms: that a plan may take; planned_choices: openings that are planned to before one is
    chosen, the deadline shared among them. Raises SettingsError."""

    lean_deg: float = 4.0
    speed_m_s: float = 0.05
    fastest_m_s: float = 0.075
    blind_rad: float = 0.0
    deadline_ms: float = 15.0
    planned_choices: int = 3

    def __post_init__(self) -> None:
        check_numbers(self, positive=("planned_choices",), most={"planned_choices": 50, "deadline_ms": 1e9})


@dataclass(frozen=True)
class SettleOptions:
    """damping: 1/s, braking in the goal ring. Raises SettingsError."""

    damping: float = 6.0

    def __post_init__(self) -> None:
        check_numbers(self)


ENTERING = 0.24  # s that a ball may take from the middle of a wall's opening into the next ring


@dataclass(frozen=True)
class LeafOptions:
    """Settings of the leaves; gains and windows sit with their algorithms. A port given in a tree goes before them."""

    cost: CostParameters = field(default_factory=CostParameters)
    travel: TravelOptions = field(default_factory=TravelOptions)
    gate: OpeningOptions = field(default_factory=OpeningOptions)
    rollout: RolloutOptions = field(default_factory=RolloutOptions)
    tracking: TrackingOptions = field(default_factory=TrackingOptions)
    settle: SettleOptions = field(default_factory=SettleOptions)


class TwoCommandsError(CommandError, AssertionError):
    """The rig was commanded twice in one tick. Out of a leaf it is a TreeError at that leaf's line."""


@dataclass(frozen=True, slots=True)
class BallView:
    """One ball at a tick. state: when the command of the tick will act; measured: when it was seen last."""

    state: State
    measured: State


@dataclass
class RunContext:
    """The shared side of one run. `clock` gives rig time; `report` takes events and plans for log and display;
    `ahead(seconds, beside)` is the state that much later if the last command is held, from beside where the ball is
    (x, y in m) if that is given; `refused`: the opening that did not take
    a ball which was already taken for one in the next ring; `prepared`: a plan by which this opening was chosen; `law`:
    what is followed now; `late_s`: by how much what is seen is older than the moment at which a command acts, s, by the
    model; `rollout`: tries commands before an opening, None: only the law for the opening; `rerouted`: openings
    were closed or opened since the route was planned, so that it is another now; `since`: the first of `failures` that
    belongs to this goal; `left_from`: the ring that is to be left by the opening chosen; `heading`:
    the ring to which the tree has planned its route last, None: it has not; `out`: where the ball is that has left the
    maze, None: it has not; `policy`: a learned
    one, for `FollowPolicy`.

    With several balls, `ball` is the number, from 1 on, of the one that the leaves lead now: `state`, `measured` and
    `ahead` are its own. `views`: each ball; `aheads`: `ahead` of each; `kept`: numbers of those that are to stay in the
    centre meanwhile; `keeper`: changes commands by which one of them would leave it."""

    maze: Maze
    graph: RouteGraph
    plate: Plate
    goal: int
    planners: dict[int, RingPlanner]
    ahead: Callable[..., State]
    report: Callable[[RunEvent | Plan], None]
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
    refused: Opening | None = None
    prepared: tuple[Opening, Plan] | None = None
    law: str = ""
    late_s: float = 0.0
    rollout: OpeningRollout | None = None
    rerouted: bool = False
    since: int = 0
    left_from: int | None = None
    heading: int | None = None
    out: Out | None = None
    policy: Policy | None = None
    ball: int = 1
    views: tuple[BallView, ...] = ()
    aheads: tuple[Callable[..., State], ...] = ()
    kept: frozenset[int] = frozenset()
    keeper: Keeper | None = None
    _entering: tuple[int, int, float] | None = None
    _falling: Opening | None = None

    def carry_on(self, before: RunContext) -> None:
        """Go on where the tree of another goal was cut off: the time, what has happened until now, a ball that falls
        into a ring. Recoveries are chosen by what happens from here on."""
        self.now = self.graph.now = before.now
        self.failures, self.since = before.failures, len(before.failures)
        self.replans, self.planner_ms, self.law = before.replans, before.planner_ms, before.law
        self.refused, self._entering, self._falling = before.refused, before._entering, before._falling

    def edit(self, closed: Mapping[str, bool]) -> None:
        """Close (True) or open openings while the run goes on; where that makes the route another, it is `rerouted`."""
        before = self._openings_ahead()
        for name, shut in closed.items():
            (self.graph.close if shut else self.graph.reopen)(name)
        self.rerouted = self.rerouted or before != self._openings_ahead()

    def _openings_ahead(self) -> tuple[str, ...] | None:
        """Those of the route from here; None where there is none, or nobody knows yet where the ball is."""
        if self.state is None or not math.isfinite(self.state.theta):
            return None
        route = self.graph.route(self.state.ring, self.target, self.state.theta)
        return None if route is None else route.openings

    @property
    def target(self) -> int:
        """The ring on the way to which the tree is: that of its last route, before the first one that of the run."""
        return self.goal if self.heading is None else self.heading

    def clock(self) -> float:
        """Rig time of this tick, s."""
        return self.now

    def begin(
        self, now: float, state: State, measured: State, out: Out | None = None, others: tuple[BallView, ...] = ()
    ) -> None:
        """Start a tick. state, measured: of the first ball."""
        self.now = self.graph.now = now
        self.views = (BallView(state, measured), *others)
        led = self.views[self.ball - 1]
        self.state, self.measured, self.out = self._entered(led.state), led.measured, out
        self.command, self.commanded_by = None, ""

    def lead(self, ball: int, kept: frozenset[int]) -> None:
        """From now on the leaves lead another ball, of this number, while those of `kept` stay in the centre."""
        self.kept = kept - {ball}
        if ball == self.ball:
            return
        self.ball, self.ahead = ball, self.aheads[ball - 1]
        self._entering = self._falling = self.refused = self.prepared = self.plan = self.opening = None
        self.goal_theta = self.left_from = None
        self.state, self.measured = self.views[ball - 1].state, self.views[ball - 1].measured

    def again(self) -> None:
        """The tree is ticked once more in this tick: what leaves commanded so far stands, but any of them may command
        anew."""
        self.commanded_by = ""

    def enter(self, target: int) -> None:
        """For ENTERING s from now on take the ball for one in ring `target`, which it is falling into."""
        self._entering, self._falling = (self.here.ring, target, self.now + ENTERING), self.opening

    def _entered(self, state: State) -> State:
        if self._entering is None:
            return state
        source, target, until = self._entering
        if state.ring == target:
            self._falling = None
        if self.now > until:
            self._entering = None
            if self._falling is not None:  # it never came
                self.refused, self.opening, self._falling = self._falling, self._falling, None
                self.graph.record(self.refused.name, success=False)
        elif state.ring == source and self._before(target, state):  # not there yet, or the prediction wavers
            return replace(state, ring=target)
        return state

    def _before(self, target: int, state: State) -> bool:
        """Whether the ball is where it comes into the sector of ring `target` into which it is falling."""
        falling = self._falling
        return falling is None or self.maze.turn(target, state.theta, falling.angle) is not None

    @property
    def here(self) -> State:
        """The state at which the command of this tick will act."""
        if self.state is None:
            raise RuntimeError("the tree was ticked before the first observation")
        return self.state

    def steer(self, leaf: str, command: Command) -> None:
        """Give the command of this tick; only one leaf may. Raises CommandError, out of a leaf TreeError at its line,
        for a second one, and for one that is not of finite numbers."""
        if not isinstance(command, Command):
            raise CommandError(f"command: got {shown(command)}, expected a Command")
        if not (math.isfinite(command.u_beta) and math.isfinite(command.u_gamma)):
            got = f"u_beta = {command.u_beta}, u_gamma = {command.u_gamma}"
            raise CommandError(f"command: got {got}, expected finite numbers, rad")
        if self.commanded_by:
            both = f"{leaf} and {self.commanded_by} both command the rig"
            raise TwoCommandsError(f"{both} at t = {self.now:.3f} s, expected one of them")
        if self.kept and self.keeper is not None:
            command = self.keeper.command(command, [self.views[k - 1].state for k in sorted(self.kept)], self.here)
        self.command, self.commanded_by = command, leaf

    def on_event(self, kind: str, detail: Mapping[str, Any]) -> None:
        """Write an event of your own to the log; detail: plain data."""
        self.report(OtherEvent(kind, detail))

    def follow(self, law: str) -> None:
        """Tell the log by what the ball is brought along its ring, when that changes: mpc, gains or pd."""
        if law != self.law:
            self.law = law
            self.report(LawChanged(law))

    def failed(self, failure: Failure) -> None:
        """Keep a failure, with the place of the ball, and tell log and display."""
        seen = self.measured
        place = self.out or (None if seen is None or seen.lost or not math.isfinite(seen.r) else seen)
        if place is not None:
            failure = replace(failure, x=round(place.x, 6), y=round(place.y, 6))
        self.failures.append(failure)
        self.report(FailureReported(str(failure.kind), failure.where, failure.detail))

    def recovering(self, recovery: str) -> None:
        """Name the recovery chosen for the last failure."""
        last = self.last_failure
        if last is not None:
            self.failures[-1] = replace(last, recovery=recovery)
        self.report(RecoveryChosen(recovery))

    @property
    def last_failure(self) -> Failure | None:
        """The newest failure on the way to this goal, if any."""
        return self.failures[-1] if len(self.failures) > self.since else None

    def count(self, kind: FailureKind) -> int:
        """How often this kind of failure has happened on the way to this goal."""
        return sum(failure.kind is kind for failure in self.failures[self.since :])

    def turn_to(self, opening: Opening, ball: State | None = None) -> float:
        """Signed angle from a ball, by default the one that is led, to the opening, rad, by the way that radial walls
        leave."""
        here = self.here if ball is None else ball
        turn = self.maze.turn(here.ring, here.theta, opening.angle)
        return difference(opening.angle, here.theta) if turn is None else turn
