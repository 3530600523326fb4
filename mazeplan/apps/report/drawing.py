"""Parts that pictures share: lines and points in the palette's styles, a maze to draw over, and legends.

Lines and points that differ in colour also differ in dashes or marker.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.core.logs.run_log import STATUSES
from mazeplan.core.palette import COLOURS, INKS, MARKERS, dashes
from mazeplan.maze.drawing import draw_maze

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    from mazeplan.core.records import Array
    from mazeplan.maze.geometry import Maze

INK = INKS["ink"]
SERIES = ("real", "ring3", "ring4", "ring5", "sixth")  # styles of evaluations beside each other
KIND_STYLES = {"rf": "sixth", "p": "ring1", "pi": "ring5", "np": "ring3", "npd": "ring4", "sp": "ring2",
               "model": "ring2"}  # fmt: skip
FAILURE_MARKERS = ("X", "o", "s", "^", "D", "v", "P", "*", "<", ">", "p", "h", "d")


def line(name: str, **more: Any) -> dict[str, Any]:
    """Keywords of Matplotlib for a line in the style of a name of the palette."""
    pattern = dashes(name)
    style: Any = (0, pattern) if pattern else "-"
    return {"color": COLOURS[name], "linestyle": style, "linewidth": 1.4, **more}


def points(name: str, **more: Any) -> dict[str, Any]:
    """Keywords of Matplotlib for points without a line, in the style of a name of the palette."""
    edge = {"markeredgecolor": "white", "markeredgewidth": 0.4}
    return {"color": COLOURS[name], "marker": MARKERS[name], "linestyle": "none", "markersize": 5.0, **edge, **more}


def failure_mark(marker: str, **more: Any) -> dict[str, Any]:
    """Keywords of Matplotlib for the marker of a failure."""
    edge = {"markeredgecolor": "white", "markeredgewidth": 0.9}
    return {"marker": marker, "color": COLOURS["failure"], "ls": "none", "markersize": 8.0, "zorder": 8, **edge, **more}


def series(number: int) -> str:
    """The name of the palette whose style one of several evaluations has."""
    return SERIES[number % len(SERIES)]


def darker(name: str = "viridis", first: float = 0.0, last: float = 0.88) -> Any:
    """A colour map without the light end, which is hard to see on white paper. In grey print it keeps its order."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    return ListedColormap(colormaps[name](np.linspace(first, last, 256)))


def plan_view(axes: Axes, maze: Maze, points: Array, *, labels: bool = True) -> None:
    """Draw a maze without a ball, in mm, for a picture on top of it.

    labels: draw ring numbers, away from the points.
    points (N, 2): m."""
    draw_maze(maze, axes, labels=labels, path=points, ball=False)


def sector_map(
    axes: Axes, rings: Iterable[tuple[float, float]], values: Sequence[Array], start: float, top: float, cmap: Any
) -> Any:
    """Colour the sectors of rings by their values; NaN stays white.

    rings: inner and outer radius of each ring, m.
    values: for each ring an array with a value for each sector.
    start: angle of the first sector, deg.
    top: value that has the last colour of cmap."""
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Wedge

    patches = [
        Wedge((0, 0), 1e3 * outer, start + j * 360.0 / len(row), start + (j + 1) * 360.0 / len(row),
              width=1e3 * (outer - inner))
        for (inner, outer), row in zip(rings, values, strict=True) for j in range(len(row))
    ]  # fmt: skip
    drawn = PatchCollection(patches, cmap=cmap, linewidths=0, zorder=1.5)
    drawn.set_array(np.ma.masked_invalid(np.concatenate(values)))
    drawn.set_clim(0.0, top)
    return axes.add_collection(drawn)


def round_the_ring(axis: Axis) -> None:
    """Label an axis of angles from 0 to 360 degrees, also where a line goes on beyond a whole turn."""
    from matplotlib.ticker import MultipleLocator

    low, high = sorted(axis.get_view_interval())
    step = next((step for step in (15.0, 30.0, 45.0, 90.0, 180.0) if high - low <= 8.0 * step), 360.0)
    axis.set_major_locator(MultipleLocator(step))
    axis.set_major_formatter(lambda angle, _: f"{angle % 360.0:g}")


def panel_row(figure: Figure, widths: tuple[float, ...]) -> list[Axes]:
    """Panels side by side, with these relative widths."""
    found = figure.subplots(1, len(widths), gridspec_kw={"width_ratios": widths}, squeeze=False)
    return list(found[0])


def legend_beside(axes: Axes, **more: Any) -> None:
    """A legend to the right of the panel."""
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), **more)


def empty_panel(axes: Axes, why: str) -> None:
    """Write into an empty panel why it is empty."""
    axes.set_xticks([])
    axes.set_yticks([])
    axes.text(0.5, 0.5, why, transform=axes.transAxes, ha="center", va="center", color=INKS["quiet"])


# letter of a status in a log: how the last tick of a node ended
ENDINGS = {STATUSES[name]: name.lower() for name in ("RUNNING", "SUCCESS", "FAILURE", "SKIPPED")}
MEANING = {
    "running": "running", "success": "succeeded", "failure": "failed", "skipped": "skipped", "no": "no (a condition)",
}  # fmt: skip


def ending(letter: str, condition: bool) -> str:
    """How a tick ended, as a key of MEANING, from its letter in a log. The failure of a condition is the answer no."""
    return "no" if condition and ENDINGS[letter] == "failure" else ENDINGS[letter]


def draw_ending(axes: Axes, name: str, y: float, start: float, end: float) -> None:
    """Draw in row y how a node's last tick ended, from start to end, s: a bar if it runs, else a line and a mark."""
    height = 0.72 if name == "running" else 0.13
    axes.broken_barh([(start, end - start)], (y - 0.5 * height, height), **_look(name))
    if name == "failure":
        axes.plot([start], [y], clip_on=False, **failure_mark("X", markersize=6.0))
    elif name == "success":
        axes.plot([start], [y], "o", color=COLOURS[name], markersize=3.4, zorder=5, clip_on=False)


def endings_met(met: Collection[str]) -> list[Patch]:
    """Entries of a legend for the keys of MEANING in `met`."""
    from matplotlib.patches import Patch

    return [Patch(**_look(name), label=meaning) for name, meaning in MEANING.items() if name in met]


def _look(name: str) -> dict[str, Any]:
    return {"facecolor": COLOURS["neutral" if name == "no" else name], "edgecolor": "white", "linewidth": 0.0}
