"""From the messages of a run (`data.runlog`), one after another, to what is to be shown of it (`Moment`).

Live page and replay are one thing with two sources of messages: live, `Story.take` gets what the run sends and
`Story.moment` is asked whenever the page is drawn; afterwards `moments` gives one moment for each tick of a log.

How uncertain a plan is, the run itself tells: wherever a plan of a while ago wanted the ball now, it is off by some way
along the ring; the rms of that over all plans of the run, by age, is the doubt about the one that is followed.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from mazeplan.data.runlog_reader import PLAN_STATES
from mazeplan.maths.angles import difference, nearest
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import check_text
from mazeplan.records import Failure, FailureKind
from mazeplan.view.moment import COLUMNS, Ahead, Gate, Moment, Said, TreeNode
from mazeplan.view.tallies import Doubt, Followed, Rows, Tries, number

SHOWN_S = 10.0  # s of rows in a moment
SAID = 8  # things that happened, kept in a moment


class Story:
    """What was told of a run until now. Any number of runs may follow one another: a header begins one."""

    def __init__(self) -> None:
        self._runs = 0
        self._begin({})

    def _begin(self, header: dict[str, Any]) -> None:
        self._header, self.maze = header, maze_of(header)
        self._trees, self._ticks, self._t = 0, 0, 0.0
        replay = header.get("replay") or {}
        rate = number(replay.get("rate_hz")) if isinstance(replay, dict) else math.nan
        self._rows = Rows(round(SHOWN_S * (rate if rate > 0.0 else 30.0)))
        self._tick: dict[str, Any] = {}
        self._goal = header.get("goal_ring")
        self._closed = {o.name for o in self.maze.openings if o.closed} if self.maze else set()
        self._closed |= set(replay.get("closed", ())) if isinstance(replay, dict) else set()
        self._tries = Tries()
        self._opening: str | None = None
        self._nodes: tuple[TreeNode, ...] = ()
        self._statuses = ""
        self._failure: Failure | None = None
        self._failures = 0
        self._said: deque[Said] = deque(maxlen=SAID)
        self._result: dict[str, Any] | None = None
        self._fresh: list[Followed] = []  # since the last tick
        self._followed: Followed | None = None
        self._doubt = Doubt()

    def take(self, topic: str, document: dict[str, Any]) -> None:
        """One message; topics of others are passed over."""
        if topic == "/header":
            self._runs += 1
            self._begin(document)
        elif topic == "/tick":
            self._take_tick(document)
        elif topic == "/plan":
            self._take_plan(document)
        elif topic == "/tree":
            self._trees += 1
            self._nodes, self._statuses = _nodes(document), ""
        elif topic == "/status":
            self._statuses = str(document.get("nodes", ""))
        elif topic == "/openings":
            self._tries = Tries.of(document)
        elif topic == "/event":
            self._take_event(document)
        elif topic == "/result":
            self._result = document

    # -- messages ---------------------------------------------------------------------------------------------------

    def _take_tick(self, tick: dict[str, Any]) -> None:
        self._tick, self._t = tick, number(tick.get("t"))
        self._ticks += 1
        x, y = _place(tick)
        theta = math.atan2(y, x)
        last = self._rows.last("theta")
        theta = theta if math.isnan(last) or math.isnan(theta) else nearest(theta, last)
        planned = number(tick.get("planned_theta"))
        self._follow(planned, number(tick.get("estimate_t")))
        planned = planned if math.isnan(theta) or math.isnan(planned) else nearest(planned, theta)
        known = {"x": x, "y": y, "theta": theta, "planned_theta": planned}
        self._rows.add([known.get(name, number(tick.get(name))) for name in COLUMNS])
        if self._followed is not None:
            self._doubt.keep(self._followed)
        self._doubt.compare(number(tick.get("estimate_t")), theta, tick.get("ring"), tick.get("opening"))

    def _take_plan(self, plan: dict[str, Any]) -> None:
        theta = np.array(plan.get(PLAN_STATES[0], ()), dtype=float)
        t0, dt = number(plan.get("t0")), number(plan.get("dt"))
        if len(theta) > 1 and np.isfinite(theta).all() and math.isfinite(t0) and dt > 0.0:
            self._fresh.append(Followed(t0, dt, theta))

    def _follow(self, planned: float, now: float) -> None:
        """Of the plans of this tick (one for each opening in question) and that before, the one that is followed: where
        it wants the ball now is told in the tick, and where it is to end."""
        known, self._fresh = [p for p in (self._followed, *self._fresh) if p is not None], []
        if math.isnan(planned):
            self._followed = None
            return
        goal = number(self._tick.get("goal_theta"))

        def off(plan: Followed) -> tuple[float, float]:
            end = 0.0 if math.isnan(goal) else abs(difference(float(plan.theta[-1]), goal))
            return round(abs(difference(plan.at(now), planned)), 5), end

        followed = min(reversed(known), key=off, default=None)
        if followed is not None and not followed.radius:
            ring = self._tick.get("ring")
            followed = replace(followed, ring=ring, radius=self._radius(ring), opening=self._tick.get("opening"))
        self._followed = followed

    def _radius(self, ring: Any) -> float:
        known = self.maze is not None and isinstance(ring, int) and 1 <= ring <= len(self.maze.rings)
        return self.maze.track_radius(ring) if known and self.maze is not None else 0.0

    def _take_event(self, event: dict[str, Any]) -> None:
        t, kind, detail = number(event.get("t")), str(event.get("kind", "")), event.get("detail") or {}
        if kind == "goal":
            self._goal = detail.get("ring")
            self._closed |= set(detail.get("closed", ()))
        elif kind in ("closed", "opened"):
            (self._closed.add if kind == "closed" else self._closed.discard)(str(detail.get("opening")))
        elif kind == "failure":
            self._failures += 1
            self._failure = _failure(t, detail)
        elif kind == "recovery" and self._failure is not None:
            self._failure = replace(self._failure, recovery=str(detail.get("recovery", "")))
        text = _words(kind, detail)
        if text:
            self._said.append(Said(t, text))

    # -- what is to be shown ----------------------------------------------------------------------------------------

    def moment(self) -> Moment:
        """As it stands now."""
        tick = self._tick
        x, y = _place(tick)
        ball = None if math.isnan(x) or math.isnan(y) else (x, y)
        opening = tick.get("opening") if self._result is None else None
        return Moment(
            run=self._runs,
            tree=self._trees,
            tick=self._ticks,
            t=self._t,
            header=self._header,
            ring=self._ring(x, y),
            goal=self._goal,
            opening=opening,
            goal_theta=tick.get("goal_theta"),
            ball=ball,
            seen=tick.get("x") is not None and tick.get("y") is not None,
            tilt=_pair(tick, "beta", "gamma"),
            command=_pair(tick, "u_beta", "u_gamma"),
            rows=self._rows.newest(),
            plan=None if self._result is not None else self._ahead(),
            gates=self._gates(opening),
            nodes=self._nodes,
            statuses=self._statuses,
            active=_active(self._nodes, self._statuses),
            leaf=str(tick.get("leaf", "")),
            doubts=str(tick.get("doubts", "")),
            failure=self._failure,
            failures=self._failures,
            said=tuple(self._said),
            result=self._result,
        )

    def _ring(self, x: float, y: float) -> int | None:
        """As the run has it; where nobody followed the ball from ring to ring, by where it is."""
        told = self._tick.get("ring")
        known = told is None and self.maze is not None and not math.isnan(x)
        return self.maze.ring_at(math.hypot(x, y)) if known and self.maze is not None else told

    def _ahead(self) -> Ahead | None:
        plan = self._followed
        if plan is None or plan.radius <= 0.0:
            return None
        places = plan.radius * np.column_stack([np.cos(plan.theta), np.sin(plan.theta)])
        return Ahead(plan.t0, plan.dt, plan.ring, plan.theta, places, self._doubt.after(len(plan.theta)))

    def _gates(self, opening: str | None) -> tuple[Gate, ...]:
        if self.maze is None:
            return ()
        return tuple(
            Gate(o.name, o.name in self._closed, o.name == opening, *self._tries.now(o.name, self._t))
            for o in self.maze.openings
        )


def moments(messages: Iterable[tuple[str, dict[str, Any]]]) -> list[Moment]:
    """One for each tick of a run, with all that was told of it before the next one; the last with the result."""
    story, told, waiting = Story(), [], False
    for topic, document in messages:
        if topic in ("/tick", "/event", "/plan", "/tree") and waiting:
            told.append(story.moment())
            waiting = False
        story.take(topic, document)
        waiting = waiting or topic == "/tick"
    if waiting:
        told.append(story.moment())
    elif told:
        told[-1] = story.moment()
    return told


def maze_of(header: dict[str, Any]) -> Maze | None:
    """The maze of a run, as its header has it; None where that is no map."""
    return check_text(str(header.get("map", "")), file="log").maze


def _pair(tick: dict[str, Any], first: str, second: str) -> tuple[float, float]:
    """Two numbers, 0 for what is none."""
    values = (number(tick.get(first)), number(tick.get(second)))
    return (0.0, 0.0) if any(map(math.isnan, values)) else values


def _place(tick: dict[str, Any]) -> tuple[float, float]:
    """Where the ball is: by the estimate, and where there is none by what was seen."""
    for names in (("estimate_x", "estimate_y"), ("x", "y")):
        x, y = (number(tick.get(name)) for name in names)
        if not (math.isnan(x) or math.isnan(y)):
            return x, y
    return math.nan, math.nan


def _nodes(document: dict[str, Any]) -> tuple[TreeNode, ...]:
    nodes: list[TreeNode] = []
    columns = (document.get(key, ()) for key in ("paths", "kinds", "names", "parents"))
    for path, kind, name, parent in zip(*columns, strict=False):
        depth = nodes[parent].depth + 1 if 0 <= parent < len(nodes) else 0
        nodes.append(TreeNode(path, kind, name, parent, depth))
    return tuple(nodes)


def _active(nodes: tuple[TreeNode, ...], statuses: str) -> tuple[int, ...]:
    """Numbers of the nodes that run, as do all above them."""
    running: list[int] = []
    for i, (node, letter) in enumerate(zip(nodes, statuses, strict=False)):
        if letter == "R" and (node.parent < 0 or node.parent in running):
            running.append(i)
    return tuple(running)


def _failure(t: float, detail: dict[str, Any]) -> Failure | None:
    kind = detail.get("kind")
    if kind not in {str(known) for known in FailureKind}:
        return None
    return Failure(FailureKind(str(kind)), str(detail.get("where", "")), t, str(detail.get("detail", "")))


def _words(kind: str, detail: dict[str, Any]) -> str:
    """An event in words; empty for what nobody wants to read."""
    opening, ring = detail.get("opening"), detail.get("ring")
    said = {
        "ring": f"in ring {ring}",
        "passed": f"through {opening}",
        "opening": f"towards {opening}",
        "failure": f"{detail.get('kind')}: {detail.get('detail')}",
        "recovery": f"recovery: {detail.get('recovery')}",
        "goal": f"new goal: ring {ring}",
        "closed": f"{opening} closed",
        "opened": f"{opening} open again",
        "stopped": "stopped from outside",
        "doubt": f"not believed: {detail.get('what')}",
    }
    return said.get(kind, "")
