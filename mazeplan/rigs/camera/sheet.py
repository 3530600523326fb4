"""The plate's markers on paper, to scale, with the outline of the maze to lay them by."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from mazeplan.errors import InputError
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.camera.markers import DICTIONARY, MARGIN, Markers, corner_markers

SUFFIXES = (".pdf", ".svg", ".png")
PAPER = 0.005  # m around the markers
DPI = 300


def draw_sheet(maze: Maze, path: Path, markers: Markers | None = None) -> None:
    """Draw them, 1 m on paper for 1 m. Raises InputError for another suffix or a place that cannot be written."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle, Rectangle

    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"got the suffix {path.suffix!r}, expected one of {', '.join(SUFFIXES)}", file=path)
    markers = markers or corner_markers(maze)
    reach = max(abs(v) for at in markers.places.values() for v in at[:2]) + 0.5 * markers.size + MARGIN + PAPER
    figure = Figure(figsize=(2.0 * reach / 0.0254, 2.0 * reach / 0.0254))
    FigureCanvasAgg(figure)
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set(xlim=(-reach, reach), ylim=(-reach, reach))
    ax.set_axis_off()
    ax.add_patch(Circle((0.0, 0.0), maze.walls[0].outer_radius, fill=False, linewidth=0.5))
    words = cv2.aruco.getPredefinedDictionary(DICTIONARY)
    cells = words.markerSize + 2
    for number, (x, y, _) in markers.places.items():
        black = np.asarray(cv2.aruco.generateImageMarker(words, number, cells)) < 128
        side = markers.size / cells
        for row, column in np.argwhere(black):
            corner = (x - 0.5 * markers.size + column * side, y + 0.5 * markers.size - (row + 1) * side)
            ax.add_patch(Rectangle(corner, side, side, facecolor="black", edgecolor="black", linewidth=0.1))
        ax.text(x, y - 0.5 * markers.size - MARGIN, f"{number}", ha="center", va="top", fontsize=6)
    try:
        figure.savefig(path, dpi=DPI)
    except OSError as problem:
        raise InputError(f"cannot be written: {problem.strerror or problem}", file=path) from None
