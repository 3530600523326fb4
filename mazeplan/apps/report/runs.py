"""The report of a run, from its log; and of an evaluation, from the document of `evaluate --json`.

A run: rings, failures, the path of the ball, its angle and the tilt over time. An evaluation: arrivals and failures.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.apps.report import words
from mazeplan.apps.report.inputs import Input, map_in, number, read_as_printed
from mazeplan.apps.report.page import Note, PagePicture, PageSection, PageTable, legend_beside, line
from mazeplan.apps.report.words import DEG, MISSING, setup_facts
from mazeplan.core.errors import InputError, LogError
from mazeplan.core.events import FailureReported, RecoveryChosen, RingEntered
from mazeplan.core.logs.run_log_reader import RunLog
from mazeplan.core.palette import COLOURS, SPEEDS
from mazeplan.core.records import Array
from mazeplan.maze.drawing import draw_maze, draw_second
from mazeplan.maze.geometry import Maze

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PANELS = (  # label of a panel over time; its curves: column of the log, style, factor
    ("angle of the ball,\ndegrees", {"planned": "planned_theta", "real": "theta"}),
    ("tilt down at +x\n(beta), degrees", {"commanded": "u_beta", "measured": "beta"}),
    ("tilt up at +y\n(gamma), degrees", {"commanded": "u_gamma", "measured": "gamma"}),
)
FAILURE_MARKERS = "Xos^DvP*<>phd"
TIMES = {"mean": "mean time", "best": "best", "p50": "median", "p95": "95 % are faster than", "worst": "worst"}


@dataclass(frozen=True)
class Visit:
    """A stay of the ball in a ring, from start to end, s, and the opening by which it left (empty if unknown)."""

    ring: int
    start: float
    end: float
    opening: str


@dataclass(frozen=True)
class LoggedFailure:
    """A failure: time, s, kind, place in the tree, reason, recovery that followed, place of the ball, m (or NaN)."""

    t: float
    kind: str
    where: str
    detail: str
    recovery: str
    x: float
    y: float


def end_of(log: RunLog) -> float:
    """Time of the last tick, s."""
    return float(log.ticks["t"][-1]) if len(log.ticks["t"]) else 0.0


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


def run_section(log: RunLog) -> PageSection:
    """The section of a page about a run. Raises LogError for a log without a tick."""
    if not len(log.ticks["t"]):
        raise LogError("got a log without a single tick, expected one of a run", file=log.path)
    maze, failures = map_in(log.header.get("map"), log.path), logged_failures(log)
    facts = [("log", log.path.name + ("" if log.complete else " (cut off)")), *setup_facts(log.header)]
    rows = [[f"{v.ring}", f"{v.start:.2f} s", f"{v.end - v.start:.2f} s", v.opening or MISSING] for v in visits(log)]
    parts: list[Any] = [PageTable("Rings", ("ring", "entered at", "time in it", "left by"), rows)]
    if failures:
        rows = [
            [f"{m.t:.2f} s", m.kind.replace("_", " "), m.where, m.detail, m.recovery.replace("_", " ") or MISSING]
            for m in failures
        ]
        parts.append(PageTable("Failures and recoveries", ("at", "kind", "where", "detail", "recovery"), rows))
    parts += [
        PagePicture(
            "path", "The ball's path; colour is time", "path of the ball over the maze, coloured by time",
            partial(_path, log=log, maze=maze, failures=failures), (7.4, 6.4),
        ),
        PagePicture(
            "time", "Angle of the ball, planned and real; tilt of the plate, commanded and measured",
            "angle of the ball and tilt of both axes against time", partial(_over_time, log=log, failures=failures),
            (9.0, 6.4),
        ),
    ]  # fmt: skip
    return PageSection(f"Run {log.path.name}", lead(log), facts, parts)


def lead(log: RunLog) -> str:
    """How the run ended, in a sentence."""
    result = log.result
    if result is None and "excitation" in log.header and log.complete:  # no run: `collect` has no result
        return f"A collection of {end_of(log):.0f} s."
    if result is None:
        return f"The log ends without a result after {end_of(log):.2f} s: the program did not come to its end."
    problems = sum(failure.get("where") != "run" for failure in result.get("failures", []))
    on_the_way = f"; {problems} failure{'s' * (problems > 1)} on the way" if problems else ""
    if result.get("success"):
        who = "Both balls" if result.get("others") else "The ball"
        return f"{who} arrived after {result['time_s']:.2f} s{on_the_way or '; nothing went wrong'}."
    reason = str(result.get("reason")).replace("_", " ")
    what = "the tree failed" if reason == "failed" else reason
    return f"The ball did not arrive: {what} after {result['time_s']:.2f} s{on_the_way}."


def _path(figure: Figure, log: RunLog, maze: Maze, failures: list[LoggedFailure]) -> None:
    from matplotlib import colormaps
    from matplotlib.collections import LineCollection
    from matplotlib.colors import ListedColormap

    # without the light end, which is hard to see on white paper; in grey print it keeps its order
    darker = ListedColormap(colormaps[SPEEDS](np.linspace(0.0, 0.88, 256)))
    axes, place, second = figure.add_subplot(), trail(log), second_trail(log)
    whole = np.asarray(np.isfinite(place).all(axis=1))
    draw_maze(maze, axes, path=place[whole, :2])
    points = 1e3 * place[:, :2]
    together = whole[:-1] & whole[1:]
    pieces = np.stack([points[:-1], points[1:]], axis=1)[together]
    lines = LineCollection(list(pieces), linewidths=1.8, capstyle="round", zorder=4, cmap=darker)
    lines.set_array(0.5 * (place[:-1, 2] + place[1:, 2])[together])
    axes.add_collection(lines)
    figure.colorbar(lines, ax=axes, shrink=0.6, pad=0.02, aspect=30).set_label("time, s")
    if second is not None:
        draw_second(axes, second)
    _mark_failures(axes, [(m.kind, m.x, m.y) for m in failures], markersize=8.0, markeredgewidth=0.9)
    if failures or second is not None:
        axes.legend(loc="upper left", bbox_to_anchor=(-0.02, 1.0))


def _mark_failures(axes: Axes, failures: list[tuple[str, float, float]], **more: Any) -> None:
    """Mark failures on a maze, each kind with its own marker. failures: kind and x, y, m"""
    look: Any = {"color": COLOURS["failure"], "ls": "none", "markeredgecolor": "white", "zorder": 8, **more}
    for kind, marker in zip(dict.fromkeys(kind for kind, *_ in failures), cycle(FAILURE_MARKERS)):
        x, y = zip(*((1e3 * x, 1e3 * y) for found, x, y in failures if found == kind), strict=True)
        axes.plot(x, y, label=kind.replace("_", " "), marker=marker, **look)


def _over_time(figure: Figure, log: RunLog, failures: list[LoggedFailure]) -> None:
    panels: Any = figure.subplots(len(PANELS), 1, sharex=True)
    x, y, _ = trail(log).T
    known = {**log.ticks, "theta": np.arctan2(y, x)}
    for axes, (label, curves) in zip(panels, PANELS, strict=True):
        for style, column in curves.items():
            values = DEG * known.get(column, np.full(len(x), math.nan))
            if "theta" in column:
                values = values % 360.0
                values[1:][np.abs(np.diff(values)) > 180.0] = math.nan  # a line from 360 back to 0 means nothing
            axes.plot(log.ticks["t"], values, **line(style), label=style)
        for m in failures:
            axes.axvline(m.t, color=COLOURS["failure"], lw=0.8, ls=(0, (1.0, 1.5)))
        axes.set_ylabel(label)
        axes.grid(axis="y")
        legend_beside(axes)
    panels[-1].set_xlabel("time, s; dotted: failures")


# -- evaluations ------------------------------------------------------------------------------------------------------


def evaluation_section(given: Input) -> PageSection:
    """The section of a page about an evaluation. Raises InputError, MapError for a map that cannot be used."""
    document, runs = given.document, given.document["results"]
    if not runs:
        raise InputError("got no runs, expected one or more", file=given.path, key="results")
    with read_as_printed(given):
        setup = document.get("setup") or {}
        parts: list[Any] = [*_faults(document.get("faults") or ()), _table(document), _computing(document)]
        arrived: Array = np.array([float(run["time_s"]) for run in runs if run["success"]])
        limit = number(setup.get("time_limit_s"))
        limit = limit if limit > 0.0 else max(float(run["time_s"]) for run in runs)
        draw = partial(_arrivals, times=np.sort(arrived), runs=len(runs), limit=limit)
        alt = "share of the runs that arrived against time"
        parts.append(PagePicture("arrivals", "Arrived by then", alt, draw, (9.0, 3.2)))
        failures = [(f["kind"], number(f.get("x")), number(f.get("y"))) for run in runs for f in run["failures"]]
    if failures:
        draw = partial(_places, failures=failures, maze=map_in(setup.get("map"), given.path))
        title = "Where the ball was when something failed"
        parts.append(PagePicture("places", title, "failures by kind and place on the maze", draw, (6.0, 6.4)))
    mean = f", on average after {arrived.mean():.2f}" if len(arrived) else ""
    stderr = f" ± {arrived.std(ddof=1) / math.sqrt(len(arrived)):.2f}" if len(arrived) > 1 else ""
    lead = f"{len(arrived)} of {len(runs)} arrived{mean}{stderr}{' s' * bool(mean)}."
    return PageSection(f"Evaluation {given.name}", lead, setup_facts(setup, seed="first seed"), parts)


def _table(document: dict[str, Any]) -> PageTable:
    from scipy.stats import binomtest  # slow to import; `log info` needs only the runs

    runs, figures = document["results"], document["time_s"]
    arrived = sum(bool(run["success"]) for run in runs)
    share = binomtest(arrived, len(runs)).proportion_ci(0.95, "wilson")
    interval = f"{100.0 * share.low:.0f} to {100.0 * share.high:.0f} %"
    rows = [["arrived", f"{arrived} of {len(runs)}"], ["95 % interval of the share", interval]]
    rows += [[label, words.number(number(figures[key]), 2, "s")] for key, label in TIMES.items()]
    ends = Counter(str(run["reason"]).replace("_", " ") for run in runs if not run["success"])
    rows.append(
        ["runs that did not arrive ended with", ", ".join(f"{k} {n}" for k, n in sorted(ends.items())) or MISSING]
    )
    for kind in sorted({failure["kind"] for run in runs for failure in run["failures"]}):
        counts = Counter(bool(run["success"]) for run in runs for failure in run["failures"] if failure["kind"] == kind)
        label = f"failures {kind.replace('_', ' ')}: in runs that arrived + in the others"
        rows.append([label, f"{counts[True]} + {counts[False]}"])
    return PageTable("In figures; times are of the runs that arrived", ("", ""), rows)


def _computing(document: dict[str, Any]) -> PageTable:
    names = {"planner_ms": "plan", "tick_ms": "tick"}
    rows = [
        [label, *(f"{float(document[key][name]):.2f} ms" for name in ("p50", "p99", "max"))]
        for key, label in names.items()
        if document.get(key)
    ]
    return PageTable("Computing time", ("of", "median", "99 %", "most"), rows)


def _faults(faults: Sequence[dict[str, Any]]) -> list[PageTable | Note]:
    """The table of injected faults, and a note for each broken rule."""
    if not faults:
        return []
    rows, notes = [], []
    for fault in faults:
        after = MISSING if fault["noticed_s"] is None else f"{fault['noticed_s']['p50']:.2f} s"
        ends = [f"{reason} {count}" for reason, count in fault["stopped"].items()]
        ends += [f"cannot be survived: {fault['because']}"] if fault["because"] else []
        arrived, noticed = f"{fault['arrived']} of {fault['runs']}", f"{fault['noticed']} of {fault['faulted']}"
        rows.append([fault["fault"], arrived, noticed, after, ", ".join(fault["recoveries"]), "; ".join(ends)])
        notes += [Note(f"Wrong: {fault['fault']}, {wrong}") for wrong in fault["wrong"]]
    head = ("fault", "arrived", "noticed", "after", "recoveries", "other ends")
    return [PageTable("Injected faults", head, rows), *notes]


def _arrivals(figure: Figure, times: Array, runs: int, limit: float) -> None:
    axes, share = figure.add_subplot(), 100.0 * np.arange(len(times) + 1) / runs
    steps = np.r_[0.0, times, max(limit, times[-1] if len(times) else 0.0)]
    axes.plot(steps, np.r_[share, share[-1]], drawstyle="steps-post", **line("real"))
    axes.set_ylim(0.0, 103.0)
    axes.set_xlim(left=0.0)
    axes.set_ylabel("arrived, % of all runs")
    axes.set_xlabel("time until arrival, s")
    axes.grid(axis="y")


def _places(figure: Figure, failures: list[tuple[str, float, float]], maze: Maze) -> None:
    axes = figure.add_subplot()
    places = np.array([(x, y) for _, x, y in failures])
    draw_maze(maze, axes, path=places[np.isfinite(places).all(axis=1)], ball=False)
    _mark_failures(axes, failures, markersize=6.5, markeredgewidth=0.7, alpha=0.85)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=2)
