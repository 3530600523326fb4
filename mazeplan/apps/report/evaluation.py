"""The report of one evaluation, or of several side by side, from the documents of `evaluate --json`."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.apps.report import published
from mazeplan.apps.report.drawing import (
    FAILURE_MARKERS,
    INK,
    failure_mark,
    legend_beside,
    line,
    plan_view,
    series,
)  # fmt: skip
from mazeplan.apps.report.evaluation_runs import (
    EvaluatedRuns,
    as_published,
    by_kind,
    figures,
    interval,
    maze_of,
    places,
    runs_of,
)  # fmt: skip
from mazeplan.apps.report.inputs import Input
from mazeplan.apps.report.page import PagePicture, PageSection, PageTable
from mazeplan.apps.report.words import MISSING, seconds, setup_facts
from mazeplan.core.palette import COLOURS, INKS, MARKERS
from mazeplan.maze.geometry import Maze

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAPER = "published, hardware"
HATCH = ("", "///", "...", "xx", "\\\\\\")
TIMES = {"mean": "mean time", "best": "best", "p50": "median", "p95": "95 % are faster than", "worst": "worst"}
Several = Sequence[EvaluatedRuns]


def evaluation_section(given: Sequence[Input]) -> PageSection:
    """The section of a page about evaluations. Raises MapError for a map that cannot be used."""
    maze, names = maze_of(given), Counter[str]()
    several = []
    for part in given:
        names[part.name] += 1
        several.append(runs_of(part, part.name if names[part.name] == 1 else f"{part.name} ({names[part.name]})"))
    parts: list[Any] = [_table(several, as_published(maze)), *evaluation_pictures(several, maze)]
    if any(by_kind(runs) for runs in several):
        parts.append(_kinds_table(several))
    alone = len(several) == 1
    title = f"Evaluation {several[0].name}" if alone else "Evaluations: " + ", ".join(runs.name for runs in several)
    facts = setup_facts(dict(several[0].setup), seed="first seed") if alone else []
    return PageSection(title, _lead(several), facts, parts)


def _lead(several: Several) -> str:
    parts = []
    for runs in several:
        mean = f", on average after {figures(runs)['mean']:.2f} s" if runs.arrived.any() else ""
        parts.append(f"{'' if len(several) == 1 else runs.name + ': '}{runs.share} arrived{mean}")
    return "; ".join(parts) + "."


def _table(several: Several, compared: bool) -> PageTable:
    """The table of results. compared: also show the published times, in the last column."""
    ends = [Counter(run.reason for run in runs.results if not run.success) for runs in several]
    why = [", ".join(f"{k.replace('_', ' ')} {n}" for k, n in sorted(e.items())) or MISSING for e in ends]
    counts = [(int(runs.arrived.sum()), len(runs.time)) for runs in several] + [(published.ARRIVED, published.RUNS)]
    rows = [
        ["arrived", *(f"{a} of {n}" for a, n in counts)],
        [
            "95 % interval of the share",
            *("{:.0f} to {:.0f} %".format(*(100 * p for p in interval(*c))) for c in counts),
        ],
    ]
    for key, label in TIMES.items():
        values = [figures(runs)[key] for runs in several]
        rows.append([label, *map(seconds, [*values, published.TIMES.get(key, math.nan)])])
    rows.append(["failures on the way", *(str(len([*runs.failures()])) for runs in several), MISSING])
    rows.append(["runs that did not arrive ended with", *why, MISSING])
    if len(several) > 1:
        for key, label in (("rig", "rig"), ("model", "model"), ("map_name", "map"), ("version", "mazeplan")):
            rows.append([label, *(str(dict(runs.setup).get(key) or MISSING) for runs in several), MISSING])
    head = ["", *(runs.name for runs in several), "published, on hardware"]
    if not compared:
        head, rows = head[:-1], [row[:-1] for row in rows]
    return PageTable("In figures; times are of the runs that arrived", head, rows)


def _kinds_table(several: Several) -> PageTable:
    counted = [by_kind(runs) for runs in several]
    rows = [
        [kind.replace("_", " "), *("{} + {}".format(*counts.get(kind, (0, 0))) for counts in counted)]
        for kind in sorted({kind for counts in counted for kind in counts})
    ]
    return PageTable("Failures: in runs that arrived + in the others", ("kind", *(r.name for r in several)), rows)


# -- pictures ----------------------------------------------------------------------------------------------------------


def evaluation_pictures(several: Several, maze: Maze) -> list[PagePicture]:
    """All pictures, in the order of the page. A picture shows the evaluations side by side, or one below the other."""
    n, marks = len(several), as_published(maze)
    kinds = list(dict.fromkeys(kind for runs in several for kind in by_kind(runs)))
    found = [
        PagePicture(
            "arrivals", "Arrived by then" + ("; the published times as marks" if marks else ""),
            "share of the runs that have arrived against time, and the times of each run",
            partial(_arrivals, several=several, marks=marks), (9.0, 3.2 + 0.45 * (n + 1)),
        ),
    ]  # fmt: skip
    if kinds:
        found += [
            PagePicture(
                "kinds", "Failures by kind", "number of failures by kind, in runs that arrived and in the others",
                partial(_kinds, several=several, kinds=kinds), (9.0, 1.2 + 0.3 * len(kinds) * max(n, 1.4)),
            ),
            PagePicture(
                "places", "Where the ball was when something failed", "failures by kind and place on the maze",
                partial(_places, several=several, maze=maze, kinds=kinds), (min(6.0 * n, 12.0), 6.4 if n < 3 else 5.0),
            ),
        ]  # fmt: skip
    return found


def _arrivals(figure: Figure, several: Several, marks: bool = True) -> None:
    """marks: also draw the published times, which hold for one maze only."""
    rows = len(several) + marks
    upper, lower = figure.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": (2.4, 0.45 * rows)})
    for i, runs in enumerate(several):
        t = np.sort(runs.time[runs.arrived])
        share = 100.0 * np.arange(len(t) + 1) / len(runs.time)
        steps = np.r_[0.0, t, max(runs.limit, t[-1] if len(t) else 0.0)]
        upper.plot(steps, np.r_[share, share[-1]], drawstyle="steps-post", **line(series(i)), label=runs.name)
        _strip(lower, runs, i)
    if marks:
        _published(upper, lower, len(several))
    upper.set_ylim(0.0, 103.0)
    upper.set_ylabel("arrived, % of all runs")
    upper.grid(axis="y")
    legend_beside(upper)
    lower.set_yticks(range(rows), [*(_short(runs.name) for runs in several), *([PAPER] * marks)], fontsize=8)
    lower.set_ylim(rows - 0.4, -0.6)
    lower.set_xlabel("time until arrival, s    (diamond or line: mean;  X at the limit: did not arrive)")
    slowest = [r.limit if not r.arrived.all() else r.time.max() for r in several]
    lower.set_xlim(0.0, 1.06 * float(max(slowest + [published.TIMES["worst"]] * marks)))


def _published(upper: Axes, lower: Axes, y: int) -> None:
    """Draw the published times: as lines in both panels, and in row y of the lower panel."""
    times, reached = published.TIMES, 100.0 * published.ARRIVED / published.RUNS
    lower.plot([times["best"], times["worst"]], [y, y], color=INK, lw=1.2, marker="|", ms=9)
    lower.plot([times["mean"]], [y], marker="D", color=INK, ms=6)
    words = f"{PAPER}:\n{published.ARRIVED} of {published.RUNS}, at the mean time"
    upper.plot([times["mean"]], [reached], marker="D", color=INK, ms=6, ls="none", label=words)
    upper.hlines(reached, times["best"], times["worst"], color=INK, lw=1.0)
    for name, time in times.items():
        for axes in (upper, lower):
            axes.axvline(time, color=COLOURS["neutral"], lw=0.8, ls=(0, (1.0, 1.5)), zorder=0)
        upper.text(time, 103.0, f"{name}\n{time:g} s", ha="center", va="bottom", fontsize=7, color=INKS["quiet"])


def _spread_out(count: int) -> np.ndarray:
    """Offsets from -0.5 to 0.5 that keep neighbouring points apart."""
    return np.mod(np.arange(count) * 0.618, 1.0) - 0.5


def _strip(axes: Axes, runs: EvaluatedRuns, row: int) -> None:
    """Draw a point for each run that arrived, a line at their mean, and a cross with the number of the other runs."""
    name, t = series(row), runs.time[runs.arrived]
    beside = row + 0.5 * _spread_out(len(t))
    axes.plot(t, beside, marker=MARKERS[name], ls="none", color=COLOURS[name], ms=4, mec="white", mew=0.4)
    if len(t):
        axes.plot([t.mean()] * 2, [row - 0.38, row + 0.38], color=INK, lw=2.0, solid_capstyle="butt")
    lost = int((~runs.arrived).sum())
    if lost:
        axes.plot([runs.limit], [row], marker="X", color=COLOURS["failure"], ms=8, mec="white", clip_on=False, zorder=5)
        axes.annotate(f"{lost}", (runs.limit, row), xytext=(-8, 0), textcoords="offset points", va="center", ha="right")


def _short(name: str, most: int = 26) -> str:
    return name if len(name) <= most else name[: most - 1] + "…"


def _whole(most: int, **more: Any) -> Any:
    """Ticks at whole numbers."""
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(most, integer=True, **more)


def _pale(name: str) -> tuple[float, ...]:
    from matplotlib.colors import to_rgb

    return tuple(1.0 - 0.25 * (1.0 - c) for c in to_rgb(COLOURS[name]))


def _kinds(figure: Figure, several: Several, kinds: Sequence[str]) -> None:
    axes, height = figure.add_subplot(), 0.8 / len(several)
    for i, runs in enumerate(several):
        counts = by_kind(runs)
        y = [k - 0.4 + (i + 0.5) * height for k in range(len(kinds))]
        over, lost = ([counts.get(kind, (0, 0))[j] for kind in kinds] for j in (0, 1))
        name = "" if len(several) == 1 else f"{_short(runs.name)}: "
        style = {"facecolor": _pale(series(i)), "edgecolor": COLOURS[series(i)], "hatch": HATCH[i % len(HATCH)]}
        axes.barh(y, over, height * 0.85, label=f"{name}in runs that arrived", **style)
        if any(lost):
            label = f"{name}in runs that did not"
            axes.barh(y, lost, height * 0.85, left=over, color=COLOURS["failure"], label=label)
        for at, a, b in zip(y, over, lost, strict=True):
            if a + b:
                axes.text(a + b, at, f" {a + b}", va="center", fontsize=8)
    axes.set_yticks(range(len(kinds)), [kind.replace("_", " ") for kind in kinds])
    axes.set_ylim(len(kinds) - 0.5, -0.5)
    axes.set_xlabel("failures, number in all runs")
    axes.margins(x=0.08)
    axes.xaxis.set_major_locator(_whole(8))
    legend_beside(axes)


def _places(figure: Figure, several: Several, maze: Maze, kinds: Sequence[str]) -> None:
    panels = figure.subplots(1, len(several), squeeze=False)[0]
    for axes, runs in zip(panels, several, strict=True):
        known = places(runs)
        plan_view(axes, maze, np.array([(x, y) for _, x, y in known]).reshape(-1, 2))
        for kind, marker in zip(kinds, FAILURE_MARKERS, strict=False):
            at = 1e3 * np.array([(x, y) for k, x, y in known if k == kind]).reshape(-1, 2)
            if len(at):
                mark = failure_mark(marker, markersize=6.5, markeredgewidth=0.7, alpha=0.85)
                axes.plot(*at.T, label=f"{kind.replace('_', ' ')}, {len(at)}", **mark)
        without = len([*runs.failures()]) - len(known)
        more = f"{without} without a place" if without else "" if known else "none"
        axes.set_title(_short(runs.name) + (f" ({more})" if more else ""))
        if known:
            axes.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=2)
