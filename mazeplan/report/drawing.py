"""What pictures have in common: lines, points and areas as the palette has them, and a maze to draw over.

Everything that differs in colour differs in dashes, marker or hatch, too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.maze.drawing import draw_maze
from mazeplan.palette import COLOURS, HATCHES, MARKERS, dashes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from mazeplan.maze.geometry import Maze
    from mazeplan.records import Array

INK = "#1c1f24"
# for one of several of a kind (evaluations, kinds of models), in this order
SERIES = ("real", "ring3", "ring4", "ring5", "ring1")
FAILURE_MARKERS = ("X", "o", "s", "^", "D", "v", "P", "*", "<", ">", "p", "h", "d")


def line(name: str, **more: Any) -> dict[str, Any]:
    """Keywords of Matplotlib for the line of a name of the palette."""
    pattern = dashes(name)
    style: Any = (0, pattern) if pattern else "-"
    return {"color": COLOURS[name], "linestyle": style, "linewidth": 1.4, **more}


def points(name: str, **more: Any) -> dict[str, Any]:
    """Keywords for its points alone."""
    edge = {"markeredgecolor": "white", "markeredgewidth": 0.4}
    return {"color": COLOURS[name], "marker": MARKERS[name], "linestyle": "none", "markersize": 5.0, **edge, **more}


def area(name: str, **more: Any) -> dict[str, Any]:
    """Keywords for a filled area of it."""
    return {"facecolor": COLOURS[name], "edgecolor": "white", "hatch": HATCHES.get(name, ""), "linewidth": 0.0, **more}


def series(number: int) -> str:
    """The name by which one of several of a kind is drawn."""
    return SERIES[number % len(SERIES)]


def darker(name: str = "viridis", first: float = 0.0, last: float = 0.88) -> Any:
    """A colour map without its end that cannot be seen on white; grey printing keeps its order."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    return ListedColormap(colormaps[name](np.linspace(first, last, 256)))


def plan_view(axes: Axes, maze: Maze, points: Array, *, labels: bool = True) -> None:
    """A maze without its ball to draw over, in mm; its ring numbers keep away from points (N, 2), m."""
    draw_maze(maze, axes, labels=labels, path=points, ball=False)


def beside(figure: Figure, widths: tuple[float, ...]) -> list[Axes]:
    """Panels beside each other."""
    found = figure.subplots(1, len(widths), gridspec_kw={"width_ratios": widths}, squeeze=False)
    return list(found[0])


def nothing(axes: Axes, why: str) -> None:
    """Say in an empty panel why it is empty."""
    axes.set_xticks([])
    axes.set_yticks([])
    axes.text(0.5, 0.5, why, transform=axes.transAxes, ha="center", va="center", color=COLOURS["neutral"])
