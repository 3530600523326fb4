"""The report of an evaluation, from the document of `evaluate --json`. `evaluate --compare` compares two."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import binomtest

from mazeplan.apps.report.inputs import Input, map_in, number, read_as_printed
from mazeplan.apps.report.page import Note, PagePicture, PageSection, PageTable, failure_mark, line
from mazeplan.apps.report.words import MISSING, seconds, setup_facts
from mazeplan.core.errors import InputError
from mazeplan.core.records import Array
from mazeplan.maze.drawing import draw_maze
from mazeplan.maze.geometry import Maze

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TIMES = {"mean": "mean time", "best": "best", "p50": "median", "p95": "95 % are faster than", "worst": "worst"}


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
    """The table of results."""
    runs, figures = document["results"], document["time_s"]
    arrived = sum(bool(run["success"]) for run in runs)
    share = binomtest(arrived, len(runs)).proportion_ci(0.95, "wilson")
    interval = f"{100.0 * share.low:.0f} to {100.0 * share.high:.0f} %"
    rows = [["arrived", f"{arrived} of {len(runs)}"], ["95 % interval of the share", interval]]
    rows += [[label, seconds(number(figures[key]))] for key, label in TIMES.items()]
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
    """Computing time by the wall clock."""
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
    kinds = np.array([kind for kind, *_ in failures])
    for i, kind in enumerate(dict.fromkeys(kinds.tolist())):
        mark = failure_mark(i, markersize=6.5, markeredgewidth=0.7, alpha=0.85)
        axes.plot(*(1e3 * places[kinds == kind].T), label=kind.replace("_", " "), **mark)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=2)
