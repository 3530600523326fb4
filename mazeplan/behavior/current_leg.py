"""The way of the ball out of one ring by one opening: what was chosen and planned, and whether the ball has come in."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from mazeplan.control.opening import opening_frame
from mazeplan.core.maths.angles import difference
from mazeplan.core.records import Plan, State
from mazeplan.maze.geometry import Maze, Opening

if TYPE_CHECKING:
    from mazeplan.maze.graph import RouteGraph

ENTERING = 0.24  # s that a ball may take from the middle of an opening into the next ring


@dataclass
class CurrentLeg:
    """What the leaves know of the way out of a ring."""

    opening: Opening | None = None  # the chosen one
    leaving_ring: int | None = None  # the ring that the ball will leave by it
    plan: Plan | None = None  # along the ring
    followed: bool = False  # whether the command of this tick follows the plan (`Track`)
    goal_theta: float | None = None  # angle of the opening to which `plan` leads, rad
    prepared: tuple[Opening, Plan] | None = None  # an opening that was chosen by a plan, and this plan
    refused: Opening | None = None  # did not take the ball, although the ball already counted as in the next ring
    entering: tuple[int, int, float] | None = None  # ring left, ring entered, and until when it counts as there, s
    falling: Opening | None = None  # through which the ball falls
    # `falling`, otherwise `opening`; the measured state nearest to its middle, and the distance there, m
    nearest: tuple[Opening, State, float] | None = None

    def passage(self) -> CurrentLeg:
        """A new leg for a ball that is still falling through an opening. Nothing is chosen or planned."""
        return CurrentLeg(refused=self.refused, entering=self.entering, falling=self.falling, nearest=self.nearest)

    def approach(self, measured: State, maze: Maze) -> None:
        """Keep the measured state if the ball is nearer to its opening than before."""
        opening = self.falling or self.opening
        if opening is None or measured.lost or not measured.seen:
            return
        radius = maze.threshold_radius(opening)
        middle = (radius * math.cos(opening.angle), radius * math.sin(opening.angle))
        distance = math.dist(middle, (measured.x, measured.y))
        if self.nearest is None or self.nearest[0] != opening or distance < self.nearest[2]:
            self.nearest = (opening, measured, distance)

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


def measured_miss(nearest: State, last: State, opening: Opening, start: int) -> dict[str, float]:
    """How the ball missed an opening, for `Failure.detail`.

    nearest, last: measured states, in which the ball was nearest to the opening, and of now
    start: ring from which it should have passed

    passed_deg: angle of the ball behind the middle of the opening now; negative: it stays before it
    off_mm: distance beside the middle line when it was nearest, counter-clockwise positive
    radial_m_s: speed towards the next ring then
    tangential_m_s: speed along the ring then, counter-clockwise positive"""
    frame = opening_frame(nearest, opening)
    forward = 1.0 if frame.across_speed >= 0.0 else -1.0
    return {
        "passed_deg": round(forward * math.degrees(difference(last.theta, opening.angle)), 3),
        "off_mm": round(1e3 * frame.across, 3),
        "radial_m_s": round(-frame.along_speed if start == opening.outer else frame.along_speed, 4),
        "tangential_m_s": round(frame.across_speed, 4),
    }
