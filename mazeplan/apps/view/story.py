"""A run at one time, ready to be drawn, and how it is made from the messages of the run (`core.logs.run_log`).

Lengths m, angles rad, times s of the rig's clock. A live page gives each message to `Story.take` and calls
`Story.moment` whenever it draws. A replay uses `moments`, one for each tick of a log.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mazeplan.core.events import (
    FailureReported,
    GoalChanged,
    OpeningClosed,
    OpeningReopened,
    RecoveryChosen,
    TimedEvent,
)
from mazeplan.core.logs.run_log_reader import PLAN_STATES
from mazeplan.core.maths.angles import difference
from mazeplan.core.records import Array, Failure, FailureKind
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import check_text

TRAIL_S = 3.0  # s of the ball's path in a moment


@dataclass(frozen=True)
class NodeShown:
    """A node of the behaviour tree."""

    kind: str
    name: str
    parent: int  # number of the node above; -1 for the root
    depth: int  # 0 for the root


@dataclass(frozen=True)
class TreeShown:
    """The behaviour tree."""

    number: int = 0  # how many trees the run has had
    nodes: tuple[NodeShown, ...] = ()
    statuses: str = ""  # a letter for each node (`core.logs.run_log.STATUSES`)
    active: tuple[int, ...] = ()  # numbers of the nodes that run, if all nodes above them run, too


@dataclass(frozen=True)
class BallShown:
    """Estimated place of the ball; seen: whether the last picture showed it."""

    x: float
    y: float
    seen: bool


@dataclass(frozen=True)
class Moment:
    """A run at one time."""

    run: int = 0  # its number on this page
    tick: int = 0  # how many ticks it has had
    t: float = 0.0
    header: dict[str, Any] = field(default_factory=dict)  # of its log
    ring: int | None = None  # of the ball
    goal: int | None = None  # ring
    leaf: str = ""  # that commands
    opening: str | None = None  # to which the run brings the ball
    closed: frozenset[str] = frozenset()  # openings
    ball: BallShown | None = None  # None while its place is unknown
    second: BallShown | None = None  # None without a second ball
    tilt: tuple[float, float] = (0.0, 0.0)  # beta, gamma as measured
    trail: Array = field(default_factory=lambda: np.empty((0, 2)))  # of the last seconds; NaN: place unknown
    plan: Array | None = None  # that the run follows, (N, 2), on the track of the ring
    tree: TreeShown = TreeShown()
    failure: Failure | None = None  # the last one
    result: dict[str, Any] | None = None  # None until the run ends


def number(value: Any) -> float:
    """The value as a float; NaN for anything but a finite number."""
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else math.nan


class Story:
    """What a page knows of a run. moment: the run as it is now. A header begins another run."""

    def __init__(self) -> None:
        self.moment = Moment(run=-1)
        self._begin({})

    def _begin(self, header: dict[str, Any]) -> None:
        self._maze = maze = maze_of(header)
        self._trail: deque[tuple[float, float, float]] = deque()  # t, x, y
        self._new_plans: list[Array] = []  # angles of the plans since the last tick
        self._followed: Array | None = None
        closed = {opening.name for opening in maze.openings if opening.closed} if maze is not None else set[str]()
        replay: Any = header.get("replay")
        closed |= set(replay.get("closed", ()) if isinstance(replay, dict) else ())
        self.moment = Moment(self.moment.run + 1, header=header, goal=header.get("goal_ring"), closed=frozenset(closed))

    def take(self, topic: str, document: dict[str, Any]) -> None:
        """Take one message. Unknown topics are ignored."""
        tree = self.moment.tree
        match topic:
            case "/header":
                self._begin(document)
            case "/tick":
                self._take_tick(document)
            case "/plan":
                theta = np.array(document.get(PLAN_STATES[0], ()), dtype=float)
                if len(theta) > 1 and np.isfinite(theta).all():
                    self._new_plans.append(theta)
            case "/tree":
                self._change(tree=TreeShown(tree.number + 1, _nodes(document)))
            case "/status":
                statuses = str(document.get("nodes", ""))
                self._change(tree=replace(tree, statuses=statuses, active=_active(tree.nodes, statuses)))
            case "/event":
                self._take_event(TimedEvent.from_document(document))
            case "/result":
                self._change(result=document, opening=None, plan=None)

    def _change(self, **values: Any) -> None:
        self.moment = replace(self.moment, **values)

    def _take_tick(self, tick: dict[str, Any]) -> None:
        t, (x, y), ring, maze = number(tick.get("t")), _place(tick), tick.get("ring"), self._maze
        self._trail.append((t, x, y))
        while self._trail[0][0] < t - TRAIL_S:
            self._trail.popleft()
        if ring is None and maze is not None and math.isfinite(x):  # a run without a tree
            ring = maze.ring_at(math.hypot(x, y))
        self._followed, self._new_plans, plan = self._newly_followed(tick), [], None
        if self._followed is not None and maze is not None and ring is not None:
            plan = arc(maze.track_radius(ring), self._followed)
        seen = tick.get("x") is not None and tick.get("y") is not None
        tilt = number(tick.get("beta")), number(tick.get("gamma"))
        self._change(
            tick=self.moment.tick + 1,
            t=t,
            ring=ring,
            leaf=str(tick.get("leaf", "")),
            opening=tick.get("opening"),
            ball=BallShown(x, y, seen) if math.isfinite(x) else None,
            second=_second(tick),
            tilt=(0.0, 0.0) if any(map(math.isnan, tilt)) else tilt,
            trail=np.array(self._trail)[:, 1:],
            plan=plan,
        )

    def _newly_followed(self, tick: dict[str, Any]) -> Array | None:
        """The plan that the run follows: a plan of this tick, else the one followed so far. Of several plans of a tick,
        one for each opening in question, it is the one that ends nearest to the opening to which the ball goes."""
        goal, following = number(tick.get("goal_theta")), "planned_theta" in tick
        if not following or not self._new_plans:
            return self._followed if following else None
        return min(reversed(self._new_plans), key=lambda theta: abs(difference(float(theta[-1]), goal)))

    def _take_event(self, timed: TimedEvent) -> None:
        closed, failure = self.moment.closed, self.moment.failure
        match timed.event:
            case GoalChanged(ring, more):
                self._change(goal=ring, closed=closed | set(more))
            case OpeningClosed(opening):
                self._change(closed=closed | {opening})
            case OpeningReopened(opening):
                self._change(closed=closed - {opening})
            case FailureReported(kind, where, detail) if kind in set(FailureKind):
                self._change(failure=Failure(FailureKind(kind), where, timed.t, detail))
            case RecoveryChosen(recovery) if failure is not None:
                self._change(failure=replace(failure, recovery=recovery))


def moments(messages: Iterable[tuple[str, dict[str, Any]]]) -> list[Moment]:
    """One moment for each tick of a run, with the messages before the next tick. The last moment has the result."""
    story, found, waiting = Story(), list[Moment](), False
    for topic, document in messages:
        if topic in ("/tick", "/event", "/plan", "/tree") and waiting:
            found.append(story.moment)
            waiting = False
        story.take(topic, document)
        waiting = waiting or topic == "/tick"
    if waiting:
        found.append(story.moment)
    elif found:
        found[-1] = story.moment
    return found


def maze_of(header: dict[str, Any]) -> Maze | None:
    """The maze in a run's header; None for a map with errors."""
    return check_text(str(header.get("map", "")), file="log").maze


def arc(radius: float, angles: Array) -> Array:
    """Points on a circle, (N, 2)."""
    return radius * np.column_stack([np.cos(angles), np.sin(angles)])


def _place(tick: dict[str, Any]) -> tuple[float, float]:
    """Place of the ball: the estimate, else the measurement, else NaN."""
    for names in (("estimate_x", "estimate_y"), ("x", "y")):
        x, y = (number(tick.get(name)) for name in names)
        if not (math.isnan(x) or math.isnan(y)):
            return x, y
    return math.nan, math.nan


def _second(tick: dict[str, Any]) -> BallShown | None:
    """The second ball, if the run has one."""
    x, y = number(tick.get("estimate_x2")), number(tick.get("estimate_y2"))
    return BallShown(x, y, tick.get("x2") is not None) if math.isfinite(x) and math.isfinite(y) else None


def _nodes(document: dict[str, Any]) -> tuple[NodeShown, ...]:
    nodes: list[NodeShown] = []
    for kind, name, parent in zip(*(document.get(key, ()) for key in ("kinds", "names", "parents")), strict=False):
        depth = nodes[parent].depth + 1 if 0 <= parent < len(nodes) else 0
        nodes.append(NodeShown(kind, name, parent, depth))
    return tuple(nodes)


def _active(nodes: tuple[NodeShown, ...], statuses: str) -> tuple[int, ...]:
    """Numbers of the nodes that run, if all nodes above them run, too."""
    running: list[int] = []
    for i, (node, letter) in enumerate(zip(nodes, statuses, strict=False)):
        if letter == "R" and (node.parent < 0 or node.parent in running):
            running.append(i)
    return tuple(running)
