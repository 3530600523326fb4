"""The report of a run, from its log."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.apps.report.drawing import (
    ENDINGS,
    FAILURE_MARKERS,
    INK,
    darker,
    draw_ending,
    empty_panel,
    ending,
    endings_met,
    failure_mark,
    legend_beside,
    line,
    round_the_ring,
)  # fmt: skip
from mazeplan.apps.report.page import STYLE, PagePicture, PageSection, PageTable
from mazeplan.apps.report.run_record import (
    AHEAD,
    LoggedFailure,
    Visit,
    end_of,
    labels,
    leaf_bars,
    logged_failures,
    maze_of,
    second_trail,
    span_of,
    theta_lines,
    times_ms,
    trail,
    visits,
)  # fmt: skip
from mazeplan.apps.report.words import ANGLE, BETA, DEG, GAMMA, MISSING, TIME, setup_facts
from mazeplan.core.errors import LogError
from mazeplan.core.logs.run_log import RunLog
from mazeplan.core.maths.angles import nearest
from mazeplan.core.palette import COLOURS, TINTS
from mazeplan.core.records import Array
from mazeplan.maze.drawing import draw_maze, draw_second
from mazeplan.maze.geometry import Maze

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_LEAVES, MOST_LETTERS, LEAF_FONT = 60, 40, 7.5  # picture of the tree: most rows, most letters of a name, font size
LEGEND_IN = 1.85  # inches for the legend beside pictures over time
Markers = dict[str, str]  # {kind of failure: marker}


def run_section(log: RunLog) -> PageSection:
    """The section of a page about a run. Raises LogError for a log without a tick."""
    if not len(log.ticks["t"]):
        raise LogError("got a log without a single tick, expected one of a run", file=log.path)
    maze, failures = maze_of(log), logged_failures(log)
    facts = [("log", log.path.name + ("" if log.complete else " (cut off)")), *setup_facts(log.header)]
    parts: list[Any] = [_rings_table(log), *run_pictures(log, maze), _times_table(log)]
    if failures:
        parts.insert(1, _failures_table(failures))
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


def spread_of(values: Array) -> tuple[float, float, float]:
    """Median, 99th percentile and maximum; NaN without values."""
    values = values[np.isfinite(values)]
    if not len(values):
        return math.nan, math.nan, math.nan
    p50, p99 = np.percentile(values, [50.0, 99.0])
    return float(p50), float(p99), float(values.max())


def _rings_table(log: RunLog) -> PageTable:
    rows = [[f"{v.ring}", f"{v.start:.2f} s", f"{v.end - v.start:.2f} s", v.opening or MISSING] for v in visits(log)]
    return PageTable("Rings", ("ring", "entered at", "time in it", "left by"), rows)


def _failures_table(failures: list[LoggedFailure]) -> PageTable:
    rows = [
        [f"{m.t:.2f} s", m.kind.replace("_", " "), m.where, m.detail, m.recovery.replace("_", " ") or MISSING]
        for m in failures
    ]
    return PageTable("Failures and recoveries", ("at", "kind", "where", "detail", "recovery"), rows)


def _times_table(log: RunLog) -> PageTable:
    rows = []
    for label, values in times_ms(log).items():
        spread = spread_of(values)
        if math.isfinite(spread[0]):
            rows.append([label, f"{len(values)}", *(f"{value:.2f} ms" for value in spread)])
    return PageTable("Computing time", ("of", "number", "median", "99 %", "most"), rows)


# -- pictures ----------------------------------------------------------------------------------------------------------


def run_pictures(log: RunLog, maze: Maze) -> list[PagePicture]:
    """All pictures, in the order of the page."""
    failures = logged_failures(log)
    markers: Markers = dict(zip(dict.fromkeys(m.kind for m in failures), FAILURE_MARKERS, strict=False))
    leaves = _leaf_names(log)
    marked = {"failures": failures, "markers": markers}
    over_time = {"log": log, "left": _left_of(leaves.values())}
    return [
        PagePicture(
            "path", "The ball's path; colour is time", "path of the ball over the maze, coloured by time",
            partial(_path, log=log, maze=maze, **marked), (7.4, 6.4),
        ),
        PagePicture(
            "theta", f"Angle in each ring: as planned {AHEAD} s before, and real",
            "angle of the ball against time, as planned and as it was",
            partial(_theta, maze=maze, **over_time, **marked), (9.0, 4.6), automatic=False,
        ),
        PagePicture(
            "tree", "What the tree did: its leaves over time", "Gantt chart of the leaves of the behaviour tree",
            partial(_gantt, named=leaves, **over_time, **marked), (9.0, 1.4 + 0.21 * max(len(leaves), 4)),
            automatic=False,
        ),
        PagePicture(
            "tilt", "Tilt of the plate, commanded and measured", "tilt of both axes against time",
            partial(_tilt, **over_time, **marked), (9.0, 4.0), automatic=False,
        ),
    ]  # fmt: skip


def _leaf_names(log: RunLog) -> dict[str, str]:
    """{path: label} of the leaves that the picture of the tree shows. A long label loses its beginning."""
    named = list(labels(leaf_bars(log)).items())[:MOST_LEAVES]
    return {path: label if len(label) <= MOST_LETTERS else "…" + label[1 - MOST_LETTERS :] for path, label in named}


def _left_of(names: Iterable[str]) -> float:
    """Left margin of all pictures over time, inches, with room for the longest name of a leaf."""
    from matplotlib import rc_context
    from matplotlib.textpath import TextPath

    with rc_context(STYLE):
        widths = [TextPath((0.0, 0.0), name, size=LEAF_FONT).get_extents().width / 72.0 for name in names]
    return max(0.9, 0.2 + max(widths, default=0.0))


def _panels(figure: Figure, log: RunLog, left: float, ratios: Sequence[float] = (1.0,)) -> list[Axes]:
    """Panels over time, one above the other.

    In all pictures of a run they begin and end at the same place (inches) and time (s). So a reader can follow an
    instant straight down the page."""
    width, height = figure.get_size_inches()
    grid = {"height_ratios": ratios, "left": left / width, "right": 1.0 - LEGEND_IN / width, "hspace": 0.13,
            "bottom": 0.5 / height, "top": 1.0 - 0.3 / height}  # fmt: skip
    panels = list(figure.subplots(len(ratios), 1, sharex=True, squeeze=False, gridspec_kw=grid)[:, 0])
    first, last = span_of(log)
    panels[0].set_xlim(first - 0.01 * (last - first), last + 0.01 * (last - first))
    panels[-1].set_xlabel(TIME)
    return panels


def _path(figure: Figure, log: RunLog, maze: Maze, failures: list[LoggedFailure], markers: Markers) -> None:
    from matplotlib.collections import LineCollection

    axes, place = figure.add_subplot(), trail(log)
    whole = np.asarray(np.isfinite(place).all(axis=1))
    if whole.sum() < 2:
        return empty_panel(axes, "the ball was not seen")
    draw_maze(maze, axes, path=place[whole, :2])
    points = 1e3 * place[:, :2]
    together = whole[:-1] & whole[1:]
    pieces = np.stack([points[:-1], points[1:]], axis=1)[together]
    lines = LineCollection(list(pieces), linewidths=1.8, capstyle="round", zorder=4, cmap=darker())
    lines.set_array(0.5 * (place[:-1, 2] + place[1:, 2])[together])
    axes.add_collection(lines)
    figure.colorbar(lines, ax=axes, shrink=0.6, pad=0.02, aspect=30).set_label(TIME)
    second = second_trail(log)
    if second is not None:
        draw_second(axes, second)
    for kind, marker in markers.items():
        at = np.array([(m.x, m.y) for m in failures if m.kind == kind])
        axes.plot(*(1e3 * at.T), **failure_mark(marker), label=kind.replace("_", " "))
    if markers or second is not None:
        title = "failures" if markers and second is None else None
        axes.legend(loc="upper left", bbox_to_anchor=(-0.02, 1.0), title=title)
    return None


def _bands(axes: Axes, stays: list[Visit], named: bool) -> None:
    """Shade every second stay in a ring, behind a picture over time. named: write the numbers of the rings above."""
    for i, visit in enumerate(stays):
        length = visit.end - visit.start
        if i % 2 == 0:
            axes.axvspan(visit.start, visit.end, color=TINTS["band"], lw=0, zorder=0)
        if named and length > 0.02 * (stays[-1].end - stays[0].start):
            text = f"ring {visit.ring}" if length > 0.09 * stays[-1].end else f"{visit.ring}"
            axes.text(0.5 * (visit.start + visit.end), 1.01, text, transform=axes.get_xaxis_transform(), ha="center",
                      va="bottom", fontsize=8)  # fmt: skip


def _failure_lines(axes: Axes, failures: list[LoggedFailure], markers: Markers, named: bool = False) -> None:
    """Draw a line at each failure, with the marker of its kind at the top. named: label them for a legend."""
    seen: set[str] = set()
    for m in failures:
        axes.axvline(m.t, color=COLOURS["failure"], lw=0.7, ls=(0, (1.0, 1.5)), zorder=1)
        label = m.kind.replace("_", " ") if named and m.kind not in seen else None
        seen.add(m.kind)
        mark = failure_mark(markers.get(m.kind, "X"), markersize=6.5, clip_on=False)
        axes.plot([m.t], [0.97], transform=axes.get_xaxis_transform(), label=label, **mark)


def _theta(
    figure: Figure, log: RunLog, left: float, maze: Maze, failures: list[LoggedFailure], markers: Markers
) -> None:
    upper, lower = _panels(figure, log, left, (2.6, 1.0))
    parts = theta_lines(log, maze)
    if not parts:
        return empty_panel(upper, "the ball was in no ring with a channel")
    for axes in (upper, lower):
        _bands(axes, visits(log), named=axes is upper)
        axes.grid(axis="y")
    for i, (visit, t, real, planned) in enumerate(parts):
        names = ("real", f"planned {AHEAD} s before", "opening it left by") if i == 0 else (None, None, None)
        upper.plot(t, real, **line("real"), label=names[0])
        upper.plot(t, planned, **line("planned", linewidth=1.8), label=names[1])
        lower.plot(t, real - planned, **line("real"))
        angle = next((o.angle for o in maze.openings if o.name == visit.opening), None)
        if angle is not None and np.isfinite(real).any():
            end = real[np.isfinite(real)][-1]
            there = math.degrees(nearest(angle, math.radians(end)))
            upper.plot(visit.end, there, "<", color=INK, markersize=6, zorder=6, label=names[2])
    _failure_lines(upper, failures, markers, named=True)
    round_the_ring(upper.yaxis)
    upper.set_ylabel(ANGLE)
    lower.set_ylabel("real less\nplanned, degrees")
    lower.axhline(0.0, color=INK, lw=0.6)
    legend_beside(upper)
    return None


def _gantt(
    figure: Figure, log: RunLog, left: float, named: dict[str, str], failures: list[LoggedFailure], markers: Markers
) -> None:
    (axes,), bars = _panels(figure, log, left), leaf_bars(log)
    if not bars:
        return empty_panel(axes, "the log has no leaf")
    asked = {tree.outline.paths[i] for tree in log.trees for i in tree.outline.conditions or ()}
    met: set[str] = set()
    rows = {path: i for i, path in enumerate(named)}
    axes.set_autoscale_on(False)  # otherwise each new bar would go through all earlier ones
    _bands(axes, visits(log), named=True)
    for bar in bars:
        if bar.path not in rows or bar.status not in ENDINGS:
            continue
        name = ending(bar.status, bar.path in asked)
        met.add(name)
        draw_ending(axes, name, rows[bar.path], bar.start, bar.end)
    _failure_lines(axes, failures, markers)
    axes.set_yticks(list(rows.values()), [named[path] for path in rows], fontsize=LEAF_FONT)
    axes.set_ylim(len(rows) - 0.4, -1.4 if failures else -0.7)
    axes.grid(axis="x")
    legend_beside(axes, handles=endings_met(met), title="last tick")
    return None


def _tilt(figure: Figure, log: RunLog, left: float, failures: list[LoggedFailure], markers: Markers) -> None:
    panels, t = _panels(figure, log, left, (1.0, 1.0)), log.ticks["t"]
    for axes, name, label in zip(panels, ("beta", "gamma"), (BETA, GAMMA), strict=True):
        _bands(axes, visits(log), named=axes is panels[0])
        axes.plot(t, DEG * log.ticks[f"u_{name}"], drawstyle="steps-post", **line("commanded"), label="commanded")
        axes.plot(t, DEG * log.ticks[name], **line("measured"), label="measured")
        _failure_lines(axes, failures if axes is panels[0] else [], markers)
        axes.set_ylabel(label.replace(" (", "\n("))
        axes.grid(axis="y")
    legend_beside(panels[0])
