"""The leaves that move the ball: choose an opening, plan in the ring, track, align, pass, confirm, settle.

Each looks at the state at which its command will act, gives at most one command a tick, never blocks, and leaves a
`records.Failure` of a named kind where it fails. Conditions and recoveries are in `recovery`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar

from py_trees.common import Status

from mazeplan.behavior.context import RunContext, TravelOptions
from mazeplan.behavior.leaf import REQUIRED, Leaf, Port
from mazeplan.control.gate import aligned, gate_command
from mazeplan.control.tracking import finished, follow_gains, follow_pd, off_plan
from mazeplan.errors import SettingsError
from mazeplan.maths.angles import nearest
from mazeplan.maze.geometry import Opening
from mazeplan.records import Command, Failure, FailureKind, Plan, State

STILL_RADIUS = 2.5e-3  # m; five times the noise of a camera sample
STILL_AFTER = 0.6  # s of standing away from where it should be before it counts as stuck
LOST_TRACK = 2.5  # rad; turn to the opening beyond which aligning makes no sense


class MazeLeaf(Leaf):
    """A leaf of a run: typed access to its context, and failures with a kind."""

    context: RunContext

    def fail_as(self, kind: FailureKind, detail: str) -> Status:
        """Leave a failure of this kind and return FAILURE."""
        run = self.context
        return self.fail(Failure(kind, self.name, run.now, detail))

    def current_opening(self) -> Opening:
        """The opening named by the port `opening`."""
        return self.context.maze.opening(self.get("opening"))

    def strayed(self, start: int, target: int) -> Status | None:
        """SUCCESS if the ball is in the target ring already, FAILURE if in a third one, None if still in the first."""
        ring = self.context.here.ring
        if ring == start:
            return None
        if ring == target:
            return Status.SUCCESS
        refused, self.context.refused = self.context.refused, None
        if refused is not None:
            return self.fail_as(FailureKind.MISSED_OPENING, f"{refused.name} did not take the ball")
        back = abs(ring - target) > abs(start - target)
        kind = FailureKind.FELL_BACK if back else FailureKind.WRONG_RING
        return self.fail_as(kind, f"ball is in ring {ring}, expected ring {start} or {target}")


class StillWatch:
    """Notices a ball that stands where it should not: within STILL_RADIUS of one place for STILL_AFTER s.

    It goes by places, not by speed: the estimate of a ball that is held moves with the tilt that should move it."""

    def __init__(self) -> None:
        self._since, self._x, self._y = 0.0, math.inf, math.inf

    def standing(self, state: State | None) -> bool:
        """Whether the ball has now been standing for too long; `state`: where it was measured."""
        if state is None:
            return False
        if math.hypot(state.x - self._x, state.y - self._y) > STILL_RADIUS:
            self._since, self._x, self._y = state.t, state.x, state.y
        return state.t - self._since > STILL_AFTER


class PlanRoute(MazeLeaf):
    """Plan the route to the goal ring from where the ball is."""

    ports: ClassVar[dict[str, Port]] = {
        "goal": Port(int, REQUIRED, "ring to reach"),
        "legs": Port(int, None, "number of openings on the route", "out"),
    }

    def step(self) -> Status:
        """Weigh the openings anew; FAILURE no_route where none leads there."""
        run, here = self.context, self.context.here
        route = run.graph.route(here.ring, self.get("goal"), here.theta)
        if route is None:
            return self.fail_as(FailureKind.NO_ROUTE, f"no way from ring {here.ring} to ring {self.get('goal')}")
        self.set("legs", len(route.legs))
        run.on_event("route", {"openings": [leg.opening.name for leg in route.legs], "expected_s": route.expected_s})
        return Status.SUCCESS


class ChooseOpening(MazeLeaf):
    """Choose the opening to leave this ring by: the first of the best route from here."""

    ports: ClassVar[dict[str, Port]] = {
        "goal": Port(int, REQUIRED, "ring to reach in the end"),
        "opening": Port(str, None, "name of the opening chosen", "out"),
    }

    def step(self) -> Status:
        """SUCCESS with the opening's name; FAILURE no_route."""
        run, here = self.context, self.context.here
        route = run.graph.route(here.ring, self.get("goal"), here.theta)
        if route is None or not route.legs:
            return self.fail_as(FailureKind.NO_ROUTE, f"no opening leads from ring {here.ring} to the goal")
        run.opening = route.legs[0].opening
        self.set("opening", run.opening.name)
        run.on_event("opening", {"opening": run.opening.name})
        return Status.SUCCESS


TRAVEL = {
    "lean_deg": Port(float, None, "tilt towards the next ring on the way, deg; default: of the settings"),
    "speed": Port(float, None, "speed on arrival along the ring, m/s; default: of the settings"),
    "deadline_ms": Port(float, None, "time the planner may take; default: of the settings"),
}


class PlanInRing(MazeLeaf):
    """Plan the ball's way along its ring to the opening with iLQG, the plate leaning towards the opening's side."""

    ports: ClassVar[dict[str, Port]] = {
        "opening": Port(str, REQUIRED, "name of the opening to arrive at"),
        **TRAVEL,
        "plan": Port(str, None, "the plan, for Track", "out"),
    }

    def step(self) -> Status:
        """SUCCESS with a plan; FAILURE plan_failed when it is not finite."""
        run, here = self.context, self.context.here
        opening = self.current_opening()
        if run.maze.ring(here.ring).is_disc:  # a disc has no way along: aligning does it all
            self.set("plan", None)
            return Status.SUCCESS
        plan = make_plan(run, opening, travel_options(self), warm=None)
        self.set("plan", plan)
        if not plan.ok:
            return self.fail_as(FailureKind.PLAN_FAILED, f"the solver stopped: {plan.reason}")
        return Status.SUCCESS


def travel_options(leaf: MazeLeaf) -> TravelOptions:
    """Those of the run, with what the ports of a leaf say instead."""
    ports = {"lean_deg": "lean_deg", "speed_m_s": "speed", "deadline_ms": "deadline_ms"}
    given = {name: leaf.get(port) for name, port in ports.items()}
    try:
        return replace(
            leaf.context.options.travel, **{name: value for name, value in given.items() if value is not None}
        )
    except SettingsError as problem:
        raise leaf.wrong(str(problem)) from None


def make_plan(run: RunContext, opening: Opening, travel: TravelOptions, warm: Plan | None) -> Plan:
    """A plan from here to the opening, in the ring where the ball is; counted and reported.

    The arrival speed points the way the ball turns; the lean points to the ring behind the opening."""
    here = run.here
    turn = run.turn_to(opening)
    if warm is not None:  # a plan on its way keeps its side, also when the ball is half a turn away
        turn = nearest(opening.angle, float(warm.states[-1, 0])) - here.theta
        turn = turn - 2.0 * math.pi * round((turn - run.turn_to(opening)) / (2.0 * math.pi))
    inwards = opening.leads_to(here.ring) == opening.inner
    arrival = math.copysign(travel.speed_m_s / run.maze.track_radius(here.ring), turn)
    plan = run.planners[here.ring].plan(
        here.planner_vector(),
        here.theta + turn,
        lean=math.radians(-travel.lean_deg if inwards else travel.lean_deg),
        goal_theta_dot=arrival,
        warm=warm,
        t0=here.t,
        deadline_ms=travel.deadline_ms,
    )
    run.plan, run.goal_theta = plan, opening.angle
    run.planner_ms.append(plan.ms)
    run.on_event("plan", {"plan": plan})
    return plan


class Track(MazeLeaf):
    """Follow the plan to the opening; plan again when ball and plan part, or the plan is old."""

    ports: ClassVar[dict[str, Port]] = {
        "opening": Port(str, REQUIRED, "name of the opening to arrive at"),
        "plan": Port(str, REQUIRED, "the plan to follow"),
        "law": Port(str, "gains", "gains: the plan's own time-varying ones; pd: PD on the planned trajectory"),
        **TRAVEL,
        "timeout_s": Port(float, 4.0, "after that the opening counts as missed"),
    }

    def start(self) -> None:
        """Remember where the leg begins."""
        self._began, self._ring, self._still, self._ticks = self.context.now, self.context.here.ring, StillWatch(), 0

    def step(self) -> Status:
        """RUNNING on the way, SUCCESS in front of the opening, FAILURE stuck, missed_opening, fell_back, wrong_ring."""
        run, here = self.context, self.context.here
        opening, plan = self.current_opening(), self.get("plan")
        elsewhere = self.strayed(self._ring, opening.leads_to(self._ring))
        if elsewhere is not None:
            return elsewhere
        if plan is None or aligned(here, opening, run.options.gate):
            return Status.SUCCESS
        if run.now - self._began > self.get("timeout_s"):
            return self.fail_as(FailureKind.MISSED_OPENING, f"not in front of {opening.name} in time")
        if self._still.standing(run.measured):
            return self.fail_as(FailureKind.STUCK, f"standing on the way to {opening.name}")
        plan = self._renewed(plan, opening)
        run.steer(self.name, self._follow(plan))
        return Status.RUNNING

    def _renewed(self, plan: Plan, opening: Opening) -> Plan:
        run, options = self.context, self.context.options.tracking
        self._ticks += 1
        if finished(plan, run.here.t) or self._ticks % options.replan_every == 0 or off_plan(plan, run.here, options):
            warm = None if finished(plan, run.here.t) else plan
            new = make_plan(run, opening, travel_options(self), warm)
            if new.ok:  # a plan that failed is not followed; the old one still stands
                self.set("plan", new)
                return new
        return plan

    def _follow(self, plan: Plan) -> Command:
        run = self.context
        if self.get("law") == "pd":
            radius = run.maze.track_radius(run.here.ring)
            return follow_pd(plan, run.here, run.plate, run.options.tracking, radius)
        return follow_gains(plan, run.here, run.plate)


class Align(MazeLeaf):
    """Bring the ball in front of the opening and slow it down, leaning only lightly towards it."""

    ports: ClassVar[dict[str, Port]] = {
        "opening": Port(str, REQUIRED, "name of the opening"),
        "lean_deg": Port(float, 1.0, "tilt towards the next ring meanwhile, deg"),
        "timeout_s": Port(float, 2.0, "after that the opening counts as missed"),
    }

    def start(self) -> None:
        """Remember where and when it begins."""
        self._began, self._ring, self._still = self.context.now, self.context.here.ring, StillWatch()

    def step(self) -> Status:
        """SUCCESS when aligned or through already; FAILURE stuck, missed_opening, fell_back, wrong_ring."""
        run, here, opening = self.context, self.context.here, self.current_opening()
        elsewhere = self.strayed(self._ring, opening.leads_to(self._ring))
        if elsewhere is not None:
            return elsewhere
        if aligned(here, opening, run.options.gate):
            return Status.SUCCESS
        astray = not run.maze.ring(self._ring).is_disc and abs(run.turn_to(opening)) > LOST_TRACK
        if astray or run.now - self._began > self.get("timeout_s"):
            return self.fail_as(FailureKind.MISSED_OPENING, f"not aligned with {opening.name}")
        if self._still.standing(run.measured):
            return self.fail_as(FailureKind.STUCK, f"standing beside {opening.name}")
        push = self.get("lean_deg")
        ahead = run.ahead(run.options.gate.lead_s)
        run.steer(
            self.name,
            gate_command(ahead, opening, opening.leads_to(self._ring), run.plate, run.options.gate, push_deg=push),
        )
        return Status.RUNNING


class PassOpening(MazeLeaf):
    """Push the ball through the opening by tilting along its radial direction."""

    ports: ClassVar[dict[str, Port]] = {
        "opening": Port(str, REQUIRED, "name of the opening"),
        "timeout_s": Port(float, 1.2, "after that the opening counts as missed"),
    }

    def start(self) -> None:
        """Remember where and when it begins."""
        self._began, self._ring = self.context.now, self.context.here.ring

    def step(self) -> Status:
        """SUCCESS in the next ring; FAILURE missed_opening, fell_back, wrong_ring."""
        run, opening = self.context, self.current_opening()
        target = opening.leads_to(self._ring)
        elsewhere = self.strayed(self._ring, target)
        if elsewhere is not None:
            return elsewhere
        if run.now - self._began > self.get("timeout_s"):
            run.graph.record(opening.name, success=False)
            return self.fail_as(FailureKind.MISSED_OPENING, f"{opening.name} did not take the ball")
        if run.ahead(run.options.gate.entry_s).ring == target:
            run.enter(target)
        ahead = run.ahead(run.options.gate.lead_s)
        run.steer(self.name, gate_command(ahead, opening, target, run.plate, run.options.gate))
        return Status.RUNNING


class ConfirmRing(MazeLeaf):
    """Confirm that the ball is in the ring behind the opening."""

    ports: ClassVar[dict[str, Port]] = {"opening": Port(str, REQUIRED, "name of the opening it went through")}

    def step(self) -> Status:
        """SUCCESS in a ring that the opening joins, on the side nearer the goal; FAILURE wrong_ring otherwise."""
        run, opening = self.context, self.current_opening()
        target = opening.inner if run.goal >= opening.inner else opening.outer
        if run.here.ring != target:
            return self.fail_as(FailureKind.WRONG_RING, f"in ring {run.here.ring}, expected ring {target}")
        run.graph.record(opening.name, success=True)
        run.on_event("passed", {"opening": opening.name, "ring": target})
        return Status.SUCCESS


class Settle(MazeLeaf):
    """Keep the ball in the goal ring until it has been there for a while, by what was measured."""

    ports: ClassVar[dict[str, Port]] = {
        "ring": Port(int, REQUIRED, "the goal ring"),
        "hold_s": Port(float, 0.2, "time that the ball's centre must be measured inside the ring, s"),
        "damping": Port(float, None, "braking, 1/s; default: of the settings"),
        "timeout_s": Port(float, 3.0, "after that, back to planning"),
    }

    def start(self) -> None:
        """No time inside yet."""
        self._began, self._inside_since = self.context.now, None

    def step(self) -> Status:
        """SUCCESS after hold_s inside; FAILURE fell_back when the ball is out again, out_of_time when it never came
        in."""
        run, goal = self.context, self.get("ring")
        measured = run.measured
        inside = measured is not None and measured.seen and self._inside(measured.r, goal)
        if inside and measured is not None:
            self._inside_since = measured.t if self._inside_since is None else self._inside_since
            if measured.t - self._inside_since >= self.get("hold_s") - 1e-6:
                return Status.SUCCESS
        elif measured is not None and measured.seen:
            self._inside_since = None
        if run.here.ring != goal and (measured is None or measured.ring != goal):
            return self.fail_as(FailureKind.FELL_BACK, f"left ring {goal} for ring {run.here.ring}")
        if run.now - self._began > self.get("timeout_s"):
            return self.fail_as(FailureKind.MISSED_OPENING, f"did not come to rest in ring {goal}")
        self._brake(goal)
        return Status.RUNNING

    def _inside(self, r: float, goal: int) -> bool:
        ring = self.context.maze.ring(goal)
        return ring.inner_radius <= r <= ring.outer_radius

    def _brake(self, goal: int) -> None:
        """Brake; in a channel, also lean to the side that has no opening near the ball."""
        run = self.context
        ahead = run.ahead(run.options.gate.lead_s)
        given = self.get("damping")
        damping = run.options.settle.damping if given is None else given
        ring = run.maze.ring(goal)
        r = max(ahead.r, 1e-6)
        middle = 0.0 if ring.is_disc else ring.track_radius
        stiffness = 10.0  # 1/s^2, towards the middle of the ring; a tenth of what would make it swing
        pull = stiffness * (middle - ahead.r) / r
        ax, ay = pull * ahead.x - damping * ahead.vx, pull * ahead.y - damping * ahead.vy
        if not ring.is_disc:
            lean = self._safe_side(ring.number) * math.radians(1.0) * 9.81
            ax, ay = ax + lean * ahead.x / r, ay + lean * ahead.y / r
        run.steer(self.name, run.plate.command(ax, ay))

    def _safe_side(self, ring: int) -> float:
        """+1 to lean outwards, -1 inwards: away from the nearest opening's side."""
        run = self.context
        near = min(
            (o for o in run.maze.openings if ring in (o.outer, o.inner)),
            key=lambda o: abs(run.turn_to(o)),
            default=None,
        )
        if near is None:
            return 0.0
        return 1.0 if near.outer == ring else -1.0
