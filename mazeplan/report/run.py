"""A run, by its log: what it came to, and the numbers that its pictures show."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from mazeplan.data.runlog import RunLog
from mazeplan.errors import LogError
from mazeplan.maths.angles import difference, nearest
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import check_text, load_map
from mazeplan.records import Array
from mazeplan.report.page import Note, Section, Table
from mazeplan.report.words import MISSING

AHEAD = 0.2  # s; a plan that begins where the ball is says nothing of the model, its prediction does

HEADER = (
    ("rig", "rig"), ("map_name", "map"), ("model", "model"), ("behavior", "behaviour tree"), ("seed", "seed"),
    ("start_ring", "from ring"), ("goal_ring", "to ring"), ("time_limit_s", "time limit"), ("version", "mazeplan"),
    ("platform", "machine"),
)  # fmt: skip


@dataclass(frozen=True)
class Visit:
    """The ball was in a ring from start to end, s of rig time; opening: by which it left."""

    ring: int
    start: float
    end: float
    opening: str


@dataclass(frozen=True)
class Mishap:
    """A failure: rig time in s, kind, where in the tree, in words, which recovery, where the ball was (m, NaN)."""

    t: float
    kind: str
    where: str
    detail: str
    recovery: str
    x: float
    y: float


def maze_of(log: RunLog) -> Maze:
    """The map in the log. Raises LogError when there is none that can be used."""
    text = log.header.get("map")
    if isinstance(text, str):
        maze = check_text(text, file=log.path).maze
        if maze is None:
            raise LogError("the map in its header cannot be used", file=log.path)
        return maze
    return load_map("cme")


def trail(log: RunLog) -> Array:
    """Where the ball was, (N, 3) of x, y in m and time in s: as estimated, where that is told."""
    names = ("estimate_x", "estimate_y", "estimate_t") if "estimate_x" in log.ticks else ("x", "y", "t")
    return np.stack([log.ticks[name] for name in names], axis=1)


def visits(log: RunLog) -> list[Visit]:
    """Rings one after the other, by the log's events."""
    entered = [(e["t"], int(e["detail"]["ring"])) for e in log.events if e["kind"] == "ring" and "ring" in e["detail"]]
    last = float(log.ticks["t"][-1]) if len(log.ticks["t"]) else 0.0
    ends = [t for t, _ in entered[1:]] + [last]
    left = [str(p.get("opening") or "") for p in (log.result or {}).get("rings", [])]
    left += [""] * (len(entered) - len(left))
    return [Visit(ring, t, end, by) for (t, ring), end, by in zip(entered, ends, left, strict=False)]


def followed_plans(log: RunLog) -> list[dict[str, Any]]:
    """Plans in the order of time; of several made in one tick, one for each opening that might have been chosen, that
    which ends nearest to the goal that the tick took."""
    goal = log.ticks.get("goal_theta", np.full(len(log.ticks["t"]), math.nan))
    together: dict[float, list[dict[str, Any]]] = {}
    for plan in log.plans:
        if len(plan["states"]):
            together.setdefault(round(float(plan["t0"]), 6), []).append(plan)
    found = []
    for t0, plans in sorted(together.items()):
        k = min(int(np.searchsorted(log.ticks["t"], t0 - 1e-9)), len(goal) - 1)
        wanted = float(goal[k])
        found.append(min(plans, key=lambda plan: abs(difference(float(plan["states"][-1, 0]), wanted))))
    return found


def planned_before(log: RunLog, t: Array, ahead: float = AHEAD) -> Array:
    """Angle (N,), rad, at times t (N,) as the newest plan said that was made `ahead` s before or earlier; NaN where
    that one does not reach so far, or is older than twice that: it is not followed any more."""
    plans = followed_plans(log)
    made = np.array([float(plan["t0"]) for plan in plans])
    out = np.full(len(t), math.nan)
    for i, now in enumerate(t):
        k = int(np.searchsorted(made, now - ahead + 1e-6)) - 1
        if k < 0 or now - made[k] > 2.0 * ahead:
            continue
        theta = plans[k]["states"][:, 0]
        at = (now - made[k]) / float(plans[k]["dt"])
        if at <= len(theta) - 1:
            out[i] = np.interp(at, np.arange(len(theta)), theta)
    return out


def theta_lines(log: RunLog, maze: Maze) -> list[tuple[Visit, Array, Array, Array]]:
    """For each visit of a ring with a channel: times (N,), theta as it was and as it was planned AHEAD before, both
    (N,), deg, unwrapped; NaN where nothing is told."""
    found = []
    x, y, t = trail(log).T
    for visit in visits(log):
        here = np.isfinite(t) & (log.ticks["t"] >= visit.start - 1e-9) & (log.ticks["t"] < visit.end - 1e-9)
        if maze.ring(visit.ring).is_disc or not here.any():
            continue
        theta = _unwrapped(np.arctan2(y[here], x[here]))
        wanted = nearest(planned_before(log, t[here]), theta)
        found.append((visit, t[here], np.degrees(theta), np.degrees(wanted)))
    return found


def _unwrapped(angle: Array) -> Array:
    """Continuous over samples that are missing."""
    out = angle.copy()
    known = np.isfinite(angle)
    out[known] = np.unwrap(angle[known])
    return out


def mishaps(log: RunLog) -> list[Mishap]:
    """Failures with the recovery that followed each, and where the camera, or else the estimator, had the ball."""
    place, times = trail(log), log.ticks["t"]
    found: list[dict[str, Any]] = []
    for event in log.events:
        detail = event["detail"]
        if event["kind"] == "failure":
            k = int(np.searchsorted(times, event["t"] - 1e-9)) if len(times) else 0
            x, y = place[min(k, len(times) - 1), :2] if len(times) else (math.nan, math.nan)
            words = {name: str(detail.get(name) or "") for name in ("kind", "where", "detail")}
            found.append({"t": event["t"], **words, "recovery": "", "x": float(x), "y": float(y)})
        elif event["kind"] == "recovery" and found and not found[-1]["recovery"]:
            found[-1]["recovery"] = str(detail.get("recovery") or "")
    return [Mishap(**entry) for entry in found]


def lead(log: RunLog) -> str:
    """How it ended, in a sentence."""
    result = log.result
    if result is None:
        last = float(log.ticks["t"][-1]) if len(log.ticks["t"]) else 0.0
        return f"The log ends without a result after {last:.2f} s: the program did not come to its end."
    problems = len(result.get("failures", []))
    on_the_way = "nothing went wrong" if not problems else f"{problems} failure{'s' * (problems > 1)} on the way"
    if result.get("success"):
        return f"The ball arrived after {result['time_s']:.2f} s; {on_the_way}."
    return f"The ball did not arrive: {result.get('reason')} after {result['time_s']:.2f} s; {on_the_way}."


def spread_of(values: Array) -> tuple[float, float, float]:
    """Median, 99th percentile and maximum; NaN of nothing."""
    values = values[np.isfinite(values)]
    if not len(values):
        return math.nan, math.nan, math.nan
    p50, p99 = np.percentile(values, [50.0, 99.0])
    return float(p50), float(p99), float(values.max())


def run_section(log: RunLog) -> Section:
    """Everything about a run. Raises LogError where the log is none of a run."""
    from mazeplan.report.run_pictures import run_pictures

    if not len(log.ticks["t"]):
        raise LogError("got a log without a single tick, expected one of a run", file=log.path)
    maze = maze_of(log)
    facts = [(label, told(name, log.header[name])) for name, label in HEADER if log.header.get(name) not in (None, "")]
    facts.insert(0, ("log", log.path.name + ("" if log.complete else " (cut off)")))
    parts: list[Any] = [_rings_table(log), *run_pictures(log, maze)]
    failures = mishaps(log)
    if failures:
        parts.insert(1, _failures_table(failures))
    parts.append(_times_table(log))
    if not log.trees:
        parts.append(Note("The log is from before trees were told: its timeline shows which leaf commanded."))
    return Section(f"Run {log.path.name}", lead(log), facts, parts)


def told(name: str, value: Any) -> str:
    """A fact with its unit, where its name has one."""
    shown = f"{value:g}" if isinstance(value, float) else str(value)
    return f"{shown} s" if name.endswith("_s") else shown


def _rings_table(log: RunLog) -> Table:
    rows = [
        [f"{v.ring}", f"{v.start:.2f} s", f"{v.end - v.start:.2f} s", v.opening or MISSING] for v in visits(log)
    ]  # fmt: skip
    return Table("Rings", ("ring", "entered at", "time in it", "left by"), rows)


def _failures_table(failures: list[Mishap]) -> Table:
    rows = [
        [f"{m.t:.2f} s", m.kind.replace("_", " "), m.where, m.detail, m.recovery.replace("_", " ") or MISSING]
        for m in failures
    ]
    return Table("Failures and recoveries", ("at", "kind", "where", "detail", "recovery"), rows)


def _times_table(log: RunLog) -> Table:
    rows = []
    for label, values in times_ms(log).items():
        p50, p99, most = spread_of(values)
        if math.isfinite(p50):
            rows.append([label, f"{len(values)}", f"{p50:.2f} ms", f"{p99:.2f} ms", f"{most:.2f} ms"])
    return Table("What the program took", ("of", "number", "median", "99 %", "most"), rows)


def times_ms(log: RunLog) -> dict[str, Array]:
    """Wall time in ms: of each plan, of each tick."""
    plans = np.array([float(plan.get("ms", math.nan)) for plan in log.plans])
    return {"plan": plans, "tick": log.ticks.get("tick_ms", np.empty(0))}
