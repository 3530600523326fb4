"""Draws the plate's markers to scale for a printer, with the outline of the maze and a ruler.

A plate is wider than a sheet of paper, so each page shows a part of the plate. A page is as wide as A4 and as high as
US Letter, with free margins. Dotted lines show where the parts meet.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from mazeplan.core.errors import InputError
from mazeplan.core.whole_file import whole_file
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.camera.markers import DICTIONARY, MARGIN, Markers, corner_markers

SUFFIXES = (".pdf", ".svg", ".png")
PAGE = (0.210, 0.2794)  # m: the width of A4, the height of US Letter
EDGE = 0.010  # m at the edge of a page that printers leave white
WORDS = 0.030  # m below the drawing, for ruler and words
RULER = 0.100  # m, length of the ruler
PAPER = 0.001  # m of paper around the markers
DPI = 300
Part = tuple[float, float, float, float]  # left, right, bottom, top of what a page shows, m on the plate


def draw_sheet(maze: Maze, path: Path, markers: Markers | None = None) -> list[Path]:
    """Draw the markers in their true size.

    Returns the written files: one PDF, or a file for each page (markers-1.png, ...). Raises InputError for another
    suffix, or if a file cannot be written."""
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"got the suffix {path.suffix!r}, expected one of {', '.join(SUFFIXES)}", file=path)
    markers = markers or corner_markers(maze)
    parts, names = _parts(_reach(markers)), sheet_files(maze, path, markers)
    pages = [_page(maze, markers, part, f"page {n} of {len(parts)}") for n, part in enumerate(parts, start=1)]
    try:
        if path.suffix.lower() == ".pdf":
            from matplotlib.backends.backend_pdf import PdfPages

            with whole_file(path) as beside, PdfPages(beside) as file:
                for page in pages:
                    file.savefig(page)
            return [path]
        for name, page in zip(names, pages, strict=True):
            with whole_file(name) as beside:
                page.savefig(beside, dpi=DPI)
        return names
    except OSError as problem:
        raise InputError(f"cannot be written: {problem.strerror or problem}", file=path) from None


def sheet_files(maze: Maze, path: Path, markers: Markers | None = None) -> list[Path]:
    """The files that `draw_sheet` writes."""
    if path.suffix.lower() == ".pdf":
        return [path]
    count = len(_parts(_reach(markers or corner_markers(maze))))
    return [path.with_stem(f"{path.stem}-{n}") for n in range(1, count + 1)]


def _reach(markers: Markers) -> float:
    """Half side of the square that holds all markers and the paper around them, m."""
    return max(abs(v) for at in markers.places.values() for v in at[:2]) + 0.5 * markers.size + MARGIN + PAPER


def _parts(reach: float) -> list[Part]:
    """The square of the plate, from -reach to +reach, m, divided into equal parts that fit on a page."""
    across, down = (math.ceil(2.0 * reach / room) for room in (PAGE[0] - 2.0 * EDGE, PAGE[1] - 2.0 * EDGE - WORDS))
    xs, ys = np.linspace(-reach, reach, across + 1).tolist(), np.linspace(reach, -reach, down + 1).tolist()
    return [(xs[i], xs[i + 1], ys[j + 1], ys[j]) for j in range(down) for i in range(across)]


def _page(maze: Maze, markers: Markers, part: Part, name: str) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle, Rectangle

    left, right, bottom, top = part
    figure = Figure(figsize=(PAGE[0] / 0.0254, PAGE[1] / 0.0254))
    FigureCanvasAgg(figure)
    width, height = right - left, top - bottom
    x0, y0 = 0.5 * (PAGE[0] - width), EDGE + WORDS + 0.5 * (PAGE[1] - 2.0 * EDGE - WORDS - height)
    ax = figure.add_axes((x0 / PAGE[0], y0 / PAGE[1], width / PAGE[0], height / PAGE[1]))
    ax.set(xlim=(left, right), ylim=(bottom, top), xticks=[], yticks=[])
    for spine in ax.spines.values():
        spine.set(linewidth=0.3, linestyle=":")
    ax.add_patch(Circle((0.0, 0.0), maze.walls[0].outer_radius, fill=False, linewidth=0.5))
    words = cv2.aruco.getPredefinedDictionary(DICTIONARY)
    cells = words.markerSize + 2
    for number, (x, y, _) in markers.places.items():
        if not (left < x < right and bottom < y < top):
            continue
        black = np.asarray(cv2.aruco.generateImageMarker(words, number, cells)) < 128
        side = markers.size / cells
        for row, column in np.argwhere(black):
            corner = (x - 0.5 * markers.size + column * side, y + 0.5 * markers.size - (row + 1) * side)
            ax.add_patch(Rectangle(corner, side, side, facecolor="black", edgecolor="black", linewidth=0.1))
        ax.text(x, y - 0.5 * markers.size - 0.5 * MARGIN, f"{number}", ha="center", va="center", fontsize=6)
    _ruler(figure, f"{name}; markers of {1000.0 * markers.size:.0f} mm. Print at 100 %, without fitting to the page: ")
    return figure


def _ruler(figure: Any, words: str) -> None:
    """Draw a ruler below, to check whether the printer kept the scale."""
    ax = figure.add_axes((0.0, 0.0, 1.0, (EDGE + WORDS) / PAGE[1]))
    ax.set(xlim=(0.0, PAGE[0]), ylim=(0.0, EDGE + WORDS))
    ax.set_axis_off()
    begin, y = 0.5 * (PAGE[0] - RULER), EDGE + 0.006
    ax.plot([begin, begin + RULER], [y, y], color="black", linewidth=0.6)
    for mm in range(0, round(1000.0 * RULER) + 1, 5):
        tick = 0.004 if mm % 10 == 0 else 0.0025
        ax.plot([begin + mm / 1000.0] * 2, [y, y + tick], color="black", linewidth=0.6)
    text = f"{words}the ruler must be {1000.0 * RULER:.0f} mm long."
    ax.text(0.5 * PAGE[0], y + 0.009, text, ha="center", va="center", fontsize=8)
