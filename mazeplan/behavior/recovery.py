"""Conditions on what happened, and recoveries. Each recovery is bounded in time and chosen by the kind of failure."""

from __future__ import annotations

import math
from typing import ClassVar

from mazeplan.behavior.mazeleaf import MazeLeaf
from mazeplan.btree.ports import REQUIRED, Port
from mazeplan.btree.status import Status
from mazeplan.core.constants import GRAVITY
from mazeplan.core.records import LEVEL, FailureKind


class BallSeen(MazeLeaf):
    """Whether the ball is seen in the maze, or was until a moment ago."""

    category: ClassVar[str] = "Condition"

    def step(self) -> Status:
        """FAILURE ball_out when it was measured beyond the rim, ball_lost when the estimator gave it up."""
        if self.context.out is not None:
            return self.fail_as(FailureKind.BALL_OUT, self.context.out.message)
        if self.context.here.lost:
            return self.fail_as(FailureKind.BALL_LOST, "not seen for too long")
        return Status.SUCCESS


class InRing(MazeLeaf):
    """Whether the ball is in a ring."""

    category: ClassVar[str] = "Condition"
    ports: ClassVar[dict[str, Port]] = {"ring": Port(int, REQUIRED, "number of the ring", choices="rings")}

    def step(self) -> Status:
        """SUCCESS or FAILURE; not a failure of the run."""
        return Status.SUCCESS if self.context.here.ring == self.get("ring") else Status.FAILURE


class FailureIs(MazeLeaf):
    """Whether the last failure is of one of these kinds, and has not happened too often."""

    category: ClassVar[str] = "Condition"
    ports: ClassVar[dict[str, Port]] = {
        "kinds": Port(list, REQUIRED, "kinds of failure, separated by ;", choices=tuple(map(str, FailureKind))),
        "at_most": Port(int, 1000, "only while no more of its kind have happened on the way to this goal", least=0),
    }

    def step(self) -> Status:
        """SUCCESS or FAILURE; not a failure of the run."""
        last = self.context.last_failure
        if last is None or str(last.kind) not in self.get("kinds"):
            return Status.FAILURE
        return Status.SUCCESS if self.context.count(last.kind) <= self.get("at_most") else Status.FAILURE


class LevelPlate(MazeLeaf):
    """Keep the plate level until the ball is seen in the maze again."""

    ports: ClassVar[dict[str, Port]] = {"timeout_s": Port(float, 5.0, "how long to wait", least=0.0)}

    def start(self) -> None:
        """Name the recovery."""
        self._began = self.context.now
        self.context.recovering("level_plate")

    def step(self) -> Status:
        """SUCCESS once seen; FAILURE when the wait is over."""
        run = self.context
        if not run.here.lost and run.out is None:
            return Status.SUCCESS
        if run.now - self._began >= self.get("timeout_s"):
            return Status.FAILURE
        run.steer(self.name, LEVEL)  # only while it goes on: in the tick in which it ends another leaf commands
        return Status.RUNNING


class Dither(MazeLeaf):
    """Free a ball that stands still: a short circular shake of the plate, growing."""

    ports: ClassVar[dict[str, Port]] = {
        "duration_s": Port(float, 0.5, "how long", least=0.0),
        "amplitude_deg": Port(float, 4.0, "tilt at the end of it", least=0.0, most=90.0),
        "frequency_hz": Port(float, 4.0, "turns per second", least=0.0, most=1e3),
    }

    def start(self) -> None:
        """Name the recovery."""
        self._began = self.context.now
        self.context.recovering("dither")

    def step(self) -> Status:
        """SUCCESS when the time is over."""
        run, duration = self.context, self.get("duration_s")
        since = run.now - self._began
        if since >= duration:
            return Status.SUCCESS
        tilt = math.radians(self.get("amplitude_deg")) * min(1.0, 0.4 + since / duration)
        phase = 2.0 * math.pi * self.get("frequency_hz") * since
        run.steer(self.name, run.plate.clip(tilt * math.cos(phase), tilt * math.sin(phase)))
        return Status.RUNNING


class BackOff(MazeLeaf):
    """Roll a little away from the opening, past it, so that the next attempt comes from the other side."""

    ports: ClassVar[dict[str, Port]] = {
        "duration_s": Port(float, 0.35, "how long", least=0.0),
        "tilt_deg": Port(float, 3.0, "tilt along the ring", least=0.0, most=90.0),
    }

    def start(self) -> None:
        """Choose the direction."""
        run = self.context
        self._began = run.now
        self._turn = 1.0 if run.leg.opening is None or run.turn_to(run.leg.opening) >= 0.0 else -1.0
        run.recovering("back_off")

    def step(self) -> Status:
        """SUCCESS when the time is over."""
        run = self.context
        if run.now - self._began >= self.get("duration_s"):
            return Status.SUCCESS
        theta, pull = run.here.theta, GRAVITY * math.radians(self.get("tilt_deg")) * self._turn
        run.steer(self.name, run.plate.command(-pull * math.sin(theta), pull * math.cos(theta)))
        return Status.RUNNING


class AvoidOpening(MazeLeaf):
    """Make the opening that failed dearer, so that the next route prefers another."""

    ports: ClassVar[dict[str, Port]] = {
        "times": Port(int, 2, "as if it had failed that many times more", least=0, most=1000)
    }

    def step(self) -> Status:
        """SUCCESS always."""
        run = self.context
        run.recovering("avoid_opening")
        if run.leg.opening is not None:
            for _ in range(self.get("times")):
                run.graph.record(run.leg.opening.name, success=False)
        return Status.SUCCESS


class Replan(MazeLeaf):
    """Nothing but a new route from where the ball is."""

    def step(self) -> Status:
        """SUCCESS always."""
        self.context.history.replans += 1
        self.context.recovering("replan")
        return Status.SUCCESS
