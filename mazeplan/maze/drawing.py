"""Drawings of a maze, to scale, fit for print: plan view along the plate's normal, x to the right, y up.

Lengths in the drawing are mm. matplotlib is imported when something is drawn, and its global state is never touched.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mazeplan.core.errors import InputError
from mazeplan.core.maths.angles import place_deg
from mazeplan.core.palette import COLOURS, DASHES, INKS, MAZE, SPEEDS
from mazeplan.core.whole_file import whole_file
from mazeplan.maze.geometry import Maze, RadialWall, Wall

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from mazeplan.maze.graph import Route

SUFFIXES = (".png", ".svg", ".pdf")

_MM = 1000.0
_ARC_STEP = math.radians(0.5)
_INK, _FLOOR = INKS["ink"], MAZE["floor"]
_FONT = 8.0
_SHOWN = 1.27  # a picture with labels shows this many radii of the rim to each side

Array = NDArray[np.float64]


def wall_outlines(wall: Wall, step: float = _ARC_STEP) -> list[Array]:
    """Outlines of the solid pieces between a wall's openings, each (N, 2) in m; none for a wall without openings.
    step: rad from point to point of an arc.

    The sides of an opening are parallel to its middle line: at radius rho an edge lies asin(width / 2 rho) beside it.
    """
    gaps = sorted(wall.openings, key=lambda opening: opening.angle % (2.0 * math.pi))
    outlines = []
    for here, following in zip(gaps, gaps[1:] + gaps[:1], strict=True):
        start = here.angle % (2.0 * math.pi)
        end = following.angle % (2.0 * math.pi) + (2.0 * math.pi if following is gaps[0] else 0.0)
        arcs = []
        for radius in (wall.inner_radius, wall.outer_radius):
            first = start + math.asin(0.5 * here.width / radius)
            arcs.append(_arc(radius, first, end - math.asin(0.5 * following.width / radius), step))
        outlines.append(np.vstack([arcs[0], arcs[1][::-1]]))
    return outlines


def radial_outline(maze: Maze, wall: RadialWall) -> Array:
    """Outline of a radial wall, (N, 2) in m: parallel sides, ends along the circles that it joins."""
    ring, ends = maze.ring(wall.ring), []
    for radius, side in ((ring.inner_radius, 1.0), (ring.outer_radius, -1.0)):
        half = wall.half_angle(radius)
        ends.append(_arc(radius, wall.angle - side * half, wall.angle + side * half))
    return np.vstack(ends)


def _arc(radius: float, first: float, last: float, step: float = _ARC_STEP) -> Array:
    """Points (N, 2) of an arc."""
    angles = np.linspace(first, last, max(2, math.ceil(abs(last - first) / step)))
    return radius * np.column_stack([np.cos(angles), np.sin(angles)])


def draw_maze(
    maze: Maze, ax: Axes | None = None, *, labels: bool = True, names: bool = False, path: Array | None = None,
    ball: bool = True,
) -> Axes:  # fmt: skip
    """Draw walls, openings, ball and tilt axes into `ax`, or into a new figure; returns the axes.

    labels: False draws the bare maze
    names: True draws a scale of degrees, and the names of openings in place of their angles
    path: (N, 2) in m, a route or trail that will be drawn on top, with a row of NaN between two of them
    ball: False draws no ball

    With a path, the ball lies at its first point, numbers keep away from the path, and the angles of openings are
    left out.
    """
    if ax is None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        figure = Figure(figsize=(6.0, 6.0), layout="constrained")
        FigureCanvasAgg(figure)
        ax = figure.add_subplot()
    rim = maze.walls[0].outer_radius * _MM
    reach = rim * (_SHOWN if labels else 1.03)
    ax.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    ax.set_axis_off()
    _draw_walls(ax, maze)
    taken = [maze.threshold_radius(opening) * _unit(opening.angle) for opening in maze.openings]
    taken += [maze.track_radius(wall.ring) * _unit(wall.angle) for wall in maze.radial_walls]
    if ball:
        start = _free_place(maze, 1, np.array(taken)) if path is None else path[0]
        _draw_ball(ax, maze, start)
        taken.append(start)
    if not labels:
        return ax
    crowd = np.vstack([*taken, *([] if path is None else [path[np.isfinite(path).all(axis=1)]])])
    for ring in maze.rings:
        x, y = _free_place(maze, ring.number, crowd) * _MM
        _text(ax, x, y, f"{ring.number}", size=_FONT, weight="bold")
    _draw_tilt_axes(ax, rim, names)
    _draw_scale(ax, maze, rim)
    if names:
        _draw_degrees(ax, rim)
    if names or path is None:
        _draw_opening_labels(ax, maze, names)
    return ax


def _free_place(maze: Maze, ring: int, crowd: Array) -> Array:
    """Place on the track of a ring (2,), in m, farthest from all points of the crowd (N, 2); in the disc, beside the
    centre. Of places that are alike, as in symmetric mazes, the one to the upper left."""
    radius = maze.track_radius(ring) or 0.55 * maze.ring(ring).outer_radius
    places = [radius * _unit(angle) for angle in np.radians(np.arange(0.0, 360.0, 2.5))]
    gaps = [round(float(np.linalg.norm(place - crowd, axis=1).min()), 6) for place in places]
    return max(zip(gaps, places, strict=True), key=lambda found: (found[0], found[1] @ _unit(2.0)))[1]


def draw_route(ax: Axes, maze: Maze, route: Route) -> None:
    """Draw a route as an arrow from its start, along the rings and through the openings; nothing if it is empty."""
    from matplotlib.patches import FancyArrowPatch
    from matplotlib.path import Path as Curve

    points = route_points(maze, route) * _MM
    if len(points):
        look = {"color": COLOURS["planned"], "linewidth": 1.8, "joinstyle": "round", "capstyle": "round", "zorder": 5}
        head = "-|>,head_length=6,head_width=3.2"
        ax.add_patch(FancyArrowPatch(path=Curve(points), arrowstyle=head, shrinkA=0, shrinkB=0, **look))


def route_points(maze: Maze, route: Route) -> Array:
    """A route as a polyline (N, 2) in m: along the track of each ring, then radially to the next track."""
    points = [np.empty((0, 2))]
    for leg in route.legs:
        end, beyond = leg.opening.angle, maze.track_radius(leg.opening.leads_to(leg.ring))
        points += [_arc(maze.track_radius(leg.ring), end - leg.turn_rad, end), beyond * _unit(end)[None]]
    return np.vstack(points)


def draw_trail(ax: Axes, trail: Array) -> None:
    """Draw where the ball was: (N, 3) x, y in m and time in s, which colours the line and adds its scale.

    Rows that are not finite (ball not seen) break the line."""
    from matplotlib.collections import LineCollection

    points = trail[:, :2] * _MM
    seen = np.isfinite(trail.sum(axis=1))
    whole = seen[:-1] & seen[1:]
    if not whole.any():
        return
    pieces = np.stack([points[:-1], points[1:]], axis=1)[whole]
    lines = LineCollection(list(pieces), linewidths=1.6, capstyle="round", zorder=4, cmap=SPEEDS)
    lines.set_array(0.5 * (trail[:-1, 2] + trail[1:, 2])[whole])
    ax.add_collection(lines)
    bar = ax.get_figure().colorbar(lines, ax=ax, shrink=0.5, pad=0.01, aspect=28)  # pyright: ignore
    bar.set_label("time, s", fontsize=_FONT)
    bar.ax.tick_params(labelsize=_FONT)
    bar.outline.set_linewidth(0.5)  # pyright: ignore
    ax.plot(*points[seen][-1], "o", color=_INK, markeredgecolor=_FLOOR, markersize=6.0, zorder=6)


def draw_second(ax: Axes, trail: Array) -> None:
    """Draw where the second ball was: (N, 2) x, y in m; rows that are not finite break the line."""
    look = {"color": COLOURS["second"], "dashes": (2.0, 1.0), "lw": 1.4, "zorder": 3.5}
    ax.plot(*(_MM * trail.T), label="second ball", **look)
    end = trail[np.isfinite(trail).all(axis=1)][-1:]
    ax.plot(*(_MM * end.T), "o", color=COLOURS["second"], markeredgecolor=_FLOOR, markersize=6.0, zorder=6)


def save_drawing(
    maze: Maze, path: str | Path, route: Route | None = None, trail: Array | None = None, *,
    names: bool = False, title: str = "", second: Array | None = None,
) -> None:  # fmt: skip
    """Draw the maze, with a route and the ball's trail (N, 3) if given, to a .png, .svg or .pdf file.

    names: as in `draw_maze`; title: above the drawing; second: trail of a second ball, (N, 2).

    Raises InputError for another suffix or a place that cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"got the suffix {path.suffix!r}, expected one of {', '.join(SUFFIXES)}", file=path)
    over = [] if route is None else [route_points(maze, route)]
    if trail is not None:
        over += [np.full((1, 2), math.nan)] * bool(over) + [trail[np.isfinite(trail).all(axis=1), :2]]
    ax = draw_maze(maze, names=names, path=np.vstack(over) if any(map(len, over)) else None)
    figure: Any = ax.get_figure()
    if title:
        figure.suptitle(title, fontsize=_FONT + 1, color=_INK, parse_math=False)
    if trail is not None:
        figure.set_size_inches(6.8, 6.0)  # room for the scale of time
        draw_trail(ax, trail)
    if second is not None:
        draw_second(ax, second)
    if route is not None:
        draw_route(ax, maze, route)
    _draw_legend(ax, route is not None and bool(route.legs), trail is not None, second is not None)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as beside:
            figure.savefig(beside, dpi=300)
    except OSError as problem:
        raise InputError(f"cannot be written: {problem.strerror or problem}", file=path) from None


def _draw_legend(ax: Axes, route: bool, trail: bool, second: bool) -> None:
    from matplotlib import colormaps
    from matplotlib.lines import Line2D

    handles = []
    if route:
        handles.append(Line2D([], [], label="planned route", color=COLOURS["planned"], lw=1.8))
    if trail:
        handles.append(Line2D([], [], label="path of the ball", color=colormaps[SPEEDS](0.4), lw=1.6))
        handles.append(Line2D([], [], label="its end", color=_INK, marker="o", lw=0))
    if second:
        handles.append(Line2D([], [], label="second ball", color=COLOURS["second"], lw=1.4, dashes=DASHES["second"]))
    if handles:
        ax.legend(handles=handles, loc="upper left", fontsize=_FONT, frameon=False, borderaxespad=0.0, handlelength=1.6)


# Parts of the drawing. Radii and lengths in mm from here on.


def _draw_walls(ax: Axes, maze: Maze) -> None:
    from matplotlib.patches import Circle, Polygon, Wedge

    style = {"facecolor": MAZE["wall"], "edgecolor": MAZE["edge"], "linewidth": 0.6}
    ax.add_patch(Circle((0.0, 0.0), maze.walls[0].inner_radius * _MM, facecolor=_FLOOR, edgecolor="none", zorder=1))
    for wall in maze.walls:
        for outline in wall_outlines(wall):
            ax.add_patch(Polygon(outline * _MM, closed=True, joinstyle="miter", zorder=2, **style))
        if not wall.openings:
            thickness = (wall.outer_radius - wall.inner_radius) * _MM
            ax.add_patch(Wedge((0.0, 0.0), wall.outer_radius * _MM, 0, 360, width=thickness, zorder=2, **style))
    for wall in maze.radial_walls:
        ax.add_patch(Polygon(radial_outline(maze, wall) * _MM, closed=True, joinstyle="miter", zorder=2, **style))
    look = {"facecolor": MAZE["plug"], "edgecolor": MAZE["closed"], "hatch": "////", "linewidth": 0.8, "zorder": 3}
    for opening in maze.openings:
        if opening.closed:
            inner, outer = maze.ring(opening.inner).outer_radius, maze.ring(opening.outer).inner_radius
            half = 0.5 * opening.width
            corners = np.array([[inner, -half], [outer, -half], [outer, half], [inner, half]])
            turn = np.array([_unit(opening.angle), _unit(opening.angle + 0.5 * math.pi)])
            ax.add_patch(Polygon(corners @ turn * _MM, closed=True, **look))


def _draw_opening_labels(ax: Axes, maze: Maze, names: bool) -> None:
    """Write into each opening its name, or into each that is not closed its angle."""
    for opening in maze.openings:
        x, y = maze.threshold_radius(opening) * _MM * _unit(opening.angle)
        if names:
            box = {"facecolor": "white", "alpha": 0.8, "linewidth": 0.0, "pad": 0.6}
            _text(ax, x, y, opening.name, size=5.5, bbox=box)
        elif not opening.closed:
            _text(ax, x, y, f"{place_deg(opening.angle, 1):.4g}°", size=6.5)


def _draw_degrees(ax: Axes, rim: float) -> None:
    """Draw a scale of degrees around the rim, counter-clockwise from the x axis, as in the names of openings."""
    for angle in range(0, 360, 10):
        way, whole = _unit(math.radians(angle)), angle % 30 == 0
        ends = np.outer([1.01, 1.035 if whole else 1.022], rim * way)
        ax.plot(*ends.T, color=_INK, lw=0.9 if whole else 0.6)
        if whole:
            _text(ax, 1.085 * rim * way[0], 1.085 * rim * way[1], f"{angle}°", size=_FONT - 1)


def _draw_ball(ax: Axes, maze: Maze, place: Array) -> None:
    """Draw the ball at a place in m, with a light spot that shows it as a solid sphere."""
    from matplotlib.patches import Circle

    x, y = place * _MM
    radius = maze.ball.radius * _MM
    ax.add_patch(Circle((x, y), radius, facecolor=MAZE["ball"], edgecolor=_INK, linewidth=0.7, zorder=3))
    ax.add_patch(Circle((x - 0.35 * radius, y + 0.35 * radius), 0.22 * radius, facecolor=MAZE["shine"], lw=0, zorder=3))


def _draw_tilt_axes(ax: Axes, rim: float, scale: bool = False) -> None:
    """Draw the x and y axes of the plate, with the sense of the two tilts. scale: draw them outside the scale of
    degrees."""
    first, last = (1.125, 1.195) if scale else (1.01, 1.15)
    arrow = {"arrowstyle": "-|>", "color": _INK, "lw": 1.0, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", xy=(rim * last, 0.0), xytext=(rim * first, 0.0), arrowprops=arrow)
    ax.annotate("", xy=(0.0, rim * last), xytext=(0.0, rim * first), arrowprops=arrow)
    _text(ax, rim * (last + 0.04), 0.0, "$x$", size=_FONT + 2)
    _text(ax, 0.0, rim * (last + 0.04), "$y$", size=_FONT + 2)
    size = _FONT - 1
    _text(ax, rim * (last - 0.05), -rim * 0.05, r"$\beta > 0$ lowers this side", size=size, rotation=-90, va="top")
    _text(ax, rim * 0.05, rim * (last - 0.05), r"$\gamma > 0$ lifts this side", size=size, ha="left")


def _draw_scale(ax: Axes, maze: Maze, rim: float) -> None:
    length = max(step for step in (10, 20, 50, 100, 200) if step <= max(10.0, 0.4 * rim))
    x, y = -rim * 1.2, -rim * 1.2
    ax.plot([x, x + length], [y, y], color=_INK, lw=1.6, solid_capstyle="butt")
    for end in (x, x + length):
        ax.plot([end, end], [y - 0.012 * rim, y + 0.012 * rim], color=_INK, lw=1.0)
    _text(ax, x + 0.5 * length, y + 0.045 * rim, f"{length} mm", size=_FONT)
    diameter = 2.0 * maze.ball.radius * _MM
    note = f"ball {diameter:.3g} mm, tilt up to {math.degrees(maze.tilt_limit):.3g}° about each axis"
    _text(ax, rim * 1.2, y, note, size=_FONT - 1, ha="right")


def _text(ax: Axes, x: float, y: float, text: str, *, size: float, **more: Any) -> None:
    look = {"fontsize": size, "color": _INK, "ha": "center", "va": "center", "zorder": 7}
    ax.text(x, y, text, parse_math=True, **(look | more))  # also where a report takes $ as it is


def _unit(angle: float) -> Array:
    return np.array([math.cos(angle), math.sin(angle)])
