"""The report of one evaluation, or of several side by side, from the documents of `evaluate --json`."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.apps.report.drawing import FAILURE_MARKERS, SERIES, failure_mark, legend_beside, line
from mazeplan.apps.report.inputs import Input, number, read_as_printed
from mazeplan.apps.report.page import PagePicture, PageSection, PageTable
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
    """One evaluation of N runs.

    time (N,): time until arrival or end of the run, s.
    arrived (N,): whether the run arrived.
    failures: (kind, x, y in m, whether its run arrived) of each failure."""

    def __init__(self, given: Input, name: str = "") -> None:
        results = given.document["results"]
        if not results:
            raise InputError("got no runs, expected one or more", file=given.path, key="results")
        self.name, self.setup = name or given.name, given.document.get("setup") or {}
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


Several = Sequence[EvaluatedRuns]


def interval(successes: int, runs: int) -> tuple[float, float]:
    """95 % interval of the share of successes (Wilson, 1927)."""
    p, zz = successes / runs, Z * Z / runs
    middle = (p + 0.5 * zz) / (1.0 + zz)
    half = Z * math.sqrt(p * (1.0 - p) / runs + 0.25 * zz / runs) / (1.0 + zz)
    return max(middle - half, 0.0), min(middle + half, 1.0)


def evaluation_section(given: Sequence[Input]) -> PageSection:
    """The section of a page about evaluations. Raises InputError, MapError for a map that cannot be used."""
    names, several = Counter[str](), list[EvaluatedRuns]()
    for part in given:
        names[part.name] += 1
        with read_as_printed(part):
            several.append(EvaluatedRuns(part, part.name + f" ({names[part.name]})" * (names[part.name] > 1)))
    kinds = sorted({kind for runs in several for kind, *_ in runs.failures})
    parts: list[Any] = [_table(several, kinds), *_pictures(several, _maze_of(given), kinds)]
    alone = len(several) == 1
    title = f"Evaluation {several[0].name}" if alone else "Evaluations: " + ", ".join(runs.name for runs in several)
    facts = setup_facts(several[0].setup, seed="first seed") if alone else []
    return PageSection(title, _lead(several), facts, parts)


def _maze_of(evaluations: Sequence[Input]) -> Maze:
    """The map of the first evaluation that has one, else cme. Raises MapError for a map with errors."""
    for given in evaluations:
        text = (given.document.get("setup") or {}).get("map")
        if text is not None:
            maze = check_text(str(text), file=given.path).maze
            if maze is None:
                raise MapError("the map in it cannot be used", file=given.path, key="setup.map")
            return maze
    return load_map("cme")


def _lead(several: Several) -> str:
    parts = []
    for runs in several:
        mean = f", on average after {runs.figures()['mean']:.2f} s" if runs.arrived.any() else ""
        share = f"{int(runs.arrived.sum())} of {len(runs.time)}"
        parts.append(f"{'' if len(several) == 1 else runs.name + ': '}{share} arrived{mean}")
    return "; ".join(parts) + "."


def _table(several: Several, kinds: Sequence[str]) -> PageTable:
    """The table of results."""
    rows = [["arrived", *(f"{int(runs.arrived.sum())} of {len(runs.time)}" for runs in several)]]
    shares = [[100.0 * end for end in interval(int(runs.arrived.sum()), len(runs.time))] for runs in several]
    rows.append(["95 % interval of the share", *(f"{low:.0f} to {high:.0f} %" for low, high in shares)])
    rows += [[label, *(seconds(runs.figures()[key]) for runs in several)] for key, label in TIMES.items()]
    ends = [", ".join(f"{k.replace('_', ' ')} {n}" for k, n in sorted(runs.ends.items())) for runs in several]
    rows.append(["runs that did not arrive ended with", *(end or MISSING for end in ends)])
    for kind in kinds:
        counts = (Counter(arrived for name, _, _, arrived in runs.failures if name == kind) for runs in several)
        label = f"failures {kind.replace('_', ' ')}: in runs that arrived + in the others"
        rows.append([label, *(f"{count[True]} + {count[False]}" for count in counts)])
    if len(several) > 1:
        for key, label in (("rig", "rig"), ("model", "model"), ("map_name", "map"), ("version", "mazeplan")):
            rows.append([label, *(str(runs.setup.get(key) or MISSING) for runs in several)])
    head = ["", *(runs.name for runs in several)]
    return PageTable("In figures; times are of the runs that arrived", head, rows)


# -- pictures ----------------------------------------------------------------------------------------------------------


def _pictures(several: Several, maze: Maze, kinds: Sequence[str]) -> list[PagePicture]:
    """All pictures, in the order of the page. A picture shows the evaluations together, or side by side."""
    found = [
        PagePicture(
            "arrivals", "Arrived by then", "share of the runs that arrived against time",
            partial(_arrivals, several=several), (9.0, 3.2),
        ),
    ]  # fmt: skip
    if kinds:
        n = len(several)
        found.append(
            PagePicture(
                "places", "Where the ball was when something failed", "failures by kind and place on the maze",
                partial(_places, several=several, maze=maze, kinds=kinds), (min(6.0 * n, 12.0), 6.4 if n < 3 else 5.0),
            )
        )  # fmt: skip
    return found


def _arrivals(figure: Figure, several: Several) -> None:
    axes = figure.add_subplot()
    for i, runs in enumerate(several):
        t = np.sort(runs.time[runs.arrived])
        share = 100.0 * np.arange(len(t) + 1) / len(runs.time)
        steps = np.r_[0.0, t, max(runs.limit, t[-1] if len(t) else 0.0)]
        style = line(SERIES[i % len(SERIES)])
        axes.plot(steps, np.r_[share, share[-1]], drawstyle="steps-post", **style, label=runs.name)
    axes.set_ylim(0.0, 103.0)
    axes.set_xlim(left=0.0)
    axes.set_ylabel("arrived, % of all runs")
    axes.set_xlabel("time until arrival, s")
    axes.grid(axis="y")
    legend_beside(axes)


def _places(figure: Figure, several: Several, maze: Maze, kinds: Sequence[str]) -> None:
    panels = figure.subplots(1, len(several), squeeze=False)[0]
    for axes, runs in zip(panels, several, strict=True):
        known = [(kind, x, y) for kind, x, y, _ in runs.failures if math.isfinite(x) and math.isfinite(y)]
        places = np.array([(x, y) for _, x, y in known]).reshape(-1, 2)
        draw_maze(maze, axes, path=places, ball=False)
        for kind, marker in zip(kinds, FAILURE_MARKERS, strict=False):
            at = 1e3 * places[[k == kind for k, *_ in known]]
            if len(at):
                mark = failure_mark(marker, markersize=6.5, markeredgewidth=0.7, alpha=0.85)
                axes.plot(*at.T, label=f"{kind.replace('_', ' ')}, {len(at)}", **mark)
        axes.set_title(runs.name)
        if known:
            axes.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=2)
