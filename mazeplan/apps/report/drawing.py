"""Styles that pictures share: lines and points of the palette, which also differ in dashes or marker, and legends."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mazeplan.core.palette import COLOURS, INKS, dashes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INK = INKS["ink"]
FAILURE_MARKERS = ("X", "o", "s", "^", "D", "v", "P", "*", "<", ">", "p", "h", "d")


def line(name: str, **more: Any) -> dict[str, Any]:
    """Keywords of Matplotlib for a line in the style of a name of the palette."""
    pattern = dashes(name)
    style: Any = (0, pattern) if pattern else "-"
    return {"color": COLOURS[name], "linestyle": style, "linewidth": 1.4, **more}


def failure_mark(marker: str, **more: Any) -> dict[str, Any]:
    """Keywords of Matplotlib for the marker of a failure."""
    edge = {"markeredgecolor": "white", "markeredgewidth": 0.9}
    return {"marker": marker, "color": COLOURS["failure"], "ls": "none", "markersize": 8.0, "zorder": 8, **edge, **more}


def legend_beside(axes: Axes, **more: Any) -> None:
    """A legend to the right of the panel."""
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), **more)
