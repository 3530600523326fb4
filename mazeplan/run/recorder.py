"""Records a run for log and display while it goes on, and makes its NavigationResult."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from weakref import WeakMethod

from mazeplan.behavior.context import RunContext
from mazeplan.btree.blame import blame_no_node
from mazeplan.btree.tree import BehaviorTree
from mazeplan.control.tilt import plan_step
from mazeplan.core.events import (
    DoubtRaised,
    FailureReported,
    MisfitSeen,
    OtherEntered,
    PlacedElsewhere,
    RecoveryChosen,
    Request,
    RingEntered,
    RunEvent,
    TimedEvent,
)
from mazeplan.core.logs.run_log import STATUSES, RunMessages
from mazeplan.core.progress import Display
from mazeplan.core.records import (
    Command,
    Doubt,
    GoalGiven,
    Misfit,
    NavigationResult,
    Observation,
    OtherBall,
    Plan,
    RingPassage,
    Start,
    State,
    TreeOutline,
    spread,
)
from mazeplan.maze.graph import OpeningMemory
from mazeplan.run.specification import Job


class RunRecorder:
    """Records one run. segment: number of the uninterrupted stretch, for the log; None leaves it out."""

    def __init__(self, log: RunMessages, display: Display, segment: int | None) -> None:
        self._log = log
        self._display = display
        self._segment = segment
        self._tick_ms: list[float] = []
        self._histories: dict[int, _RingHistory] = {1: _RingHistory()}  # by the ball's number
        self._statuses = ""
        self._start: Start | None = None
        self._attempts = -1

    @property
    def began(self) -> bool:
        """Whether the ball has been seen in a ring."""
        return self._histories[1].ring is not None

    def event(self, t: float, event: RunEvent | Plan) -> None:
        """Record an event or a new plan at rig time t, s."""
        if isinstance(event, Plan):
            self._log.plan(event)
            return
        if isinstance(event, Start):
            self._start = event
        self._log.event(t, event)
        timed = TimedEvent(t, event)
        text = _words(timed)
        if text and (self.began or not timed.error_follows):  # a rig that fails earlier raises an error that says why
            self._display.event(t, text)

    def in_ring(self, context: RunContext, t: float) -> None:
        """Record the ring of each ball. A change of ring is an event. It is also an event if ball 1 is first seen in
        another ring than the start ring.

        The first ring of a lost ball is not recorded until the ball is found."""
        for ball, view in enumerate(context.balls.views, start=1):
            way, ring = self._histories.setdefault(ball, _RingHistory()), view.state.ring
            if ring == way.ring or (view.state.lost and way.ring is None):
                continue
            elsewhere = way.ring is None and self._start is not None and ring != self._start.ring
            if way.ring is not None:
                name = _passed_by(context, way.ring, ring, None if ball == context.balls.led else view.state)
                way.passages.append(RingPassage(way.ring, t - way.since, name))
            if ball > 1:
                self.event(context.now, OtherEntered(ball, ring))
            else:
                self._first_in(context, t, ring, None if way.ring is None else way.passages[-1])
            way.ring = ring
            way.since = t
            if elsewhere and ball == 1 and self._start is not None:
                self.event(context.now, PlacedElsewhere(ring, self._start.ring))

    def _first_in(self, context: RunContext, t: float, ring: int, left: RingPassage | None) -> None:
        """Record that ball 1 is in another ring. left: its passage through the ring before; None at the first ring."""
        if left is not None:
            self._display.passed(left.ring, left.opening or "another opening", t)
        self._display.ring_entered(ring, t)
        self._histories[1].ring = ring  # before the event, which is shown once the ball was seen
        self.event(context.now, RingEntered(ring))

    def tick(
        self, context: RunContext, observation: Observation, command: Command, *, status: str, ms: float,
        cut_off: str | None, doubts: str | None,
    ) -> None:  # fmt: skip
        """Record a tick. State and plan are those of ball 1: while the leaves lead another ball, the tick has no plan.

        status: of the tree
        ms: duration of the tick without this recording
        cut_off: searches that a deadline ended, as `Stopwatch.pop_cuts` gives them
        doubts: words of `records.Doubt` for this sample
        """
        self._tick_ms.append(ms)
        led = context.balls.led == 1
        first = context.here if led else context.balls.views[0].state
        plan, planned = context.leg.plan, None
        if led and plan is not None and context.leg.followed:  # the angle of the plan at the time of the state
            planned = float(plan.states[plan_step(plan, context.here.t), 0])
        self._display.tick(observation.t, first.ring, context.commanded_by)
        self._log.tick(
            observation,
            command,
            state=first,
            status=status,
            leaf=context.commanded_by,
            opening=None if context.leg.opening is None else context.leg.opening.name,
            goal_theta=context.leg.goal_theta if led else None,
            planned_theta=planned,
            planner_ms=context.history.planner_ms[-1] if context.history.planner_ms else None,
            tick_ms=ms,
            cut_off=cut_off,
            segment=self._segment,
            doubts=doubts,
            **_others(context, observation),
        )

    def tree(self, t: float, tree: BehaviorTree) -> None:
        """Record a tree that begins."""
        self._statuses = ""
        self._log.tree(t, TreeOutline(**tree.outline()))

    def statuses(self, t: float, tree: BehaviorTree) -> None:
        """Record the statuses of a tree if they have changed."""
        letters = "".join([STATUSES[node.last.name] for node in tree.nodes()])
        if letters != self._statuses:
            self._statuses = letters
            self._log.statuses(t, letters)

    def openings(self, t: float, memory: OpeningMemory) -> None:
        """Record the attempts at openings if there are new ones."""
        if memory.attempts == self._attempts:
            return
        self._attempts = memory.attempts
        counts = memory.at_end(t)
        if counts:
            self._log.openings(t, counts, memory.fading_s)

    def set_tick_duration(self, ms: float) -> None:
        """Set the duration of the last tick to `ms`, which includes the recording."""
        self._tick_ms[-1] = ms

    def result(
        self, context: RunContext, job: Job, success: bool, reason: str, *, rig: str, goals: Sequence[GoalGiven],
        doubts: Sequence[Doubt], misfits: Sequence[Misfit] = (),
    ) -> NavigationResult:  # fmt: skip
        """The result of the run until now."""
        ways = {ball: way.until(context.now) for ball, way in self._histories.items()}
        return NavigationResult(
            success=success,
            reason=reason,
            time_s=round(context.now, 6),
            seed=job.seed,
            rig=rig,
            rings=ways[1],
            failures=tuple(context.history.failures),
            replans=context.history.replans,
            planner_ms=spread(context.history.planner_ms),
            log=self._log.path,
            tick_ms=spread(self._tick_ms),
            goals=tuple(goals),
            doubts=tuple(doubts),
            start=self._start,
            others=tuple(OtherBall(ball, rings) for ball, rings in ways.items() if ball > 1),
            misfits=tuple(misfits),
        )


def _passed_by(run: RunContext, before: int, ring: int, ball: State | None = None) -> str | None:
    """Name of the opening by which a ball changed from ring `before` to `ring`; None if no opening joins the two rings.

    The nearest opening that joins them counts. ball: None: the ball that the leaves lead."""
    joining = [o for o in run.maze.openings if {o.outer, o.inner} == {before, ring}]
    nearest = min(joining, key=lambda o: abs(run.turn_to(o, ball)), default=None)
    return None if nearest is None else nearest.name


@dataclass
class _RingHistory:
    """The rings of one ball: the passages through rings that it left, and the ring where it is since rig time `since`,
    s."""

    passages: list[RingPassage] = field(default_factory=list)
    ring: int | None = None
    since: float = 0.0

    def until(self, now: float) -> tuple[RingPassage, ...]:
        last = [] if self.ring is None else [RingPassage(self.ring, now - self.since, None)]
        return (*self.passages, *last)


def _others(context: RunContext, observation: Observation) -> dict[str, float | int | None]:
    """Columns of a tick with several balls: number of the ball that the leaves lead; for each ball after the first its
    ring, and where it was measured and estimated."""
    if not observation.others:
        return {}
    columns: dict[str, float | int | None] = {"ball": context.balls.led}
    for k, (sample, view) in enumerate(zip(observation.others, context.balls.views[1:], strict=True), start=2):
        columns |= {f"x{k}": sample.x, f"y{k}": sample.y, f"ring{k}": view.state.ring}
        columns |= {f"estimate_x{k}": view.state.x, f"estimate_y{k}": view.state.y}
    return columns


def _words(timed: TimedEvent) -> str:
    match timed.event:
        case FailureReported(kind, where, detail):
            return kind if timed.error_follows else ", ".join(filter(None, (kind, where, detail)))
        case RecoveryChosen(recovery):
            return recovery
        case OtherEntered(ball, ring):
            return f"ball {ball} is in ring {ring}"
        case PlacedElsewhere(_, asked):
            return f"the ball is not in ring {asked}, where it was to begin"
        case MisfitSeen(words, adopted):
            return f"{words}; the run goes on with this" if adopted else words
        case DoubtRaised("rate"):
            return "the rig's samples do not come at the rate_hz that it says"
        case event if isinstance(event, Request):
            return " ".join((timed.kind, *(str(value) for value in timed.detail.values() if value)))
    return ""


def weak_reporter(report: WeakMethod[Callable[[RunEvent | Plan], None]]) -> Callable[[RunEvent | Plan], None]:
    """A function that passes a tree's reports on to its run. It refers to the run weakly: else run and tree would keep
    each other, and the rig with them. After the run is gone it does nothing."""

    def passed_on(event: RunEvent | Plan) -> None:
        to = report()
        if to is not None:
            with blame_no_node():
                to(event)

    return passed_on
