"""A run at one time, ready to be drawn: plain records, the same for a live run and a recorded run.

Lengths m, angles rad, times s of the rig's clock. `story` makes moments from a run's messages.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mazeplan.core.records import Array, Failure

TRAIL_S = 3.0  # s of the ball's path in a moment


@dataclass(frozen=True)
class NodeShown:
    """A node of the behaviour tree.

    parent: number of the node above; -1 for the root
    depth: 0 for the root"""

    path: str
    kind: str
    name: str
    parent: int
    depth: int


@dataclass(frozen=True)
class TreeShown:
    """The behaviour tree.

    number: how many trees the run has had
    statuses: a letter for each node (`core.logs.run_log.STATUSES`)
    active: numbers of the nodes that run, if all nodes above them run, too"""

    number: int = 0
    nodes: tuple[NodeShown, ...] = ()
    statuses: str = ""
    active: tuple[int, ...] = ()


@dataclass(frozen=True)
class TaskShown:
    """What the run is doing.

    ring: of the ball
    goal: goal ring
    opening: the next opening
    leaf: the leaf that commands
    doubts: measurements that the run does not believe"""

    ring: int | None = None
    goal: int | None = None
    opening: str | None = None
    leaf: str = ""
    doubts: str = ""


@dataclass(frozen=True)
class BallShown:
    """Estimated place of the ball; seen: whether the last picture showed it."""

    x: float
    y: float
    seen: bool


@dataclass(frozen=True)
class PlanShown:
    """The plan that the run follows.

    t0: time of the first step
    dt: time between steps
    theta: planned angles, (N,), rad
    radius: of the ring's track, m"""

    t0: float
    dt: float
    theta: Array
    radius: float = 0.0

    @property
    def places(self) -> Array:
        """x, y on the track of the ring, (N, 2), m."""
        return self.radius * np.column_stack([np.cos(self.theta), np.sin(self.theta)])

    def at(self, t: float) -> float:
        """Planned angle at time t, at the step that `control.tracking.plan_step` takes."""
        step = 0 if np.isnan(t) else round((t - self.t0) / self.dt)
        return float(self.theta[min(max(step, 0), len(self.theta) - 2)])


@dataclass(frozen=True)
class OpeningShown:
    """An opening. next: whether the run brings the ball there"""

    name: str
    closed: bool
    next: bool


@dataclass(frozen=True)
class EventShown:
    """An event in words."""

    t: float
    text: str


@dataclass(frozen=True)
class Moment:
    """A run at one time.

    run: number of the run on this page
    tick: how many ticks the run has had
    header: of its log
    ball: None while its place is unknown
    second: the second ball; None without one
    tilt: beta, gamma as measured
    trail: path of the ball in the last seconds, (N, 2); NaN where its place is unknown
    ms: computing time of the planner and of the whole tick; NaN if unknown
    failure: the last failure
    events: the last events
    result: None until the run ends"""

    run: int = 0
    tick: int = 0
    t: float = 0.0
    header: dict[str, Any] = field(default_factory=dict)
    task: TaskShown = TaskShown()
    ball: BallShown | None = None
    second: BallShown | None = None
    tilt: tuple[float, float] = (0.0, 0.0)
    trail: Array = field(default_factory=lambda: np.empty((0, 2)))
    ms: tuple[float, float] = (float("nan"), float("nan"))
    plan: PlanShown | None = None
    openings: tuple[OpeningShown, ...] = ()
    tree: TreeShown = TreeShown()
    failure: Failure | None = None
    events: tuple[EventShown, ...] = ()
    result: dict[str, Any] | None = None
