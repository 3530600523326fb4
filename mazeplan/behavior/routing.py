"""Leaves that choose the route to the goal ring, and the opening by which the ball leaves its ring.

First the formula of `maze.graph` weighs the openings. Then the planner plans to the openings that are nearly as good as
the best. The time at which the planned ball is in front of the opening replaces the time of the formula. It is better,
because a plan knows the speed of the ball, the tilt of the plate, and the model along the way.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

from mazeplan.behavior.mazeleaf import MazeLeaf
from mazeplan.behavior.travel import arrival_s, plan_to
from mazeplan.btree.ports import REQUIRED, Port
from mazeplan.btree.status import Status
from mazeplan.core.events import OpeningChosen, RoutePlanned
from mazeplan.core.records import FailureKind

if TYPE_CHECKING:
    from mazeplan.maze.graph import Choice

MARGIN = 0.6  # s; no plan is made to an opening that is expected to be later than the best by more than this


class PlanRoute(MazeLeaf):
    """Plan the route to the goal ring from where the ball is."""

    ports: ClassVar[dict[str, Port]] = {
        "goal": Port(int, REQUIRED, "ring to reach", choices="rings"),
        "legs": Port(int, None, "number of openings on the route", "out"),
    }

    def step(self) -> Status:
        """Weigh the openings anew; FAILURE no_route where none leads there."""
        run, here = self.context, self.context.here
        run.heading = goal = self.get("goal")
        route = run.graph.route(here.ring, goal, here.theta)
        if route is None:
            return self.fail_as(FailureKind.NO_ROUTE, f"no way from ring {here.ring} to ring {self.get('goal')}")
        self.set("legs", len(route.legs))
        run.report(RoutePlanned(tuple(leg.opening.name for leg in route.legs), route.expected_s))
        return Status.SUCCESS


class ChooseOpening(MazeLeaf):
    """Choose the opening to leave this ring by: the one by which the goal is soonest, planning to the best of them."""

    ports: ClassVar[dict[str, Port]] = {
        "goal": Port(int, REQUIRED, "ring to reach in the end", choices="rings"),
        "planned_choices": Port(int, None, "openings that are planned to, 1: none; default: of the settings", least=1),
        "opening": Port(str, None, "name of the opening chosen", "out"),
    }

    def step(self) -> Status:
        """SUCCESS with the opening's name; FAILURE no_route."""
        run, here = self.context, self.context.here
        run.heading = goal = self.get("goal")
        choices, run.rerouted = run.graph.choices(here.ring, goal, here.theta), False
        if not choices:
            return self.fail_as(FailureKind.NO_ROUTE, f"no opening leads from ring {here.ring} to the goal")
        choice = self._soonest(choices)
        run.leg.opening, run.leg.leaving_ring = choice.opening, here.ring
        run.leg.refused = None  # a later fall has nothing to do with an earlier opening
        self.set("opening", run.leg.opening.name)
        run.report(OpeningChosen(run.leg.opening.name, round(choice.expected_s, 3)))
        return Status.SUCCESS

    def _soonest(self, choices: list[Choice]) -> Choice:
        """The best by planned time; the plan to it is kept for `PlanInRing`. By the formula alone where only one is in
        question, or nothing is to be planned."""
        run, travel = self.context, self.context.steering.options.travel
        near = [c for c in choices if c.expected_s < choices[0].expected_s + MARGIN]
        near = near[: self.get("planned_choices") or travel.planned_choices]
        if len(near) < 2 or run.here.ring not in run.steering.planners:
            return choices[0]
        timed, plans = [], {}
        for choice in near:
            plan = plans[choice.opening.name] = plan_to(run, choice.opening, plans=len(near))
            if plan.ok:
                timed.append(replace(choice, travel_s=arrival_s(run, choice.opening, plan)))
        if not timed:
            return choices[0]
        best = min(timed, key=lambda c: c.expected_s)
        run.leg.prepared = (best.opening, plans[best.opening.name])
        return best
