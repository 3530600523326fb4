"""The way of the ball out of one ring by one opening: what was chosen and planned, and whether the ball has come in."""

from __future__ import annotations

from dataclasses import dataclass, replace

from mazeplan.core.records import Plan, State
from mazeplan.maze.geometry import Maze, Opening
from mazeplan.maze.graph import RouteGraph

ENTERING = 0.24  # s that a ball may take from the middle of an opening into the next ring


@dataclass
class CurrentLeg:
    """What the leaves know of the way out of a ring.

    opening: the chosen opening
    leaving_ring: the ring that the ball will leave by it
    plan: the plan along the ring
    followed: whether the command of this tick follows the plan (`Track`)
    goal_theta: angle of the opening to which `plan` leads, rad
    prepared: an opening that was chosen by a plan, and this plan
    refused: the opening that did not take the ball, although the ball already counted as in the next ring
    entering: ring that the ball leaves, ring into which it falls, and rig time until which it counts as there, s
    falling: the opening through which the ball falls
    """

    opening: Opening | None = None
    leaving_ring: int | None = None
    plan: Plan | None = None
    followed: bool = False
    goal_theta: float | None = None
    prepared: tuple[Opening, Plan] | None = None
    refused: Opening | None = None
    entering: tuple[int, int, float] | None = None
    falling: Opening | None = None

    def passage(self) -> CurrentLeg:
        """A new leg for a ball that is still falling through an opening. Nothing is chosen or planned."""
        return CurrentLeg(refused=self.refused, entering=self.entering, falling=self.falling)

    def enter(self, source: int, target: int, now: float) -> None:
        """The ball falls from ring `source` into ring `target`. For ENTERING s from `now` on, it counts as there."""
        self.entering, self.falling = (source, target, now + ENTERING), self.opening

    def entered(self, state: State, now: float, maze: Maze, graph: RouteGraph) -> State:
        """The state with the ring in which the ball counts as being. A ball that does not come into the ring in time
        makes its opening `refused`; `graph` then remembers the failure."""
        if self.entering is None:
            return state
        source, target, until = self.entering
        if state.ring == target:
            self.falling = None
        if now > until:
            self.entering = None
            if self.falling is not None:  # the ball never came into the ring
                self.refused, self.opening, self.falling = self.falling, self.falling, None
                graph.record(self.refused.name, success=False)
        elif state.ring == source and self._before(target, state, maze):  # not there yet, or the prediction is unsteady
            return replace(state, ring=target)
        return state

    def _before(self, target: int, state: State, maze: Maze) -> bool:
        """Whether at the ball's angle the sector of ring `target` is that behind the opening."""
        return self.falling is None or maze.turn(target, state.theta, self.falling.angle) is not None
