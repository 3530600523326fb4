"""What is told of a run while it goes on, to log and display, and what is left of it in the end: its result."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mazeplan.behavior.context import RunContext
from mazeplan.behavior.tree import BehaviorTree
from mazeplan.control.tracking import plan_step
from mazeplan.data.runlog import STATUSES, RunDocuments
from mazeplan.display import Display
from mazeplan.goals import SAID
from mazeplan.job import Job
from mazeplan.maths.spread import spread
from mazeplan.maze.memory import OpeningMemory
from mazeplan.parts import passed_by
from mazeplan.records import (
    Command,
    Doubt,
    FailureKind,
    GoalGiven,
    NavigationResult,
    Observation,
    RingPassage,
    Start,
)


class RunRecord:
    """Of one run. log: None where none is kept; segment: number of the uninterrupted stretch, None leaves it out."""

    def __init__(self, log: RunDocuments | None, display: Display, segment: int | None) -> None:
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

    def event(self, t: float, kind: str, detail: dict[str, Any]) -> None:
        """Something that happened at rig time t, s."""
        if kind == "plan":
            if self._log is not None:
                self._log.plan(detail["plan"])
            return
        if kind == "start":
            self._start = Start(detail["ring"], detail["theta"])
        if self._log is not None:
            self._log.event(t, kind, detail)
        if detail.get("kind") == FailureKind.RIG_FAILED:  # whoever made the run is told why, by an error
            if self.began:
                self._display.event(t, str(FailureKind.RIG_FAILED))
        elif kind in ("failure", "recovery"):
            self._display.event(t, ", ".join(str(value) for value in detail.values() if value))
        elif kind == "placed_elsewhere":
            self._display.event(t, f"the ball is not in ring {detail['asked']}, where it was to begin")
        elif detail.get("what") == "rate":
            self._display.event(t, "the rig's samples do not come at the rate_hz that it says")
        elif kind in SAID:
            self._display.event(t, " ".join((kind, *(str(value) for value in detail.values() if value))))

    def in_ring(self, context: RunContext, t: float, ring: int, *, lost: bool = False) -> None:
        """The ring in which the ball is; told where it is another than before, or than it was to begin in. lost: nobody
        knows where it is, so that until it was seen once nothing is told."""
        if ring == self._ring or (lost and self._ring is None):
            return
        if self._ring is not None:
            name = passed_by(context, self._ring, ring)
            self._passages.append(RingPassage(self._ring, t - self._ring_since, name))
            self._display.passed(self._ring, name or "another opening", t)
        elsewhere = self._ring is None and self._start is not None and ring != self._start.ring
        self._ring, self._ring_since = ring, t
        self._display.ring_entered(ring, t)
        self.event(context.now, "ring", {"ring": ring})
        if elsewhere and self._start is not None:
            self.event(context.now, "placed_elsewhere", {"ring": ring, "asked": self._start.ring})

    def tick(
        self, context: RunContext, observation: Observation, command: Command, *, status: str, ms: float,
        cut_off: str | None, doubts: str | None,
    ) -> None:  # fmt: skip
        """A tick is over; ms: how long it took without what is done here."""
        self._tick_ms.append(ms)
        self._display.tick(observation.t, context.here.ring, context.commanded_by)
        if self._log is not None:
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
        """A tree begins."""
        self._statuses = ""
        if self._log is not None:
            self._log.tree(t, *tree.outline())

    def statuses(self, t: float, tree: BehaviorTree) -> None:
        """The tree has been ticked."""
        if self._log is None:
            return
        letters = "".join([STATUSES[name] for name in tree.results()])
        if letters != self._statuses:
            self._statuses = letters
            self._log.statuses(t, letters)

    def openings(self, t: float, memory: OpeningMemory) -> None:
        """What happened at the openings, where that is more than was told."""
        if self._log is None or memory.attempts == self._attempts:
            return
        self._attempts = memory.attempts
        counts = memory.at_end(t)
        if counts:
            self._log.openings(t, counts, memory.fading_s)

    def took(self, ms: float) -> None:
        """How long the last tick took with what was told of it."""
        self._tick_ms[-1] = ms

    def result(
        self, context: RunContext, job: Job, success: bool, reason: str, *, rig: str, log: str | None,
        goals: Sequence[GoalGiven], doubts: Sequence[Doubt],
    ) -> NavigationResult:  # fmt: skip
        """What has happened until now."""
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
            log=log,
            tick_ms=spread(self._tick_ms),
            goals=tuple(goals),
            doubts=tuple(doubts),
            start=self._start,
        )


def _planned_theta(context: RunContext) -> float | None:
    """Where the plan wants the ball at the state's own time, rad, while a plan is followed."""
    if context.plan is None or context.commanded_by != "Track":
        return None
    return float(context.plan.states[plan_step(context.plan, context.here.t), 0])
