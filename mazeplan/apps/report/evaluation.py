"""The report of an evaluation, from the document of `evaluate --json`. `evaluate --compare` compares two."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.apps.report.drawing import FAILURE_MARKERS, failure_mark, line
from mazeplan.apps.report.inputs import Input, number, read_as_printed
from mazeplan.apps.report.page import Note, PagePicture, PageSection, PageTable
from mazeplan.apps.report.words import MISSING, seconds, setup_facts
from mazeplan.core.errors import InputError, MapError
from mazeplan.core.records import Array
from mazeplan.maze.drawing import draw_maze
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import check_text, load_map

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Z = 1.959964  # half width of a 95 % interval, in standard deviations
TIMES = {"mean": "mean time", "best": "best", "p50": "median", "p95": "95 % are faster than", "worst": "worst"}


class EvaluatedRuns:
    """The N runs of an evaluation.

    time (N,): time until arrival or end of the run, s.
    arrived (N,): whether the run arrived.
    failures: (kind, x, y in m, whether its run arrived) of each failure."""

    def __init__(self, given: Input) -> None:
        results = given.document["results"]
        if not results:
            raise InputError("got no runs, expected one or more", file=given.path, key="results")
        self.setup = given.document.get("setup") or {}
        self.time: Array = np.array([float(run["time_s"]) for run in results])
        self.arrived = np.array([bool(run["success"]) for run in results])
        self.ends = Counter(str(run["reason"]) for run in results if not run["success"])
        self.failures = [
            (str(failure["kind"]), number(failure.get("x")), number(failure.get("y")), bool(run["success"]))
            for run in results
            for failure in run["failures"]
        ]
        limit = number(self.setup.get("time_limit_s"))
        self.limit = limit if limit > 0.0 else float(self.time.max())

    def figures(self) -> dict[str, float]:
        """Mean, best, median, 95 % and worst time of the runs that arrived, s; NaN if none arrived."""
        times = self.time[self.arrived] if self.arrived.any() else np.array([math.nan])
        p50, p95 = np.percentile(times, [50.0, 95.0])
        values = {"mean": times.mean(), "best": times.min(), "p50": p50, "p95": p95, "worst": times.max()}
        return {name: float(value) for name, value in values.items()}


def interval(successes: int, runs: int) -> tuple[float, float]:
    """95 % interval of the share of successes (Wilson, 1927)."""
    p, zz = successes / runs, Z * Z / runs
    middle = (p + 0.5 * zz) / (1.0 + zz)
    half = Z * math.sqrt(p * (1.0 - p) / runs + 0.25 * zz / runs) / (1.0 + zz)
    return max(middle - half, 0.0), min(middle + half, 1.0)


def evaluation_section(given: Input) -> PageSection:
    """The section of a page about an evaluation. Raises InputError, MapError for a map that cannot be used."""
    with read_as_printed(given):
        runs = EvaluatedRuns(given)
        faults, times = _faults(given.document.get("faults") or ()), _computing(given.document)
    parts: list[Any] = [
        *faults,
        _table(runs),
        times,
        PagePicture(
            "arrivals", "Arrived by then", "share of the runs that arrived against time",
            partial(_arrivals, runs=runs), (9.0, 3.2),
        ),
    ]  # fmt: skip
    if runs.failures:
        parts.append(
            PagePicture(
                "places", "Where the ball was when something failed", "failures by kind and place on the maze",
                partial(_places, runs=runs, maze=_maze_of(given)), (6.0, 6.4),
            )
        )  # fmt: skip
    mean, count = f", on average after {runs.figures()['mean']:.2f}" if runs.arrived.any() else "", runs.arrived.sum()
    stderr = f" ± {runs.time[runs.arrived].std(ddof=1) / math.sqrt(count):.2f}" if count > 1 else ""
    lead = f"{count} of {len(runs.time)} arrived{mean}{stderr}{' s' * bool(mean)}."
    return PageSection(f"Evaluation {given.name}", lead, setup_facts(runs.setup, seed="first seed"), parts)


def _maze_of(given: Input) -> Maze:
    """The map of the evaluation, else cme. Raises MapError for a map with errors."""
    text = (given.document.get("setup") or {}).get("map")
    if text is None:
        return load_map("cme")
    maze = check_text(str(text), file=given.path).maze
    if maze is None:
        raise MapError("the map in it cannot be used", file=given.path, key="setup.map")
    return maze


def _table(runs: EvaluatedRuns) -> PageTable:
    """The table of results."""
    arrived, figures = int(runs.arrived.sum()), runs.figures()
    low, high = (100.0 * end for end in interval(arrived, len(runs.time)))
    rows = [["arrived", f"{arrived} of {len(runs.time)}"], ["95 % interval of the share", f"{low:.0f} to {high:.0f} %"]]
    rows += [[label, seconds(figures[key])] for key, label in TIMES.items()]
    ends = ", ".join(f"{k.replace('_', ' ')} {n}" for k, n in sorted(runs.ends.items()))
    rows.append(["runs that did not arrive ended with", ends or MISSING])
    for kind in sorted({kind for kind, *_ in runs.failures}):
        count = Counter(arrived for name, _, _, arrived in runs.failures if name == kind)
        label = f"failures {kind.replace('_', ' ')}: in runs that arrived + in the others"
        rows.append([label, f"{count[True]} + {count[False]}"])
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


def _arrivals(figure: Figure, runs: EvaluatedRuns) -> None:
    axes, t = figure.add_subplot(), np.sort(runs.time[runs.arrived])
    share = 100.0 * np.arange(len(t) + 1) / len(runs.time)
    steps = np.r_[0.0, t, max(runs.limit, t[-1] if len(t) else 0.0)]
    axes.plot(steps, np.r_[share, share[-1]], drawstyle="steps-post", **line("real"))
    axes.set_ylim(0.0, 103.0)
    axes.set_xlim(left=0.0)
    axes.set_ylabel("arrived, % of all runs")
    axes.set_xlabel("time until arrival, s")
    axes.grid(axis="y")


def _places(figure: Figure, runs: EvaluatedRuns, maze: Maze) -> None:
    axes = figure.add_subplot()
    places = np.array([(x, y) for _, x, y, _ in runs.failures])
    draw_maze(maze, axes, path=places[np.isfinite(places).all(axis=1)], ball=False)
    kinds = np.array([kind for kind, *_ in runs.failures])
    for kind, marker in zip(dict.fromkeys(kinds.tolist()), FAILURE_MARKERS, strict=False):
        mark = failure_mark(marker, markersize=6.5, markeredgewidth=0.7, alpha=0.85)
        axes.plot(*(1e3 * places[kinds == kind].T), label=kind.replace("_", " "), **mark)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=2)
