"""Pictures of evaluations; several are side by side, or one below the other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.maze.geometry import Maze
from mazeplan.palette import COLOURS, MARKERS
from mazeplan.report import published
from mazeplan.report.drawing import FAILURE_MARKERS, INK, line, nothing, plan_view, series
from mazeplan.report.evaluation import SECTORS, Runs, as_published, by_kind, by_ring, by_sector, places
from mazeplan.report.page import Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAPER = "published, hardware"
HATCH = ("", "///", "...", "xx", "\\\\\\")


def evaluation_pictures(several: Sequence[Runs], maze: Maze) -> list[Picture]:
    """All of them, in the order in which they are looked at."""
    n = len(several)
    kinds = list(dict.fromkeys(kind for runs in several for kind in by_kind(runs)))
    found = [
        Picture(
            "arrivals", "Arrived by then" + ("; the published times as marks" if as_published(maze) else ""),
            "share of the runs that have arrived against time, and the times of each run",
            lambda figure: _arrivals(figure, several, as_published(maze)), (9.0, 3.2 + 0.45 * (n + 1)),
        ),
        Picture(
            "starts", "Success and time by start angle", "polar plots of success and time against the start angle",
            lambda figure: _starts(figure, several), (9.0, 0.2 + 4.3 * n), automatic=False,
        ),
        Picture(
            "rings", "Time in each ring, runs that arrived", "box plots of the time in each ring",
            lambda figure: _rings(figure, several), (9.0, 3.4),
        ),
    ]  # fmt: skip
    if kinds:
        found += [
            Picture(
                "kinds", "Failures by kind", "number of failures by kind, got over or not",
                lambda figure: _kinds(figure, several, kinds), (9.0, 1.2 + 0.3 * len(kinds) * max(n, 1.4)),
            ),
            Picture(
                "places", "Where the ball was when something failed", "failures by kind and place on the maze",
                lambda figure: _places(figure, several, maze, kinds), (min(6.0 * n, 12.0), 6.4 if n < 3 else 5.0),
            ),
        ]  # fmt: skip
    return found


def _arrivals(figure: Figure, several: Sequence[Runs], marks: bool = True) -> None:
    """marks: of the published times, too, which are of one maze alone."""
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
    upper.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    lower.set_yticks(range(rows), [*(_short(runs.name) for runs in several), *([PAPER] * marks)], fontsize=8)
    lower.set_ylim(rows - 0.4, -0.6)
    lower.set_xlabel("time until arrival, s    (diamond or line: mean;  X at the limit: did not arrive)")
    slowest = [published.TIMES["worst"]] * marks
    slowest += [r.limit if not r.arrived.all() else r.time.max() for r in several]
    lower.set_xlim(0.0, 1.06 * float(max(slowest)))


def _published(upper: Axes, lower: Axes, y: int) -> None:
    """The published times, in row y below."""
    lower.plot([published.TIMES["best"], published.TIMES["worst"]], [y, y], color=INK, lw=1.2, marker="|", ms=9)
    lower.plot([published.TIMES["mean"]], [y], marker="D", color=INK, ms=6)
    reached = 100.0 * published.ARRIVED / published.RUNS
    upper.plot(
        [published.TIMES["mean"]], [reached], marker="D", color=INK, ms=6, ls="none",
        label=f"{PAPER}:\n{published.ARRIVED} of {published.RUNS}, at the mean time",
    )  # fmt: skip
    upper.hlines(reached, published.TIMES["best"], published.TIMES["worst"], color=INK, lw=1.0)
    for name, time in published.TIMES.items():
        for axes in (upper, lower):
            axes.axvline(time, color=COLOURS["neutral"], lw=0.8, ls=(0, (1.0, 1.5)), zorder=0)
        upper.text(time, 103.0, f"{name}\n{time:g} s", ha="center", va="bottom", fontsize=7, color=COLOURS["neutral"])


def _strip(axes: Axes, runs: Runs, row: int) -> None:
    """Each run a point, beside each other where they are alike; the mean a line."""
    name = series(row)
    t = runs.time[runs.arrived]
    beside = row + 0.5 * (np.mod(np.arange(len(t)) * 0.618, 1.0) - 0.5)
    marker = MARKERS[name]
    axes.plot(t, beside, marker=marker, ls="none", color=COLOURS[name], ms=4, mec="white", mew=0.4)
    if len(t):
        axes.plot([t.mean()] * 2, [row - 0.38, row + 0.38], color=INK, lw=2.0, solid_capstyle="butt")
    lost = int((~runs.arrived).sum())
    if lost:
        axes.plot([runs.limit], [row], marker="X", color=COLOURS["failure"], ms=8, mec="white", clip_on=False, zorder=5)
        axes.annotate(f"{lost}", (runs.limit, row), xytext=(-8, 0), textcoords="offset points", va="center", ha="right")


def _short(name: str, most: int = 26) -> str:
    return name if len(name) <= most else name[: most - 1] + "…"


def _starts(figure: Figure, several: Sequence[Runs]) -> None:
    height = figure.get_size_inches()[1]
    figure.subplots_adjust(0.04, 0.45 / height, 0.96, 1.0 - 0.95 / height, wspace=0.05, hspace=0.55)
    panels: Any = figure.subplots(len(several), 2, subplot_kw={"projection": "polar"}, squeeze=False)
    width = 2.0 * math.pi / SECTORS
    for i, (runs, (shares, times)) in enumerate(zip(several, panels, strict=True)):
        if not np.isfinite(runs.start).any():
            for axes in (shares, times):
                nothing(axes, "start angles are not told")
            continue
        arrived, total = by_sector(runs)
        middle = (np.arange(SECTORS) + 0.5) * width
        some = total > 0
        style: Any = {"facecolor": _pale(series(i)), "edgecolor": COLOURS[series(i)], "linewidth": 0.9}
        shares.bar(middle[some], 100.0 * arrived[some] / total[some], width=width, **style)
        lost = some & (arrived < total)
        rest = 100.0 * (total[lost] - arrived[lost]) / total[lost]
        shares.bar(
            middle[lost], rest, width=width, bottom=100.0 - rest, facecolor="white", edgecolor=COLOURS["failure"],
            hatch="xxx", linewidth=0.8,
        )  # fmt: skip
        for at, a, n in zip(middle[some], arrived[some], total[some], strict=True):
            shares.text(at, 113.0, f"{a}/{n}", ha="center", va="center", fontsize=7, in_layout=False)
        shares.set_ylim(0.0, 100.0)
        shares.set_yticks([50, 100], ["50 %", "100 %"], fontsize=7)
        shares.tick_params(axis="x", pad=13, labelsize=8)
        told = "\n(hatched: did not)" if lost.any() else ""
        shares.set_title(f"{_short(runs.name)}: arrived of all, by start angle{told}", pad=16)
        _times_by_start(times, runs, i)


def _times_by_start(axes: Any, runs: Runs, number: int) -> None:
    name, good = series(number), runs.arrived & np.isfinite(runs.start)
    top = float(runs.time[runs.arrived].max()) * 1.1 if runs.arrived.any() else runs.limit
    axes.plot(
        runs.start[good], runs.time[good], ls="none", marker=MARKERS[name], color=COLOURS[name], ms=5, mec="white"
    )
    lost = ~runs.arrived & np.isfinite(runs.start)
    at_rim = np.full(lost.sum(), top)
    axes.plot(
        runs.start[lost], at_rim, ls="none", marker="X", color=COLOURS["failure"], ms=8, mec="white", clip_on=False
    )
    axes.set_ylim(0.0, top)
    axes.tick_params(axis="x", pad=3)
    axes.yaxis.set_major_locator(_whole(4, prune="lower"))
    axes.yaxis.set_major_formatter("{x:g} s")
    axes.tick_params(labelsize=7)
    axes.set_title("time by start angle" + ("\n(X at the rim: did not arrive)" if lost.any() else ""), pad=16)


def _whole(most: int, **more: Any) -> Any:
    """Ticks at whole numbers."""
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(most, integer=True, **more)


def _rings(figure: Figure, several: Sequence[Runs]) -> None:
    axes = figure.add_subplot()
    spent = [by_ring(runs) for runs in several]
    rings = sorted({ring for found in spent for ring in found})
    if not rings:
        return nothing(axes, "no run arrived")
    width = 0.8 / len(several)
    for i, found in enumerate(spent):
        at = [k for k, ring in enumerate(rings) if ring in found]
        where = [k - 0.4 + (i + 0.5) * width for k in at]
        boxes: Any = axes.boxplot(
            [found[rings[k]] for k in at], positions=where, widths=0.7 * width, patch_artist=True, manage_ticks=False,
            showfliers=False, whis=(0, 100), medianprops={"color": INK, "linewidth": 1.6},
        )  # fmt: skip
        for box in boxes["boxes"]:
            box.set(facecolor=_pale(series(i)), edgecolor=COLOURS[series(i)], hatch=HATCH[i % len(HATCH)])
        boxes["boxes"][0].set_label(several[i].name)
        for x, k in zip(where, at, strict=True):
            times = found[rings[k]]
            beside = x + 0.3 * width * (np.mod(np.arange(len(times)) * 0.618, 1.0) - 0.5)
            axes.plot(beside, times, ls="none", marker=MARKERS[series(i)], ms=2.6, color=COLOURS[series(i)], zorder=3)
    axes.set_xticks(range(len(rings)), [f"ring {ring}" for ring in rings])
    axes.set_ylabel("time in the ring, s")
    axes.set_ylim(bottom=0.0)
    axes.grid(axis="y")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), title="box: quartiles,\nwhiskers: all")
    return None


def _pale(name: str) -> tuple[float, ...]:
    from matplotlib.colors import to_rgb

    return tuple(1.0 - 0.25 * (1.0 - c) for c in to_rgb(COLOURS[name]))


def _kinds(figure: Figure, several: Sequence[Runs], kinds: Sequence[str]) -> None:
    axes = figure.add_subplot()
    height = 0.8 / len(several)
    for i, runs in enumerate(several):
        counts = by_kind(runs)
        y = [k - 0.4 + (i + 0.5) * height for k in range(len(kinds))]
        over, lost = ([counts.get(kind, (0, 0))[j] for kind in kinds] for j in (0, 1))
        name = "" if len(several) == 1 else f"{_short(runs.name)}: "
        got = {"facecolor": _pale(series(i)), "edgecolor": COLOURS[series(i)], "hatch": HATCH[i % len(HATCH)]}
        axes.barh(y, over, height * 0.85, label=f"{name}in runs that arrived", **got)
        if any(lost):
            axes.barh(
                y, lost, height * 0.85, left=over, color=COLOURS["failure"], label=f"{name}in runs that did not"
            )  # fmt: skip
        for at, a, b in zip(y, over, lost, strict=True):
            if a + b:
                axes.text(a + b, at, f" {a + b}", va="center", fontsize=8)
    axes.set_yticks(range(len(kinds)), [kind.replace("_", " ") for kind in kinds])
    axes.set_ylim(len(kinds) - 0.5, -0.5)
    axes.set_xlabel("failures, number in all runs")
    axes.margins(x=0.08)
    axes.xaxis.set_major_locator(_whole(8))
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))


def _places(figure: Figure, several: Sequence[Runs], maze: Maze, kinds: Sequence[str]) -> None:
    panels = figure.subplots(1, len(several), squeeze=False)[0]
    markers = dict(zip(kinds, FAILURE_MARKERS, strict=False))
    for axes, runs in zip(panels, several, strict=True):
        told = places(runs)
        plan_view(axes, maze, np.array([(x, y) for _, x, y in told]).reshape(-1, 2))
        for kind, marker in markers.items():
            at = 1e3 * np.array([(x, y) for k, x, y in told if k == kind]).reshape(-1, 2)
            label = f"{kind.replace('_', ' ')}, {len(at)}"
            if len(at):
                axes.plot(
                    *at.T, marker=marker, ls="none", ms=6.5, color=COLOURS["failure"], mec="white", mew=0.7, alpha=0.85,
                    zorder=8, label=label,
                )  # fmt: skip
        untold = sum(len(result["failures"]) for result in runs.results) - len(told)
        more = f"{untold} without a place" if untold else "" if told else "none"
        axes.set_title(_short(runs.name) + (f" ({more})" if more else ""))
        if told:
            axes.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=2)
