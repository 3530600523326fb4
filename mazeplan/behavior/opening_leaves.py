"""The leaves that bring the ball through an opening and to rest: align, pass, confirm, settle.

Each leaf uses the state at which its command will act, gives at most one command a tick, and never blocks. If it fails,
it leaves a `records.Failure` of a named kind. The way to an opening is in `travel`, conditions and recoveries are in
`recovery`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from mazeplan.behavior.mazeleaf import HELD_AFTER, OpeningLeaf
from mazeplan.btree.ports import REQUIRED, Port
from mazeplan.btree.status import Status
from mazeplan.control.opening import aligned, freeing_command, opening_command, opening_frame
from mazeplan.core.constants import GRAVITY
from mazeplan.core.events import OpeningPassed
from mazeplan.core.records import FailureKind
from mazeplan.maze.geometry import Opening

TOO_MANY = 2  # missed openings after which the model is not believed any more
LOST_TRACK = 2.5  # rad; turn to the opening beyond which aligning makes no sense

if TYPE_CHECKING:  # a check of a tree needs no run
    from mazeplan.behavior.context import RunContext


class Align(OpeningLeaf):
    """Bring the ball in front of the opening and slow it down, leaning only lightly towards it."""

    ports: ClassVar[dict[str, Port]] = {
        "opening": Port(str, REQUIRED, "name of the opening", choices="openings"),
        "lean_deg": Port(float, 1.0, "tilt towards the next ring meanwhile, deg", least=0.0, most=90.0),
        "timeout_s": Port(float, 2.0, "after that the opening counts as missed", least=0.0),
    }

    def step(self) -> Status:
        """SUCCESS when aligned or through already; FAILURE stuck, missed_opening, opening_closed, fell_back,
        wrong_ring."""
        run, here, opening = self.context, self.context.here, self.current_opening()
        elsewhere = self.elsewhere(self._ring, opening) or self.walled_off(opening)
        if elsewhere is not None:
            return elsewhere
        if aligned(here, opening, run.steering.options.gate):
            return Status.SUCCESS
        astray = not run.maze.ring(self._ring).is_disc and abs(run.turn_to(opening)) > LOST_TRACK
        if astray or run.now - self._began > self.get("timeout_s"):
            return self.missed(opening, self._ring, f"not aligned with {opening.name}")
        if self._still.standing(run.measured):
            return self.fail_as(FailureKind.STUCK, f"standing beside {opening.name}")
        gate, target = run.steering.options.gate, opening.leads_to(self._ring)
        push = self.get("lean_deg")
        run.steer(self.name, opening_command(run.ahead(gate.lead_s), opening, target, run.plate, gate, push_deg=push))
        return Status.RUNNING


def gets_in(run: RunContext, opening: Opening, target: int) -> bool:
    """Whether the ball will soon be in the next ring, even if it is a little to one side of its estimate. This matters
    because the opening is hardly wider than the ball.

    Missed openings show that the model is not good enough to say so."""
    gate = run.steering.options.gate
    if run.count(FailureKind.MISSED_OPENING) >= TOO_MANY:
        return False
    across = 1e-3 * gate.entry_doubt_mm * np.array([-math.sin(opening.angle), math.cos(opening.angle)])
    places = (0.0, -1.0, 1.0) if gate.entry_doubt_mm > 0.0 else (0.0,)
    return all(run.ahead(gate.entry_s, (k * across[0], k * across[1])).ring == target for k in places)


class PassOpening(OpeningLeaf):
    """Push the ball through the opening by tilting along its radial direction, or by what a rollout says is sooner."""

    ports: ClassVar[dict[str, Port]] = {
        "opening": Port(str, REQUIRED, "name of the opening", choices="openings"),
        "timeout_s": Port(float, 1.2, "after that the opening counts as missed", least=0.0),
    }

    def step(self) -> Status:
        """SUCCESS in the next ring; FAILURE missed_opening, opening_closed, fell_back, wrong_ring."""
        run, opening = self.context, self.current_opening()
        target = opening.leads_to(self._ring)
        elsewhere = self.elsewhere(self._ring, opening)
        if elsewhere is not None:
            return elsewhere
        if run.now - self._began > self.get("timeout_s"):
            run.graph.record(opening.name, success=False)
            return self.missed(opening, self._ring, f"{opening.name} did not take the ball")
        if gets_in(run, opening, target):
            run.leg.enter(run.here.ring, target, run.now)
        # a missed opening shows that the model, or its delay, is not good enough for roll-outs
        trusted = None if run.count(FailureKind.MISSED_OPENING) else run.steering.rollout
        command = None if trusted is None else trusted.improved_command(run.here, opening, target)
        if self._held(opening):
            command = freeing_command(run.here, opening, target, run.plate)
        elif command is None:
            ahead = run.ahead(run.steering.options.gate.lead_s)
            command = opening_command(ahead, opening, target, run.plate, run.steering.options.gate)
        run.steer(self.name, command)
        return Status.RUNNING

    def _held(self, opening: Opening) -> bool:
        """Whether an edge of the opening holds the ball: it stands, and beside the middle line."""
        state, clearance = self.context.measured, 0.5 * opening.width - self.context.maze.ball.radius
        standing = self._still.standing(state, HELD_AFTER)
        return standing and state is not None and abs(opening_frame(state, opening).across) > clearance


class ConfirmRing(OpeningLeaf):
    """Confirm that the ball is in the ring behind the opening.

    That is the one that was not left by the opening; where no leaf has chosen this opening, the one nearer the ring to
    which the route leads."""

    ports: ClassVar[dict[str, Port]] = {
        "opening": Port(str, REQUIRED, "name of the opening it went through", choices="openings")
    }

    def step(self) -> Status:
        """SUCCESS in the ring behind the opening; FAILURE wrong_ring otherwise."""
        run, opening = self.context, self.current_opening()
        target = opening.inner if run.target >= opening.inner else opening.outer
        if run.leg.opening == opening and run.leg.leaving_ring is not None:
            target = opening.leads_to(run.leg.leaving_ring)
        if run.here.ring != target:
            return self.fail_as(FailureKind.WRONG_RING, f"in ring {run.here.ring}, expected ring {target}")
        if (elsewhere := self.walled_off(opening)) is not None:
            return elsewhere
        run.graph.record(opening.name, success=True)
        run.report(OpeningPassed(opening.name, target))
        return Status.SUCCESS


class Settle(OpeningLeaf):
    """Keep the ball in the goal ring until it has been there for a while, by what was measured."""

    ports: ClassVar[dict[str, Port]] = {
        "ring": Port(int, REQUIRED, "the goal ring", choices="rings"),
        "hold_s": Port(float, 0.2, "time that the ball's centre must be measured inside the ring, s", least=0.0),
        "timeout_s": Port(float, 3.0, "after that, back to planning", least=0.0),
    }

    def start(self) -> None:
        """No time inside yet."""
        self._began, self._inside_since = self.context.now, None

    def step(self) -> Status:
        """SUCCESS after hold_s inside; FAILURE fell_back when the ball is out again, missed_opening when it never
        came in."""
        run, goal, measured = self.context, self.get("ring"), self.context.measured
        if measured is not None and measured.seen:
            ring = run.maze.ring(goal)
            if not ring.inner_radius <= measured.r <= ring.outer_radius:
                self._inside_since = None
            else:
                self._inside_since = measured.t if self._inside_since is None else self._inside_since
                if measured.t - self._inside_since >= self.get("hold_s") - 1e-6:
                    return Status.SUCCESS
        if run.here.ring != goal and (measured is None or measured.ring != goal):
            return self.fail_as(FailureKind.FELL_BACK, f"left ring {goal} for ring {run.here.ring}")
        near = min(run.maze.openings_of(goal), key=lambda opening: abs(run.turn_to(opening)), default=None)
        if near is not None and run.now - self._began > self.get("timeout_s"):
            return self.missed(near, near.leads_to(goal), f"did not come to rest in ring {goal}")
        self._brake(goal, near)
        return Status.RUNNING

    def _brake(self, goal: int, near: Opening | None) -> None:
        """Brake; in a channel, also lean away from the side that has the nearest opening."""
        run = self.context
        ahead = run.ahead(run.steering.options.gate.lead_s)
        damping, ring = run.steering.options.settle.damping, run.maze.ring(goal)
        r = max(ahead.r, 1e-6)
        middle = 0.0 if ring.is_disc else ring.track_radius
        stiffness = 10.0  # 1/s^2, towards the middle of the ring; a tenth of what would make it swing
        pull = stiffness * (middle - ahead.r) / r
        ax, ay = pull * ahead.x - damping * ahead.vx, pull * ahead.y - damping * ahead.vy
        if not ring.is_disc and near is not None:
            lean = (1.0 if near.outer == goal else -1.0) * math.radians(1.0) * GRAVITY  # positive: outwards
            ax, ay = ax + lean * ahead.x / r, ay + lean * ahead.y / r
        run.steer(self.name, run.plate.command(ax, ay))
