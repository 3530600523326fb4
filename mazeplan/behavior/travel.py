"""The way to the next ring: route, choice of the opening, plan along the ring with iLQG, and the plan is followed.

First the formula of `maze.graph` weighs the openings. Then the planner plans to the openings that are nearly as good as
the best. The time at which the planned ball is in front of the opening replaces the time of the formula. It is better,
because a plan knows the speed of the ball, the tilt of the plate, and the model along the way.

The log has an event whenever the law changes that steers the ball along its ring:

    mpc       a plan of this tick. If its deadline stopped the planner, it is the last plan, shifted, and improved as
              far as there was time
    gains     a plan of an earlier tick with its gains, because the new plan failed or this tick made none
    pd        no plan: PD towards the opening
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from mazeplan.behavior.mazeleaf import HeldWatch, MazeLeaf, OpeningLeaf
from mazeplan.btree.ports import REQUIRED, Port
from mazeplan.btree.status import Status
from mazeplan.control.opening import aligned
from mazeplan.control.tilt import finished, follow_gains, off_plan, pd_to_angle
from mazeplan.core.events import OpeningChosen, RoutePlanned
from mazeplan.core.maths.angles import difference, nearest
from mazeplan.core.records import Command, FailureKind, Plan
from mazeplan.maze.geometry import Opening

if TYPE_CHECKING:
    from mazeplan.behavior.context import RunContext
    from mazeplan.maze.graph import Choice

MARGIN = 0.6  # s; no plan is made to an opening that is expected to be later than the best by more than this
USUAL_S = 4.0  # time for a way along a ring, after which its opening counts as missed; ...
LONG_WAY = 2.0  # ... or this many times the expected time of the way, if that is more: wide rings, long detours


def lean_to(run: RunContext, opening: Opening) -> float:
    """Tilt across the ring towards the ring behind the opening, rad, outwards positive."""
    lean_deg, inwards = run.steering.options.travel.lean_deg, opening.leads_to(run.here.ring) == opening.inner
    return math.radians(-lean_deg if inwards else lean_deg)


def arrival_speed(run: RunContext, opening: Opening) -> float:
    """Speed along the ring, m/s, at which the ball should come to an opening.

    The ball keeps this speed in the next ring until the plate answers to what the camera sees there. This takes the
    delay of the samples and the time that the plate needs to follow. In this time the ball may turn by `blind_rad`,
    which is a shorter way in the smaller of the two rings. A speed below `speed_m_s` is of no use: the ball creeps.
    The disc has no openings that a ball could run past; in front of the disc the radius of the outer ring counts."""
    travel, inner = run.steering.options.travel, run.maze.ring(opening.inner)
    radius = run.maze.track_radius(opening.outer if inner.is_disc else opening.inner)
    blind_s = max(run.steering.late_s + run.steering.options.gate.lead_s, 1e-3)
    return max(travel.speed_m_s, min(travel.blind_rad * radius / blind_s, travel.fastest_m_s))


def plan_to(run: RunContext, opening: Opening, *, warm: Plan | None = None, plans: int = 1) -> Plan:
    """A plan from here to the opening, in the ring where the ball is. Reports the plan and keeps its computing time.

    warm: the plan followed until now; plans: number of plans that share the deadline

    The arrival speed has the direction in which the ball turns; the lean points to the ring behind the opening."""
    here = run.here
    turn = run.turn_to(opening)
    if warm is not None:  # a new plan keeps the direction of the old one, also if the ball is half a turn away
        turn = nearest(opening.angle, float(warm.states[-1, 0])) - here.theta
        turn = turn - 2.0 * math.pi * round((turn - run.turn_to(opening)) / (2.0 * math.pi))
    arrival = math.copysign(arrival_speed(run, opening) / run.maze.track_radius(here.ring), turn)
    plan = run.steering.planners[here.ring].plan(
        here.planner_vector(),
        here.theta + turn,
        lean=lean_to(run, opening),
        goal_theta_dot=arrival,
        warm=warm,
        t0=here.t,
        deadline_ms=run.steering.options.travel.deadline_ms / plans,
    )
    run.history.planner_ms.append(plan.ms)
    run.report(plan)
    return plan


def arrival_s(run: RunContext, opening: Opening, plan: Plan) -> float:
    """Time from a plan's start until the ball is in front of the opening and slow enough to be pushed, s.

    If the plan ends before, the expected time from rest for the rest of the way is added."""
    radius, gate = run.maze.track_radius(run.here.ring), run.steering.options.gate
    left = np.array([difference(opening.angle, theta) for theta in plan.states[:, 0]])
    there = np.abs(np.sin(left)) * radius <= 1e-3 * gate.window_mm
    rest = float(left[-1])
    if run.maze.radial_walls_of(run.here.ring):
        rest = float(plan.states[0, 0] + run.turn_to(opening) - plan.states[-1, 0])
    there &= (np.cos(left) > 0.0) & (np.abs(plan.states[:, 1]) * radius <= gate.window_speed_m_s)
    if there.any():
        return float(np.argmax(there)) * plan.dt
    return len(plan.controls) * plan.dt + run.graph.travel_s(run.here.ring, rest)


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


class PlanInRing(OpeningLeaf):
    """Plan the ball's way along its ring to the opening with iLQG, the plate leaning towards the opening's side."""

    ports: ClassVar[dict[str, Port]] = {
        "opening": Port(str, REQUIRED, "name of the opening to arrive at", choices="openings"),
        "plan": Port(str, None, "the plan, for Track", "out"),
    }

    def step(self) -> Status:
        """SUCCESS with a plan, or one that failed, which `Track` does without; FAILURE plan_failed when the state is
        no number, so that nothing can be followed."""
        run, here = self.context, self.context.here
        opening = self.current_opening()
        if run.maze.ring(here.ring).is_disc:  # a disc has no way along: aligning does it all
            self.set("plan", None)
            return Status.SUCCESS
        if (off := self.walled_off(opening)) is not None:
            return off
        prepared, run.leg.prepared = run.leg.prepared, None
        if prepared is not None and prepared[0] == opening and prepared[1].t0 == here.t:
            plan = prepared[1]  # the plan by which the opening was chosen in this tick
        else:
            plan = plan_to(run, opening)
        run.leg.plan, run.leg.goal_theta = plan, opening.angle
        self.set("plan", plan)
        if not (plan.ok or np.isfinite(here.planner_vector()).all()):
            return self.fail_as(FailureKind.PLAN_FAILED, f"the solver stopped: {plan.reason}")
        return Status.SUCCESS


class Track(OpeningLeaf):
    """Follow the plan to the opening; plan again when ball and plan part, or the plan is old."""

    ports: ClassVar[dict[str, Port]] = {
        "opening": Port(str, REQUIRED, "name of the opening to arrive at", choices="openings"),
        "plan": Port(str, REQUIRED, "the plan to follow"),
        "timeout_s": Port(float, USUAL_S, "after that the opening counts as missed; longer on a long way", least=0.0),
    }

    def start(self) -> None:
        """Remember where and when the leaf begins, and how long the way may take."""
        super().start()
        run, self._ticks, self._held = self.context, 0, HeldWatch()
        expected = run.graph.travel_s(self._ring, run.turn_to(self.current_opening()))
        self._most = self.get("timeout_s") + max(0.0, LONG_WAY * expected - USUAL_S)

    def step(self) -> Status:
        """RUNNING on the way, SUCCESS in front of the opening; FAILURE stuck, missed_opening, opening_closed,
        route_changed, fell_back, wrong_ring."""
        run, here = self.context, self.context.here
        opening, plan = self.current_opening(), self.get("plan")
        elsewhere = self.elsewhere(self._ring, opening) or self.walled_off(opening)
        if elsewhere is not None:
            return elsewhere
        if plan is None or aligned(here, opening, run.steering.options.gate):
            return Status.SUCCESS
        rerouted = self.rerouted()
        if rerouted is not None:
            return rerouted
        if run.now - self._began > self._most:
            return self.missed(opening, self._ring, f"not in front of {opening.name} in time")
        if self._still.standing(run.measured):
            return self.fail_as(FailureKind.STUCK, f"standing on the way to {opening.name}")
        plan = self._renewed(plan, opening)
        run.steer(self.name, self._held.command(run, opening) or self._follow(plan, opening))
        run.leg.followed = True
        return Status.RUNNING

    def _renewed(self, plan: Plan, opening: Opening) -> Plan:
        run, options = self.context, self.context.steering.options.tracking
        self._ticks += 1
        over = not plan.ok or finished(plan, run.here.t)
        self._fresh = over or self._ticks % options.replan_every == 0 or off_plan(plan, run.here, options)
        if self._fresh:
            new = plan_to(run, opening, warm=None if over else plan)
            run.leg.plan, run.leg.goal_theta = new, opening.angle
            if new.ok:
                self.set("plan", new)
                return new
            self._fresh = False  # a plan that failed is not followed; the old one still stands
        return plan

    def _follow(self, plan: Plan, opening: Opening) -> Command:
        run, options = self.context, self.context.steering.options.tracking
        if not plan.ok:
            run.log_law("pd")
            radius, lean = run.maze.track_radius(run.here.ring), lean_to(run, opening)
            return pd_to_angle(run.here, run.turn_to(opening), run.plate, options, radius, lean)
        run.log_law("mpc" if self._fresh else "gains")
        return follow_gains(plan, run.here, run.plate)
