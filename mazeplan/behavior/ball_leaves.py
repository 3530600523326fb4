"""Leaves for several balls on one plate: choose the ball to lead, and check that the others stay in the centre.

All other leaves act for the ball that they lead now. A filter changes their commands if a kept ball would leave the
centre (`control.keeping`)."""

from __future__ import annotations

import math
from typing import ClassVar

from py_trees.common import Status

from mazeplan.behavior.mazeleaf import MazeLeaf
from mazeplan.behavior.ports import REQUIRED, Port
from mazeplan.core.records import FailureKind


class ChooseBall(MazeLeaf):
    """Choose the ball to lead: of those outside the goal ring the one that can be there soonest."""

    ports: ClassVar[dict[str, Port]] = {
        "goal": Port(int, REQUIRED, "ring to reach", choices="rings"),
        "ball": Port(int, None, "number of the ball, from 1 on", "out"),
    }

    def step(self) -> Status:
        """SUCCESS with the number; where all are in the goal ring, that of the ball led last. FAILURE no_route."""
        run, goal = self.context, self.get("goal")
        outside = [k for k, view in enumerate(run.balls.views, start=1) if view.measured.ring != goal]
        times = {k: self._expected_s(k, goal) for k in outside}
        soonest = min(times, key=lambda k: times[k], default=run.balls.led)
        if math.isinf(times.get(soonest, 0.0)):
            return self.fail_as(FailureKind.NO_ROUTE, f"no way leads any ball to ring {goal}")
        self.set("ball", soonest)
        return Status.SUCCESS

    def _expected_s(self, ball: int, goal: int) -> float:
        here = self.context.balls.views[ball - 1].state
        route = self.context.graph.route(here.ring, goal, here.theta)
        return math.inf if route is None else route.expected_s


class LeadBall(MazeLeaf):
    """Let all following leaves lead a ball; the others that are in the centre are kept there meanwhile."""

    ports: ClassVar[dict[str, Port]] = {
        "ball": Port(int, REQUIRED, "number of the ball, from 1 on", least=1),
        "centre": Port(int, REQUIRED, "ring in which the others are kept", choices="rings"),
    }

    def step(self) -> Status:
        """SUCCESS."""
        run, ball = self.context, self.get("ball")
        if ball > len(run.balls.views):
            raise self.wrong(f"ball: got {ball}, expected 1 to {len(run.balls.views)}")
        inside = (k for k, view in enumerate(run.balls.views, start=1) if view.measured.ring == self.get("centre"))
        run.lead(ball, frozenset(inside))
        return Status.SUCCESS


class BallsStay(MazeLeaf):
    """Whether all balls that are kept are still in the centre, by what was measured."""

    category: ClassVar[str] = "Condition"
    ports: ClassVar[dict[str, Port]] = {
        "centre": Port(int, REQUIRED, "ring in which balls are kept", choices="rings"),
    }

    def step(self) -> Status:
        """FAILURE left_the_centre for a ball that has left; it is not kept any more."""
        run, centre = self.context, self.get("centre")
        for ball in sorted(run.balls.kept):
            ring = run.balls.views[ball - 1].measured.ring
            if ring != centre:
                run.balls.kept = run.balls.kept - {ball}
                detail = f"ball {ball} left ring {centre} for ring {ring}"
                return self.fail_as(FailureKind.LEFT_THE_CENTRE, detail)
        return Status.SUCCESS
