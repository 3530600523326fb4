"""Pictures of a run."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.data.runlog import STATUSES, RunLog
from mazeplan.maze.drawing import draw_maze
from mazeplan.maze.geometry import Maze
from mazeplan.palette import COLOURS
from mazeplan.report.drawing import FAILURE_MARKERS, INK, area, darker, line, nothing
from mazeplan.report.page import Picture
from mazeplan.report.run import AHEAD, Mishap, Visit, mishaps, theta_lines, times_ms, trail, visits
from mazeplan.report.timeline import labels, leaf_bars
from mazeplan.report.words import ANGLE, BETA, GAMMA

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DEG = 180.0 / math.pi
DRAWN_AS = {STATUSES[name]: name.lower() for name in ("RUNNING", "SUCCESS", "FAILURE", "SKIPPED")}
MEANING = {
    "running": "running",
    "success": "succeeded",
    "failure": "failed",
    "skipped": "skipped",
    "no": "no (a condition)",
}
CONDITIONS = frozenset({"BallSeen", "InRing", "FailureIs"})  # in older logs: their failure is the answer no
MOST_LEAVES = 60
Kinds = dict[str, str]  # kind of failure -> its marker


def run_pictures(log: RunLog, maze: Maze) -> list[Picture]:
    """All of them, in the order in which they are looked at."""
    failures = mishaps(log)
    kinds: Kinds = dict(zip(dict.fromkeys(m.kind for m in failures), FAILURE_MARKERS, strict=False))
    rows = min(len({bar.path for bar in leaf_bars(log)}), MOST_LEAVES)
    return [
        Picture(
            "path", "The ball's path; colour is time", "path of the ball over the maze, coloured by time",
            lambda figure: _path(figure, log, maze, failures, kinds), (7.4, 6.4),
        ),
        Picture(
            "theta", f"Angle in each ring: as planned {AHEAD} s before, and real",
            "angle of the ball against time, as planned and as it was",
            lambda figure: _theta(figure, log, maze, failures, kinds), (9.0, 4.6),
        ),
        Picture(
            "tree", "What the tree did: its leaves over time", "Gantt chart of the leaves of the behaviour tree",
            lambda figure: _gantt(figure, log, failures, kinds), (9.0, 1.4 + 0.21 * max(rows, 4)),
        ),
        Picture(
            "tilt", "Tilt of the plate, commanded and measured", "tilt of both axes against time",
            lambda figure: _tilt(figure, log, failures, kinds), (9.0, 4.0),
        ),
        Picture(
            "times", "What plans and ticks took", "planner and tick times against the time of a sample",
            lambda figure: _times(figure, log), (9.0, 3.2),
        ),
    ]  # fmt: skip


def _path(figure: Figure, log: RunLog, maze: Maze, failures: list[Mishap], kinds: Kinds) -> None:
    from matplotlib.collections import LineCollection

    axes = figure.add_subplot()
    place = trail(log)
    whole = np.asarray(np.isfinite(place).all(axis=1))
    if whole.sum() < 2:
        return nothing(axes, "the ball was not seen")
    draw_maze(maze, axes, path=place[whole, :2])
    points = 1e3 * place[:, :2]
    together = whole[:-1] & whole[1:]
    pieces = np.stack([points[:-1], points[1:]], axis=1)[together]
    lines = LineCollection(list(pieces), linewidths=1.8, capstyle="round", zorder=4, cmap=darker())
    lines.set_array(0.5 * (place[:-1, 2] + place[1:, 2])[together])
    axes.add_collection(lines)
    bar = figure.colorbar(lines, ax=axes, shrink=0.6, pad=0.02, aspect=30)
    bar.set_label("time, s")
    for kind, marker in kinds.items():
        at = np.array([(m.x, m.y) for m in failures if m.kind == kind])
        axes.plot(*(1e3 * at.T), **_mark(marker), label=kind.replace("_", " "))
    if kinds:
        axes.legend(loc="upper left", bbox_to_anchor=(-0.02, 1.0), title="failures")
    return None


def _mark(marker: str) -> dict[str, Any]:
    """A failure."""
    return {
        "marker": marker, "color": COLOURS["failure"], "linestyle": "none", "markersize": 8.0,
        "markeredgecolor": "white", "markeredgewidth": 0.9, "zorder": 8,
    }  # fmt: skip


def _bands(axes: Axes, stays: list[Visit], named: bool) -> None:
    """Which ring, behind a picture over time."""
    for i, visit in enumerate(stays):
        if i % 2 == 0:
            axes.axvspan(visit.start, visit.end, color="#f1f3f6", lw=0, zorder=0)
        if named and visit.end - visit.start > 0.02 * (stays[-1].end - stays[0].start):
            at = 0.5 * (visit.start + visit.end)
            text = f"ring {visit.ring}" if visit.end - visit.start > 0.09 * stays[-1].end else f"{visit.ring}"
            axes.text(at, 1.01, text, transform=axes.get_xaxis_transform(), ha="center", va="bottom", fontsize=8)


def _failure_lines(axes: Axes, failures: list[Mishap], kinds: Kinds, named: bool = False) -> None:
    """When something went wrong: a line down, with the marker of its kind on top."""
    told: set[str] = set()
    for m in failures:
        axes.axvline(m.t, color=COLOURS["failure"], lw=0.7, ls=(0, (1.0, 1.5)), zorder=1)
        label = m.kind.replace("_", " ") if named and m.kind not in told else None
        told.add(m.kind)
        mark: Any = _mark(kinds.get(m.kind, "X")) | {"markersize": 6.5, "clip_on": False}
        axes.plot(
            [m.t], [0.97], transform=axes.get_xaxis_transform(), label=label,
            **mark,
        )  # fmt: skip


def _theta(figure: Figure, log: RunLog, maze: Maze, failures: list[Mishap], kinds: Kinds) -> None:
    upper, lower = figure.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": (2.6, 1.0)})
    parts = theta_lines(log, maze)
    if not parts:
        return nothing(upper, "the ball was in no ring with a channel")
    stays = visits(log)
    for axes in (upper, lower):
        _bands(axes, stays, named=axes is upper)
    for i, (visit, t, real, planned) in enumerate(parts):
        upper.plot(t, real, **line("real"), label="real" if i == 0 else None)
        upper.plot(t, planned, **line("planned", linewidth=1.8), label=f"planned {AHEAD} s before" if i == 0 else None)
        lower.plot(t, real - planned, **line("real"))
        angle = next((o.angle for o in maze.openings if o.name == visit.opening), None)
        if angle is not None and np.isfinite(real).any():
            end = real[np.isfinite(real)][-1]
            there = end + (math.degrees(angle) - end + 180.0) % 360.0 - 180.0
            upper.plot(
                [visit.end], [there], marker="<", color=INK, markersize=6, linestyle="none", zorder=6,
                label="opening it left by" if i == 0 else None,
            )  # fmt: skip
    _failure_lines(upper, failures, kinds, named=True)
    upper.set_ylabel(ANGLE)
    lower.set_ylabel("real less\nplanned, deg")
    lower.set_xlabel("time, s")
    lower.axhline(0.0, color=INK, lw=0.6)
    for axes in (upper, lower):
        axes.grid(axis="y")
    upper.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return None


def _conditions(tree: dict[str, Any]) -> list[str]:
    """Paths of the nodes of a tree that only ask; logs of older versions tell their kinds alone."""
    paths, numbers = tree["paths"], tree.get("conditions")
    if numbers is None:
        return [path for path, kind in zip(paths, tree["kinds"], strict=True) if kind in CONDITIONS]
    return [paths[i] for i in numbers]


def _gantt(figure: Figure, log: RunLog, failures: list[Mishap], kinds: Kinds) -> None:
    from matplotlib.patches import Patch

    axes = figure.add_subplot()
    bars = leaf_bars(log)
    if not bars:
        return nothing(axes, "the log tells of no leaf")
    named = labels(bars)
    asked = {path for tree in log.trees for path in _conditions(tree)}
    met: set[str] = set()
    rows = {path: i for i, path in enumerate(list(named)[:MOST_LEAVES])}
    _bands(axes, visits(log), named=True)
    for bar in bars:
        if bar.path not in rows or bar.status not in DRAWN_AS:
            continue
        name, y = DRAWN_AS[bar.status], rows[bar.path]
        name = "no" if name == "failure" and bar.path in asked else name
        met.add(name)
        height = 0.72 if name == "running" else 0.13
        axes.broken_barh([(bar.start, bar.end - bar.start)], (y - 0.5 * height, height), **_look(name))
        if name == "failure":
            cross: Any = _mark("X") | {"markersize": 6.0}
            axes.plot([bar.start], [y], **cross)
        elif name == "success":
            axes.plot([bar.start], [y], "o", color=COLOURS[name], markersize=3.4, zorder=5)
    _failure_lines(axes, failures, kinds)
    axes.set_yticks(list(rows.values()), [named[path] for path in rows], fontsize=7.5)
    axes.set_ylim(len(rows) - 0.4, -1.4 if failures else -0.7)
    axes.set_xlabel("time, s")
    axes.grid(axis="x")
    patches = [Patch(**_look(name), label=meaning) for name, meaning in MEANING.items() if name in met]
    axes.legend(handles=patches, loc="upper left", bbox_to_anchor=(1.0, 1.0), title="last tick")
    return None


def _look(name: str) -> dict[str, Any]:
    return area("neutral" if name == "no" else name, hatch="")


def _tilt(figure: Figure, log: RunLog, failures: list[Mishap], kinds: Kinds) -> None:
    panels = figure.subplots(2, 1, sharex=True)
    t = log.ticks["t"]
    for axes, (name, label) in zip(panels, (("beta", BETA), ("gamma", GAMMA)), strict=True):
        _bands(axes, visits(log), named=axes is panels[0])
        axes.plot(t, DEG * log.ticks[f"u_{name}"], drawstyle="steps-post", **line("commanded"), label="commanded")
        axes.plot(t, DEG * log.ticks[name], **line("measured"), label="measured")
        _failure_lines(axes, failures if axes is panels[0] else [], kinds)
        axes.set_ylabel(label.replace(" (", "\n("))
        axes.grid(axis="y")
    panels[0].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    panels[1].set_xlabel("time, s")


def _times(figure: Figure, log: RunLog) -> None:
    axes = figure.add_subplot()
    took, t = times_ms(log), log.ticks["t"]
    if len(took["tick"]):
        axes.plot(t, took["tick"], **line("real", linewidth=0.9), label="tick")
    if len(took["plan"]):
        at = [float(plan["t0"]) for plan in log.plans]
        axes.plot(at, took["plan"], "s", color=COLOURS["planned"], markersize=3.5, label="plan", zorder=3)
    if len(t) > 1:
        sample = 1e3 * float(np.median(np.diff(t)))
        axes.axhline(sample, **line("bad", linewidth=1.0), label=f"until the next\nsample, {sample:.1f} ms")
    if any(np.nanmax(part, initial=0.0) > 0.0 for part in took.values()):
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
    else:
        axes.text(0.5, 0.5, "the log tells no times", transform=axes.transAxes, ha="center")
    axes.set_xlabel("time, s")
    axes.set_ylabel("took, ms (log scale)")
    axes.grid(axis="y")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
