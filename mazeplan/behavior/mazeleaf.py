"""The base of all leaves of a run: access to the context, failures with a kind, and a watch for a ball that stands."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from mazeplan.behavior.current_leg import measured_miss
from mazeplan.btree.leaf import Leaf
from mazeplan.btree.ports import shown
from mazeplan.btree.status import Status
from mazeplan.core.constants import GRAVITY
from mazeplan.core.records import Command, Failure, FailureKind, State
from mazeplan.maze.geometry import Opening

if TYPE_CHECKING:
    from mazeplan.behavior.context import RunContext

STILL_RADIUS = 2.5e-3  # m; five times the noise of a camera sample
STILL_AFTER = 0.6  # s after which a ball that stands where it should not counts as stuck
HELD_AFTER = 0.35  # s after which such a ball is freed by a push along the ring; a slow servo has moved it by then
THROAT_M = 1e-3  # m; a ball this far beyond the free width of its ring is between the walls of an opening
THROAT_S = 0.2  # s after which a ball that stands there is freed


class MazeLeaf(Leaf):
    """A leaf of a run: typed access to its context, and failures with a kind."""

    context: RunContext

    def fail(self, failure: Any) -> Status:
        """Leave a failure and return FAILURE. Raises TreeError for anything else."""
        if not isinstance(failure, Failure):
            raise self.wrong(f"fail: got {shown(failure)}, expected a Failure; fail_as(kind, detail) makes one")
        return super().fail(failure)

    def fail_as(self, kind: FailureKind | str, words: str = "", detail: Mapping[str, float] | None = None) -> Status:
        """Leave a failure of this kind, or of that name, and return FAILURE. Raises TreeError where there is no such
        kind. detail: what was measured, by name"""
        if kind not in list(FailureKind):
            kinds = ", ".join(map(str, FailureKind))
            raise self.wrong(f"fail_as: got {shown(kind)}, expected one of {kinds}")
        return self.fail(Failure(FailureKind(kind), self.name, self.context.now, words, detail=dict(detail or {})))


class OpeningLeaf(MazeLeaf):
    """A leaf on the way to an opening, or through it."""

    def start(self) -> None:
        """Remember where and when the leaf begins."""
        run = self.context
        self._began, self._ring, self._still = run.now, run.here.ring, StillWatch()

    def missed(self, opening: Opening, start: int, words: str) -> Status:
        """Leave the failure missed_opening with what was measured, and return FAILURE. start: the ring to be left"""
        run, nearest = self.context, self.context.leg.nearest
        last = run.measured or run.here
        state = nearest[1] if nearest is not None and nearest[0] == opening else last
        run.leg.nearest = None
        return self.fail_as(FailureKind.MISSED_OPENING, words, measured_miss(state, last, opening, start))

    def current_opening(self) -> Opening:
        """The opening named by the port `opening`."""
        return self.context.maze.opening(self.get("opening"))

    def walled_off(self, opening: Opening) -> Status | None:
        """FAILURE if radial walls keep the ball away from an opening, None if there is a way."""
        run = self.context
        if not run.maze.radial_walls or run.maze.turn(run.here.ring, run.here.theta, opening.angle) is not None:
            return None
        return self.fail_as(FailureKind.WRONG_RING, f"a radial wall stands between the ball and {opening.name}")

    def rerouted(self) -> Status | None:
        """FAILURE, once, if openings were closed or opened so that another way is the shortest now."""
        run = self.context
        if not run.rerouted:
            return None
        run.rerouted = False
        return self.fail_as(FailureKind.ROUTE_CHANGED, "openings were closed or opened: the route is another")

    def elsewhere(self, start: int, opening: Opening) -> Status | None:
        """SUCCESS if the ball is behind the opening, FAILURE if it is in a third ring, or if the opening was closed on
        the way to it; None while the ball is in the ring `start`."""
        run, ring, target = self.context, self.context.here.ring, opening.leads_to(start)
        if ring == target:
            return Status.SUCCESS
        if ring == start:
            if opening.name not in run.graph.closed:
                return None
            return self.fail_as(FailureKind.OPENING_CLOSED, f"{opening.name} was closed on the way to it")
        refused, run.leg.refused = run.leg.refused, None
        if refused is not None:
            return self.missed(refused, start, f"{refused.name} did not take the ball")
        back = abs(ring - run.target) > abs(start - run.target)
        kind = FailureKind.FELL_BACK if back else FailureKind.WRONG_RING
        return self.fail_as(kind, f"ball is in ring {ring}, expected ring {start} or {target}")


class StillWatch:
    """Notices a ball that stands still: within STILL_RADIUS of one place for STILL_AFTER s.

    It uses measured positions and no speeds: if the ball is held, its estimate still moves with the tilt that should
    move the ball."""

    def __init__(self) -> None:
        self._since, self._x, self._y = 0.0, math.inf, math.inf

    def standing(self, state: State | None, after: float = STILL_AFTER) -> bool:
        """Whether the ball has now been standing for more than `after` s. state: where the ball was measured."""
        if state is None:
            return False
        if math.hypot(state.x - self._x, state.y - self._y) > STILL_RADIUS:
            self._since, self._x, self._y = state.t, state.x, state.y
        return state.t - self._since > after


class HeldWatch:
    """Notices a ball that is held on its way along a ring, and gives the command that frees it.

    A ball between the walls of an opening that is not its next one: the run counts it as in the ring, but a command
    along the ring only presses it against these walls. The command points to the middle of the ring.

    A ball that stands: the lean of a plan presses it against the wall of the ring, where friction holds it. The command
    points along the ring."""

    def __init__(self) -> None:
        self._still, self._in_throat = StillWatch(), False

    def command(self, run: RunContext, opening: Opening) -> Command | None:
        """The command that frees the ball; None if nothing holds it. opening: the next one."""
        ring, state = run.maze.ring(run.here.ring), run.measured
        if ring.is_disc or state is None:
            return None
        c, s, full = state.x / state.r, state.y / state.r, GRAVITY * run.plate.limit
        beyond = abs(state.r - ring.track_radius) - (ring.outer_radius - ring.track_radius - run.maze.ball.radius)
        stands = self._still.standing(state, THROAT_S)
        self._in_throat = beyond > THROAT_M and (stands or self._in_throat)  # until it is out
        if self._in_throat:
            pull = math.copysign(full, ring.track_radius - state.r)
            return run.plate.command(pull * c, pull * s)
        if self._still.standing(state, HELD_AFTER):
            pull = math.copysign(full, run.turn_to(opening))
            return run.plate.command(-pull * s, pull * c)
        return None
