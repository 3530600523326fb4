"""The base of all leaves of a run: access to the context, failures with a kind, and a watch for a ball that stands."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from py_trees.common import Status

from mazeplan.btree.leaf import Leaf
from mazeplan.btree.ports import shown
from mazeplan.core.records import Failure, FailureKind, State
from mazeplan.maze.geometry import Opening

if TYPE_CHECKING:
    from mazeplan.behavior.context import RunContext

STILL_RADIUS = 2.5e-3  # m; five times the noise of a camera sample
STILL_AFTER = 0.6  # s after which a ball that stands where it should not counts as stuck


class MazeLeaf(Leaf):
    """A leaf of a run: typed access to its context, and failures with a kind."""

    context: RunContext

    def fail(self, failure: Any) -> Status:
        """Leave a failure and return FAILURE. Raises TreeError for anything else."""
        if not isinstance(failure, Failure):
            raise self.wrong(f"fail: got {shown(failure)}, expected a Failure; fail_as(kind, detail) makes one")
        return super().fail(failure)

    def fail_as(self, kind: FailureKind | str, detail: str = "") -> Status:
        """Leave a failure of this kind, or of that name, and return FAILURE. Raises TreeError where there is no such
        kind."""
        if kind not in list(FailureKind):
            kinds = ", ".join(map(str, FailureKind))
            raise self.wrong(f"fail_as: got {shown(kind)}, expected one of {kinds}")
        return self.fail(Failure(FailureKind(kind), self.name, self.context.now, detail))

    def current_opening(self) -> Opening:
        """The opening named by the port `opening`."""
        return self.context.maze.opening(self.get("opening"))

    def shut(self, opening: Opening) -> Status | None:
        """FAILURE if the opening was closed on the way to it, None if it may be used."""
        if opening.name not in self.context.graph.closed:
            return None
        return self.fail_as(FailureKind.OPENING_CLOSED, f"{opening.name} was closed on the way to it")

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

    def strayed(self, start: int, target: int) -> Status | None:
        """SUCCESS if the ball is in the target ring already, FAILURE if in a third one, None if still in the first."""
        ring = self.context.here.ring
        if ring == start:
            return None
        if ring == target:
            return Status.SUCCESS
        refused, self.context.leg.refused = self.context.leg.refused, None
        if refused is not None:
            return self.fail_as(FailureKind.MISSED_OPENING, f"{refused.name} did not take the ball")
        goal = self.context.target
        back = abs(ring - goal) > abs(start - goal)
        kind = FailureKind.FELL_BACK if back else FailureKind.WRONG_RING
        return self.fail_as(kind, f"ball is in ring {ring}, expected ring {start} or {target}")


class StillWatch:
    """Notices a ball that stands still: within STILL_RADIUS of one place for STILL_AFTER s.

    It uses measured positions and no speeds: if the ball is held, its estimate still moves with the tilt that should
    move the ball."""

    def __init__(self) -> None:
        self._since, self._x, self._y = 0.0, math.inf, math.inf

    def standing(self, state: State | None) -> bool:
        """Whether the ball has now been standing for too long. state: where the ball was measured."""
        if state is None:
            return False
        if math.hypot(state.x - self._x, state.y - self._y) > STILL_RADIUS:
            self._since, self._x, self._y = state.t, state.x, state.y
        return state.t - self._since > STILL_AFTER
