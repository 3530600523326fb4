"""Records a run while it goes on, for log and display, and sums it up in the end as a NavigationResult."""

from __future__ import annotations

from collections.abc import Sequence

from mazeplan.behavior.context import RunContext
from mazeplan.behavior.tree import BehaviorTree
from mazeplan.control.tracking import plan_step
from mazeplan.core.display import Display
from mazeplan.core.events import (
    DoubtRaised,
    FailureReported,
    PlacedElsewhere,
    RecoveryChosen,
    Request,
    RingEntered,
    RunEvent,
    TimedEvent,
)
from mazeplan.core.logs.run_log import STATUSES, RunMessages
from mazeplan.core.maths.spread import spread
from mazeplan.core.records import Command, Doubt, GoalGiven, NavigationResult, Observation, Plan, RingPassage, Start
from mazeplan.maze.memory import OpeningMemory
from mazeplan.run.assembly import passed_by
from mazeplan.run.specification import Job


class RunRecorder:
    """Records one run. segment: number of the uninterrupted stretch, for the log; None leaves it out."""

    def __init__(self, log: RunMessages, display: Display, segment: int | None) -> None:
        self._log, self._display, self._segment = log, display, segment
        self._tick_ms: list[float] = []
        self._passages: list[RingPassage] = []
        self._ring: int | None = None
        self._ring_since = 0.0
        self._statuses = ""
        self._start: Start | None = None
        self._attempts = -1

    @property
    def began(self) -> bool:
        """Whether the ball has been seen in a ring."""
        return self._ring is not None

    def event(self, t: float, event: RunEvent | Plan) -> None:
        """Record an event, or a new plan, of rig time t, s."""
        if isinstance(event, Plan):
            self._log.plan(event)
            return
        if isinstance(event, Start):
            self._start = event
        self._log.event(t, event)
        timed = TimedEvent(t, event)
        text = _words(timed)
        if text and (self.began or not timed.rig_failed):  # before that an error tells why
            self._display.event(t, text)

    def in_ring(self, context: RunContext, t: float, ring: int, *, lost: bool = False) -> None:
        """Record the ring of the ball. A new ring is an event, and so is a first ring other than the ring of the start.

        lost: the position of the ball is not known; then the first ring is not recorded yet."""
        if ring == self._ring or (lost and self._ring is None):
            return
        if self._ring is not None:
            name = passed_by(context, self._ring, ring)
            self._passages.append(RingPassage(self._ring, t - self._ring_since, name))
            self._display.passed(self._ring, name or "another opening", t)
        elsewhere = self._ring is None and self._start is not None and ring != self._start.ring
        self._ring, self._ring_since = ring, t
        self._display.ring_entered(ring, t)
        self.event(context.now, RingEntered(ring))
        if elsewhere and self._start is not None:
            self.event(context.now, PlacedElsewhere(ring, self._start.ring))

    def tick(
        self, context: RunContext, observation: Observation, command: Command, *, status: str, ms: float,
        cut_off: str | None, doubts: str | None,
    ) -> None:  # fmt: skip
        """Record a tick; ms: how long it took, without the recording."""
        self._tick_ms.append(ms)
        self._display.tick(observation.t, context.here.ring, context.commanded_by)
        self._log.tick(
            observation,
            command,
            state=context.here,
            status=status,
            leaf=context.commanded_by,
            opening=None if context.opening is None else context.opening.name,
            goal_theta=context.goal_theta,
            planned_theta=_planned_theta(context),
            planner_ms=context.planner_ms[-1] if context.planner_ms else None,
            tick_ms=ms,
            cut_off=cut_off,
            segment=self._segment,
            doubts=doubts,
        )

    def tree(self, t: float, tree: BehaviorTree) -> None:
        """Record a tree that begins."""
        self._statuses = ""
        self._log.tree(t, tree.outline())

    def statuses(self, t: float, tree: BehaviorTree) -> None:
        """Record the statuses of a tree where they changed."""
        letters = "".join([STATUSES[name] for name in tree.results()])
        if letters != self._statuses:
            self._statuses = letters
            self._log.statuses(t, letters)

    def openings(self, t: float, memory: OpeningMemory) -> None:
        """Record the attempts at openings where there are new ones."""
        if memory.attempts == self._attempts:
            return
        self._attempts = memory.attempts
        counts = memory.at_end(t)
        if counts:
            self._log.openings(t, counts, memory.fading_s)

    def took(self, ms: float) -> None:
        """Correct the time of the last tick: with the recording."""
        self._tick_ms[-1] = ms

    def result(
        self, context: RunContext, job: Job, success: bool, reason: str, *, rig: str, goals: Sequence[GoalGiven],
        doubts: Sequence[Doubt],
    ) -> NavigationResult:  # fmt: skip
        """The outcome until now."""
        passages = list(self._passages)
        if self._ring is not None:
            passages.append(RingPassage(self._ring, context.now - self._ring_since, None))
        return NavigationResult(
            success=success,
            reason=reason,
            time_s=round(context.now, 6),
            seed=job.seed,
            rig=rig,
            rings=tuple(passages),
            failures=tuple(context.failures),
            replans=context.replans,
            planner_ms=spread(context.planner_ms),
            log=self._log.path,
            tick_ms=spread(self._tick_ms),
            goals=tuple(goals),
            doubts=tuple(doubts),
            start=self._start,
        )


def _words(timed: TimedEvent) -> str:
    """An event in a line for the display; empty for one that the display does not show."""
    match timed.event:
        case FailureReported(kind, where, detail):
            return kind if timed.error_follows else ", ".join(filter(None, (kind, where, detail)))
        case RecoveryChosen(recovery):
            return recovery
        case PlacedElsewhere(_, asked):
            return f"the ball is not in ring {asked}, where it was to begin"
        case DoubtRaised("rate"):
            return "the rig's samples do not come at the rate_hz that it says"
        case event if isinstance(event, Request):
            return " ".join((timed.kind, *(str(value) for value in timed.detail.values() if value)))
    return ""


def _planned_theta(context: RunContext) -> float | None:
    """The angle that the plan wants at the time of the state, rad, while a plan is followed."""
    if context.plan is None or context.commanded_by != "Track":
        return None
    return float(context.plan.states[plan_step(context.plan, context.here.t), 0])
