"""Computes the numbers of a run's report from its log: visits, failures, plans, intervals of leaves.

A log has the status of each node of the tree at each change.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from mazeplan.core.errors import LogError
from mazeplan.core.events import FailureReported, RecoveryChosen, RingEntered
from mazeplan.core.logs.run_log import STATUSES, RunLog
from mazeplan.core.logs.run_log_reader import LoggedPlan
from mazeplan.core.maths.angles import difference, nearest
from mazeplan.core.records import Array
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import check_text, load_map

AHEAD = 0.2  # s; a plan is right at its start, where the ball is, so its prediction is judged this much later
IDLE = STATUSES["INVALID"]


@dataclass(frozen=True)
class Visit:
    """A stay of the ball in a ring.

    start, end: rig time, s.
    opening: opening by which the ball left; empty if unknown."""

    ring: int
    start: float
    end: float
    opening: str


@dataclass(frozen=True)
class LoggedFailure:
    """A failure.

    t: rig time, s.
    kind: kind of the failure.
    where: place in the tree.
    detail: reason.
    recovery: the recovery that followed; empty if there was none.
    x, y: place of the ball, m, or NaN."""

    t: float
    kind: str
    where: str
    detail: str
    recovery: str
    x: float
    y: float


@dataclass(frozen=True)
class Bar:
    """An interval in which a leaf kept its status.

    path: path of the leaf in the tree.
    status: a letter of `STATUSES`.
    start, end: rig time, s."""

    path: str
    status: str
    start: float
    end: float


def maze_of(log: RunLog) -> Maze:
    """The map in the log, else cme. Raises LogError for a map with errors."""
    text = log.header.get("map")
    if not isinstance(text, str):
        return load_map("cme")
    maze = check_text(text, file=log.path).maze
    if maze is None:
        raise LogError("the map in its header cannot be used", file=log.path)
    return maze


def end_of(log: RunLog) -> float:
    """Time of the last tick, s."""
    return float(log.ticks["t"][-1]) if len(log.ticks["t"]) else 0.0


def span_of(log: RunLog) -> tuple[float, float]:
    """Time from the first tick to one sample after the last tick, s. Statuses and commands hold until then."""
    t = log.ticks["t"]
    step = float(np.median(np.diff(t))) if len(t) > 1 else 1.0 / (log.header.get("replay") or {}).get("rate_hz", 30.0)
    return float(t[0]) if len(t) else 0.0, end_of(log) + step


def trail(log: RunLog) -> Array:
    """Path of the ball, (N, 3) of x, y in m and time in s: the estimate if the log has one, else the measurement."""
    names = ("estimate_x", "estimate_y", "estimate_t") if "estimate_x" in log.ticks else ("x", "y", "t")
    return np.stack([log.ticks[name] for name in names], axis=1)


def second_trail(log: RunLog) -> Array | None:
    """Estimated path of the second ball, (N, 2) of x, y in m; None for a run with one ball."""
    names = ("estimate_x2", "estimate_y2")
    return np.stack([log.ticks[name] for name in names], axis=1) if names[0] in log.ticks else None


def visits(log: RunLog) -> list[Visit]:
    """The stays in rings, one after the other, from the log's events."""
    entered = [(e.t, e.event.ring) for e in log.events if isinstance(e.event, RingEntered)]
    ends = [t for t, _ in entered[1:]] + [end_of(log)]
    left = [str(p.get("opening") or "") for p in (log.result or {}).get("rings", [])]
    left += [""] * (len(entered) - len(left))
    return [Visit(ring, t, end, by) for (t, ring), end, by in zip(entered, ends, left, strict=False)]


def followed_plans(log: RunLog) -> list[LoggedPlan]:
    """Plans for the first ball, in the order of time.

    A tick may make plans to several openings. Of these, the plan counts that ends nearest to the tick's goal."""
    goal = log.ticks.get("goal_theta", np.full(len(log.ticks["t"]), math.nan))
    led = log.ticks.get("ball", np.ones(len(goal)))  # number of the ball that the tick plans for
    together: dict[float, list[LoggedPlan]] = {}
    for plan in log.plans:
        if len(plan.states):
            together.setdefault(round(plan.t0, 6), []).append(plan)
    found = []
    for t0, plans in sorted(together.items()):
        tick = min(int(np.searchsorted(log.ticks["t"], t0 - 1e-9)), len(goal) - 1)
        if led[tick] == 1:
            wanted = float(goal[tick])
            found.append(min(plans, key=lambda plan: abs(difference(float(plan.states[-1, 0]), wanted))))
    return found


def planned_before(plans: Sequence[LoggedPlan], t: Array, ahead: float = AHEAD) -> Array:
    """Planned angle (N,), rad, at times t (N,), s, from the newest plan that is at least `ahead` s old then.

    NaN if that plan ends earlier. Also NaN if it is older than twice `ahead`, because nothing follows it any more."""
    made = np.array([plan.t0 for plan in plans])
    out = np.full(len(t), math.nan)
    for i, now in enumerate(t):
        k = int(np.searchsorted(made, now - ahead + 1e-6)) - 1
        if k >= 0 and now - made[k] <= 2.0 * ahead:
            theta = plans[k].states[:, 0]
            step = (now - made[k]) / plans[k].dt
            out[i] = np.interp(step, np.arange(len(theta)), theta, right=math.nan)
    return out


def theta_lines(log: RunLog, maze: Maze) -> list[tuple[Visit, Array, Array, Array]]:
    """For each visit of a ring except the disc: the visit, times (N,), s, measured theta (N,), and planned theta (N,).

    The plan is at least AHEAD s old. Angles are in degrees, NaN where unknown. They begin between 0 and 360 and
    continue from ring to ring, also beyond whole turns."""
    found, before = list[tuple[Visit, Array, Array, Array]](), math.pi
    x, y, t = trail(log).T
    plans = followed_plans(log)
    for visit in visits(log):
        here = np.isfinite(t) & (log.ticks["t"] >= visit.start - 1e-9) & (log.ticks["t"] < visit.end - 1e-9)
        if maze.ring(visit.ring).is_disc or not here.any():
            continue
        theta = np.arctan2(y[here], x[here])
        known = np.isfinite(theta)
        theta[known] = np.unwrap(theta[known])
        if known.any():
            theta += nearest(theta[known][0], before) - theta[known][0]
            before = float(theta[known][-1])
        wanted = nearest(planned_before(plans, t[here]), theta)
        found.append((visit, t[here], np.degrees(theta), np.degrees(wanted)))
    return found


def logged_failures(log: RunLog) -> list[LoggedFailure]:
    """Failures, each with the recovery that followed and the place of the ball."""
    place, times = trail(log), log.ticks["t"]
    found: list[LoggedFailure] = []
    for timed in log.events:
        event = timed.event
        if isinstance(event, FailureReported):
            k = min(int(np.searchsorted(times, timed.t - 1e-9)), len(times) - 1)
            x, y = place[k, :2] if len(times) else (math.nan, math.nan)
            found.append(LoggedFailure(timed.t, event.kind, event.where, event.detail, "", float(x), float(y)))
        elif isinstance(event, RecoveryChosen) and found and not found[-1].recovery:
            found[-1] = replace(found[-1], recovery=event.recovery)
    return found


def times_ms(log: RunLog) -> dict[str, Array]:
    """Computing time by the wall clock, ms: {"plan": of each plan, "tick": of each tick}."""
    plans = np.array([plan.ms for plan in log.plans])
    return {"plan": plans, "tick": log.ticks.get("tick_ms", np.empty(0))}


def leaf_bars(log: RunLog) -> list[Bar]:
    """Intervals of all ticked leaves, in the order of the tree, and for each leaf in the order of time."""
    if not len(log.ticks["t"]):
        return []
    found: list[Bar] = []
    for tree, end in zip(log.trees, [*(later.t for later in log.trees[1:]), span_of(log)[1]], strict=True):
        last = max(end, tree.statuses[-1][0]) if tree.statuses else end
        for i, path in enumerate(tree.outline.paths):
            if i not in tree.outline.parents:
                changes = [(tree.t, IDLE), *((t, letters[i]) for t, letters in tree.statuses), (last, IDLE)]
                found += [Bar(path, status, start, t) for status, start, t in _stretches(changes, IDLE)]
    order = {path: i for i, path in enumerate(dict.fromkeys(p for tree in log.trees for p in tree.outline.paths))}
    return sorted(found, key=lambda bar: (order[bar.path], bar.start))


def _stretches(changes: list[tuple[float, str]], idle: str) -> list[tuple[str, float, float]]:
    """(value, start, end) of the stretches in which a value stays the same, without stretches of `idle`.

    changes: (time, new value), in the order of time."""
    kept = [(t, value) for k, (t, value) in enumerate(changes) if k == 0 or value != changes[k - 1][1]]
    if len(kept) == 1 or kept[-1] != changes[-1]:
        kept.append(changes[-1])
    return [(value, start, end) for (start, value), (end, _) in pairwise(kept) if value != idle]


def labels(bars: list[Bar]) -> dict[str, str]:
    """{path of a leaf: label}. A label is the leaf's name, with as much of the path as makes the label unique."""
    paths = [bar.path.split("/") for bar in {bar.path: bar for bar in bars}.values()]
    found = {}
    for parts in paths:
        tails = (parts[-n:] for n in range(1, len(parts) + 1))
        alone = (tail for tail in tails if sum(other[-len(tail) :] == tail for other in paths) == 1)
        found["/".join(parts)] = " / ".join(next(alone, parts))
    return found
