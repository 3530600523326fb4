"""A film of a run (.gif): the plate from above, and the behaviour tree beside it.

    messages of a run -> story -> moments at even times -> Matplotlib -> Pillow

The background is drawn once; a frame draws only what changes.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mazeplan.apps.view.page import SIGNS
from mazeplan.apps.view.story import Moment, maze_of, moments
from mazeplan.core.errors import InputError
from mazeplan.core.palette import COLOURS, INKS, MAZE
from mazeplan.core.whole_file import whole_file
from mazeplan.maze.drawing import draw_maze
from mazeplan.maze.geometry import Maze

INCHES, DPI = (9.6, 5.4), 75  # 720 x 405 pixels
HZ = 12.5  # frames a second; browsers show a gif at steps of 10 ms
MM = 1e3  # per m: the unit of the drawing
END_S = 1.5  # s that the last frame stays
COLOURS_GIF = 64
ROWS = 30  # of the tree
CORNER, LONG = np.array([0.07, 0.07]), 0.06  # start and length of the line downhill, in shares of the plate's axes
STEEP = np.radians(5.0)  # tilt of a line of full length
Frame = NDArray[np.uint8]  # (height, width, 3), RGB


def write_film(messages: Iterable[tuple[str, dict[str, Any]]], path: Path) -> None:
    """Write the film of a run. messages: (topic, document) of its log

    Raises InputError for a run without ticks or map, and for a file that cannot be written."""
    from PIL import Image

    shown = moments(messages)
    maze = maze_of(shown[0].header) if shown else None
    if maze is None:
        raise InputError("the run has no tick, or no map: there is nothing to film", file=path)
    picture, images = _Picture(maze, shown[0].header), list[Any]()
    for moment in at_even_times(shown, HZ):
        image, first = Image.fromarray(picture.frame(moment)), images[0] if images else None
        # with the colours of the first picture, so that unchanged parts cost nothing
        images.append(image.quantize(COLOURS_GIF, palette=first, dither=Image.Dither.NONE))
    more: Any = {"format": "GIF", "duration": round(1000.0 / HZ), "loop": 0, "optimize": True}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as beside:
            images[0].save(beside, save_all=True, append_images=images[1:], **more)
    except (OSError, ValueError) as problem:
        raise InputError(f"cannot be written: {getattr(problem, 'strerror', None) or problem}", file=path) from None


def at_even_times(shown: Sequence[Moment], hz: float) -> list[Moment]:
    """The newest moment at each of even times, hz a second; then the last moment again for END_S."""
    times = np.maximum.accumulate([moment.t for moment in shown])
    wanted = np.arange(times[0], times[-1], 1.0 / hz)
    places = np.maximum(np.searchsorted(times, wanted + 1e-9, side="right") - 1, 0)
    return [shown[i] for i in places] + [shown[-1]] * max(1, round(END_S * hz))


class _Picture:
    """The parts of a frame that change, over a background that does not."""

    def __init__(self, maze: Maze, header: dict[str, Any]) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
        from matplotlib.patches import Circle

        figure = Figure(figsize=INCHES, dpi=DPI)
        self._canvas, self._maze = FigureCanvasAgg(figure), maze
        plan = figure.add_axes((0.0, 0.02, 0.54, 0.96))
        draw_maze(maze, plan, labels=False, ball=False)
        self._balls = [
            Circle((0.0, 0.0), MM * maze.ball.radius, fc=colour, ec=INKS["ink"], lw=0.7, zorder=8)
            for colour in (MAZE["ball"], COLOURS["second"])
        ]
        for ball in self._balls:
            plan.add_patch(ball)
        side = figure.add_axes((0.55, 0.0, 0.45, 1.0))
        side.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
        side.set_axis_off()
        rig, seed = header.get("rig", ""), header.get("seed")
        plain: Any = {"parse_math": False}  # a $ in a name is a dollar
        named = f"rig {rig}" + ("" if seed is None else f", seed {seed}")
        side.text(0.0, 0.955, named, fontsize=10, color=INKS["quiet"], **plain)
        downhill = plan.text(0.03, 0.135, "downhill", fontsize=7.5, color=INKS["quiet"], transform=plan.transAxes)
        (self._trail,) = plan.plot([], [], color=COLOURS["real"], linewidth=2.0, alpha=0.5, zorder=5)
        (self._planned,) = plan.plot([], [], color=COLOURS["planned"], linewidth=2.4, zorder=6)
        (self._next,) = plan.plot([], [], "o", color=COLOURS["planned"], fillstyle="none", markersize=15, zorder=7)
        (self._tilt,) = plan.plot([], [], color=COLOURS["measured"], linewidth=3.0, marker="o", markevery=[0])
        self._tilt.set_transform(plan.transAxes)
        self._time = side.text(0.0, 0.895, "", fontsize=13, weight="bold")
        self._said = side.text(0.0, 0.84, "", fontsize=10, color=COLOURS["bad"], **plain)
        self._rows = [side.text(0.0, 0.79 - 0.0258 * k, "", fontsize=7.5, **plain) for k in range(ROWS)]
        moving = (*self._balls, downhill, self._trail, self._planned, self._next, self._tilt)
        self._changing: Any = (*moving, self._time, self._said, *self._rows)
        for artist in self._changing:
            artist.set_animated(True)  # keeps it out of the background
        self._canvas.draw()
        self._background = self._canvas.copy_from_bbox(figure.bbox)

    def frame(self, moment: Moment) -> Frame:
        """The picture of a moment."""
        self._canvas.restore_region(self._background)
        self._place(moment)
        self._write(moment)
        for artist in self._changing:
            artist.axes.draw_artist(artist)
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    def _place(self, moment: Moment) -> None:
        for patch, ball in zip(self._balls, (moment.ball, moment.second), strict=True):
            patch.set_visible(ball is not None and ball.seen)
            if ball is not None:
                patch.set_center((MM * ball.x, MM * ball.y))
        ahead = [opening for opening in self._maze.openings if opening.name == moment.opening]
        angles = np.array([opening.angle for opening in ahead])
        radii = np.array([self._maze.threshold_radius(opening) for opening in ahead])
        for line, points in (
            (self._trail, moment.trail),
            (self._planned, np.empty((0, 2)) if moment.plan is None else moment.plan),
            (self._next, np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])),
        ):
            line.set_data(MM * points[:, 0], MM * points[:, 1])
        way = np.array([moment.tilt[0], -moment.tilt[1]])  # positive beta lowers +x, positive gamma lifts +y
        ends = np.array([CORNER, CORNER + LONG * way / STEEP])
        self._tilt.set_data(ends[:, 0], ends[:, 1])

    def _write(self, moment: Moment) -> None:
        result, failure = moment.result, moment.failure
        state = f"ring {moment.ring or '–'}{'' if moment.goal is None else f' → {moment.goal}'}"
        if result is not None:
            state = "arrived" if result.get("success") else str(result.get("reason", "ended"))
        self._time.set_text(f"{moment.t:.2f} s   {state}")
        recovery = "" if failure is None or not failure.recovery else f" → {failure.recovery}"
        self._said.set_text("" if failure is None else f"{failure.t:.2f} s: {failure.kind}{recovery}")
        nodes = tree_rows(moment)
        for k, text in enumerate(self._rows):
            words, style, active = nodes[k] if k < len(nodes) else ("", "neutral", False)
            text.set_text(words)
            text.set_color(INKS[style])
            text.set_fontweight("bold" if active else "normal")


def tree_rows(moment: Moment) -> list[tuple[str, str, bool]]:
    """One row for each node that the tree reached: words, style of the palette, whether the node is active.

    There are at most ROWS rows. Of a longer list, the part around the active leaf is kept."""
    tree = moment.tree
    found, last = [], 0
    for i, (node, letter) in enumerate(zip(tree.nodes, tree.statuses, strict=False)):
        if letter == "-":
            continue
        (sign, style, _), active = SIGNS.get(letter, SIGNS["-"]), i in tree.active
        last = len(found) if active else last
        found.append((f"{'   ' * node.depth}{sign} {node.name}", style, active))
    first = max(0, min(last + 4, len(found)) - ROWS)
    return found[first : first + ROWS]
