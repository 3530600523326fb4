"""Leaves for several balls on one plate: choose the ball to lead, and check that the others stay in the centre.

All other leaves act for the ball that they lead now. A filter changes their commands if a kept ball would leave the
centre (`control.command_chain`)."""

from __future__ import annotations

import math
from typing import ClassVar

from mazeplan.behavior.mazeleaf import MazeLeaf
from mazeplan.btree.ports import REQUIRED, Port
from mazeplan.btree.status import Status
from mazeplan.core.records import FailureKind


class ChooseBall(MazeLeaf):
    """Choose the ball to lead: of those outside the goal ring the one that can be there soonest."""

    ports: ClassVar[dict[str, Port]] = {
        "goal": Port(int, REQUIRED, "ring to reach", choices="rings"),
        "ball": Port(int, None, "number of the ball, from 1 on", "out"),
    }

    def step(self) -> Status:
        """SUCCESS with the number; FAILURE no_route.

        If all seen balls are in the goal ring, the number of a lost ball; without one, that of the ball led last."""
        run, goal, views = self.context, self.get("goal"), self.context.balls.views
        lost = [k for k, view in enumerate(views, start=1) if view.measured.lost]
        outside = [k for k, view in enumerate(views, start=1) if k not in lost and view.measured.ring != goal]
        times = {k: self._expected_s(k, goal) for k in outside}
        others = run.balls.led if run.balls.led in lost or not lost else lost[0]
        soonest = min(times, key=lambda k: times[k], default=others)
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
        """SUCCESS. A lost ball is kept on if it was kept until now; others wait to be found (`BallsStay`)."""
        run, ball = self.context, self.get("ball")
        views = dict(enumerate(run.balls.views, start=1))
        if ball not in views:
            raise self.wrong(f"ball: got {ball}, expected 1 to {len(views)}")
        lost = frozenset(k for k, view in views.items() if view.measured.lost)
        inside = frozenset(k for k, view in views.items() if view.measured.ring == self.get("centre"))
        kept = (inside - lost) | (run.balls.kept & lost)
        run.lead(ball, kept)
        run.balls.sought = lost - kept - {ball}
        return Status.SUCCESS


class BallsStay(MazeLeaf):
    """Whether all balls that are kept are still in the centre, by what was measured."""

    category: ClassVar[str] = "Condition"
    ports: ClassVar[dict[str, Port]] = {
        "centre": Port(int, REQUIRED, "ring in which balls are kept", choices="rings"),
    }

    def step(self) -> Status:
        """FAILURE left_the_centre for a ball that has left; it is not kept any more.

        Nobody knows where a lost ball is, so it counts only when it is found. A ball that was lost when `LeadBall` was
        ticked, and is found in the centre, is kept from then on."""
        balls, centre = self.context.balls, self.get("centre")
        rings = {k: view.measured.ring for k, view in enumerate(balls.views, start=1) if not view.measured.lost}
        found = balls.sought & rings.keys()
        balls.sought, balls.kept = balls.sought - found, balls.kept | {k for k in found if rings[k] == centre}
        for ball in sorted(balls.kept & rings.keys()):
            if rings[ball] != centre:
                balls.kept = balls.kept - {ball}
                detail = f"ball {ball} left ring {centre} for ring {rings[ball]}"
                return self.fail_as(FailureKind.LEFT_THE_CENTRE, detail)
        return Status.SUCCESS
