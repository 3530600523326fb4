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
from mazeplan.core.maths.angles import difference
from mazeplan.core.whole_file import whole_file
from mazeplan.maze.geometry import Maze, Opening, RadialWall, Wall

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from mazeplan.maze.graph import Route

SUFFIXES = (".png", ".svg", ".pdf")

_MM = 1000.0
_ARC_STEP = math.radians(0.5)
_WALL, _WALL_EDGE, _FLOOR = "#b9bec5", "#5b626b", "#ffffff"
_INK, _CLOSED = "#22262b", "#c0392b"
_ROUTE = "#d55e00"  # vermilion of the Okabe-Ito palette for colour-blind readers
_TRAIL_MAP = "viridis"
_FONT = 8.0
_LABELLED = 1.27  # radii of the rim that a picture with labels shows to each side
_WORD = (0.066, 0.02)  # half of the width and height of "ring 1", of what such a picture shows to each side
_NEAR = 1.6  # radii of the ball that a ring's number keeps from a path

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
        end = following.angle % (2.0 * math.pi)
        if following is gaps[0]:
            end += 2.0 * math.pi
        arcs = []
        for radius in (wall.inner_radius, wall.outer_radius):
            first = start + math.asin(0.5 * here.width / radius)
            last = end - math.asin(0.5 * following.width / radius)
            angles = np.linspace(first, last, max(2, math.ceil((last - first) / step)))
            arcs.append(radius * np.column_stack([np.cos(angles), np.sin(angles)]))
        outlines.append(np.vstack([arcs[0], arcs[1][::-1]]))
    return outlines


def radial_outline(maze: Maze, wall: RadialWall) -> Array:
    """Outline of a radial wall, (N, 2) in m: parallel sides, ends along the circles that it joins."""
    ring, ends = maze.ring(wall.ring), []
    for radius, side in ((ring.inner_radius, 1.0), (ring.outer_radius, -1.0)):
        half = wall.half_angle(radius)
        angles = wall.angle + side * np.linspace(-half, half, max(2, math.ceil(2.0 * half / _ARC_STEP)))
        ends.append(radius * np.column_stack([np.cos(angles), np.sin(angles)]))
    return np.vstack(ends)


def maze_outlines(maze: Maze, step: float = _ARC_STEP) -> list[Array]:
    """Closed outlines of all walls of a maze, each (N, 2) in m; a wall without openings has two. step: as above."""
    found: list[Array] = []
    angles = np.arange(0.0, 2.0 * math.pi, step)
    for wall in maze.walls:
        radii = () if wall.openings else (wall.inner_radius, wall.outer_radius)
        found += [radius * np.column_stack([np.cos(angles), np.sin(angles)]) for radius in radii]
        found += wall_outlines(wall, step)
    return found + [radial_outline(maze, wall) for wall in maze.radial_walls]


def draw_maze(
    maze: Maze, ax: Axes | None = None, *, labels: bool = True, path: Array | None = None, ball: bool = True
) -> Axes:
    """Draw walls, openings, ball and tilt axes into `ax`, or into a figure of its own; returns the axes.

    labels=False draws the bare maze, ball=False no ball. path: (N, 2) in m, a route or trail to be drawn on top: the
    ball lies at its first point, ring numbers keep away from it, and the angles of the openings are left out.
    """
    if ax is None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        figure = Figure(figsize=(6.0, 6.0), layout="constrained")
        FigureCanvasAgg(figure)
        ax = figure.add_subplot()
    rim = maze.walls[0].outer_radius * _MM
    reach = rim * (_LABELLED if labels else 1.03)
    ax.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    ax.set_axis_off()
    _draw_walls(ax, maze)
    for opening in maze.openings:
        if opening.closed:
            _draw_closed(ax, maze, opening)
    places = number_places(maze, path)
    if ball:
        _draw_ball(ax, maze, _ball_place(maze, places[0]) if path is None else path[0])
    if labels:
        for ring, place in zip(maze.rings, places, strict=True):
            text = "ring 1" if ring.number == 1 and _word_fits(maze, place) else f"{ring.number}"
            _text(ax, place[0] * _MM, place[1] * _MM, text, size=_FONT, weight="bold")
        _draw_tilt_axes(ax, rim)
        _draw_scale(ax, maze, rim)
    if labels and path is None:
        _draw_opening_angles(ax, maze)
    return ax


def draw_route(ax: Axes, maze: Maze, route: Route) -> None:
    """Draw a route as an arrow from its start, along the rings and through the openings; nothing if it is empty."""
    from matplotlib.patches import FancyArrowPatch
    from matplotlib.path import Path as Curve

    points = route_points(maze, route) * _MM
    if len(points) < 2:
        return
    ax.add_patch(
        FancyArrowPatch(
            path=Curve(points),
            arrowstyle="-|>,head_length=6,head_width=3.2",
            color=_ROUTE,
            linewidth=1.8,
            joinstyle="round",
            capstyle="round",
            shrinkA=0,
            shrinkB=0,
            zorder=5,
        )
    )


def route_points(maze: Maze, route: Route) -> Array:
    """A route as a polyline (N, 2) in m: along the track of each ring, then radially to the next track."""
    points: list[tuple[float, float]] = []
    for leg in route.legs:
        radius, end = maze.track_radius(leg.ring), leg.opening.angle
        steps = max(2, math.ceil(abs(leg.turn_rad) / _ARC_STEP))
        angles = np.linspace(end - leg.turn_rad, end, steps)
        points += [(radius * math.cos(angle), radius * math.sin(angle)) for angle in angles]
        radius = maze.track_radius(leg.opening.leads_to(leg.ring))
        points.append((radius * math.cos(end), radius * math.sin(end)))
    return np.array(points, dtype=float).reshape(-1, 2)


def draw_trail(ax: Axes, trail: Array) -> None:
    """Draw where the ball was: (N, 2) x, y in m, or (N, 3) with time in s, which colours the line and adds its scale.

    Rows that are not finite (ball not seen) break the line. Raises ValueError for another shape.
    """
    from matplotlib.collections import LineCollection

    trail = np.asarray(trail, dtype=float)
    if trail.ndim != 2 or trail.shape[1] not in (2, 3):
        raise ValueError(f"trail: got shape {trail.shape}, expected (N, 2) or (N, 3)")
    points = trail[:, :2] * _MM
    pieces = np.stack([points[:-1], points[1:]], axis=1)
    whole = np.isfinite(trail[:-1]).all(axis=1) & np.isfinite(trail[1:]).all(axis=1)
    if not whole.any():
        return
    lines = LineCollection(list(pieces[whole]), linewidths=1.6, capstyle="round", zorder=4)
    ax.add_collection(lines)
    end = points[np.isfinite(trail).all(axis=1)][-1]
    if trail.shape[1] == 2:
        lines.set_color("#0072b2")
    else:
        lines.set_cmap(_TRAIL_MAP)
        lines.set_array(0.5 * (trail[:-1, 2] + trail[1:, 2])[whole])
        bar = ax.get_figure().colorbar(lines, ax=ax, shrink=0.5, pad=0.01, aspect=28)  # pyright: ignore
        bar.set_label("time, s", fontsize=_FONT)
        bar.ax.tick_params(labelsize=_FONT)
        bar.outline.set_linewidth(0.5)  # pyright: ignore
    ax.plot(*end, "o", color=_INK, markeredgecolor=_FLOOR, markersize=6.0, zorder=6)


def save_drawing(
    maze: Maze, path: str | Path, route: Route | None = None, trail: Array | None = None, *, labels: bool = True
) -> None:
    """Draw the maze, with a route and the ball's trail if given, to a .png, .svg or .pdf file.

    Raises InputError for another suffix or a place that cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"got the suffix {path.suffix!r}, expected one of {', '.join(SUFFIXES)}", file=path)
    over = [] if route is None else [route_points(maze, route)]
    if trail is not None:
        trail = np.asarray(trail, dtype=float)
        over.append(trail[np.isfinite(trail).all(axis=1), :2])
    drawn = np.vstack(over) if over else np.empty((0, 2))
    ax = draw_maze(maze, labels=labels, path=drawn if len(drawn) else None)
    figure: Any = ax.get_figure()
    if trail is not None:
        if trail.shape[1] == 3:
            figure.set_size_inches(6.8, 6.0)  # room for the scale of time
        draw_trail(ax, trail)
    if route is not None:
        draw_route(ax, maze, route)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as beside:
            figure.savefig(beside, dpi=300)
    except OSError as problem:
        raise InputError(f"cannot be written: {problem.strerror or problem}", file=path) from None


# Parts of the drawing. Radii and lengths in mm from here on.


def _draw_walls(ax: Axes, maze: Maze) -> None:
    from matplotlib.patches import Circle, Polygon, Wedge

    style = {"facecolor": _WALL, "edgecolor": _WALL_EDGE, "linewidth": 0.6}
    ax.add_patch(Circle((0.0, 0.0), maze.walls[0].inner_radius * _MM, facecolor=_FLOOR, edgecolor="none", zorder=1))
    for wall in maze.walls:
        for outline in wall_outlines(wall):
            ax.add_patch(Polygon(outline * _MM, closed=True, joinstyle="miter", zorder=2, **style))
        if not wall.openings:
            thickness = (wall.outer_radius - wall.inner_radius) * _MM
            ax.add_patch(Wedge((0.0, 0.0), wall.outer_radius * _MM, 0, 360, width=thickness, zorder=2, **style))
    for wall in maze.radial_walls:
        ax.add_patch(Polygon(radial_outline(maze, wall) * _MM, closed=True, joinstyle="miter", zorder=2, **style))


def _draw_closed(ax: Axes, maze: Maze, opening: Opening) -> None:
    """A closed opening: a hatched bar across it."""
    from matplotlib.patches import Polygon

    inner = maze.ring(opening.inner).outer_radius * _MM
    outer = maze.ring(opening.outer).inner_radius * _MM
    half = 0.5 * opening.width * _MM
    corners = np.array([[inner, -half], [outer, -half], [outer, half], [inner, half]])
    turn = np.array([_unit(opening.angle), _unit(opening.angle + 0.5 * math.pi)])
    ax.add_patch(
        Polygon(
            corners @ turn, closed=True, facecolor="#f6d5d1", edgecolor=_CLOSED, hatch="////", linewidth=0.8, zorder=3
        )
    )


def _draw_opening_angles(ax: Axes, maze: Maze) -> None:
    for opening in maze.openings:
        if opening.closed:
            continue
        x, y = maze.threshold_radius(opening) * _MM * _unit(opening.angle)
        text = f"{math.degrees(opening.angle) % 360.0:.4g}°"
        _text(ax, x, y, text, size=6.5)


def _draw_ball(ax: Axes, maze: Maze, place: Array) -> None:
    """The ball at a place in m, with a light spot that says which round thing is solid."""
    from matplotlib.patches import Circle

    x, y = place * _MM
    radius = maze.ball.radius * _MM
    ax.add_patch(Circle((x, y), radius, facecolor="#8a929c", edgecolor=_INK, linewidth=0.7, zorder=3))
    ax.add_patch(Circle((x - 0.35 * radius, y + 0.35 * radius), 0.22 * radius, facecolor="#e8ebee", lw=0, zorder=3))


def _label_radius(maze: Maze, ring: int) -> float:
    """Where on its ray a ring's number stands, m: on the track, in the disc beside the centre."""
    return maze.track_radius(ring) or 0.55 * maze.ring(ring).outer_radius


def _word_fits(maze: Maze, place: Array) -> bool:
    """Whether "ring 1" touches no circular wall at a place (2,) in m."""
    half = maze.walls[0].outer_radius * _LABELLED * np.array(_WORD)
    far = np.linalg.norm(place + half * [[-1, -1], [-1, 1], [1, 1], [1, -1], [0, 1], [0, -1]], axis=1)
    return bool(maze.ring(1).inner_radius < far.min() and far.max() < maze.ring(1).outer_radius)


def number_places(maze: Maze, path: Array | None = None) -> list[Array]:
    """Where the rings' numbers stand, (2,) in m each: on one ray, far from openings, walls and path; where no ray is
    free in a ring, in a place of its own."""
    radii = [_label_radius(maze, ring.number) for ring in maze.rings]
    taken = [maze.threshold_radius(opening) * _unit(opening.angle) for opening in maze.openings]
    taken += [maze.track_radius(wall.ring) * _unit(wall.angle) for wall in maze.radial_walls]
    crowd = np.vstack([np.empty((0, 2)), *taken, *([] if path is None else [path])])
    enough = 3.0 * maze.ball.radius

    def room(radius: float, angle: float) -> float:
        """The distance, up to `enough`, to what a number there must not touch."""
        gap = float(np.linalg.norm(radius * _unit(angle) - crowd, axis=1).min(initial=enough))
        return round(gap, 6)

    def preference(angle: float) -> float:
        """Symmetric mazes have many ties: they go to the upper left."""
        return math.cos(angle - 2.0)

    rays = np.radians(np.arange(0.0, 360.0, 2.5)).tolist()
    worded = [ray for ray in rays if _word_fits(maze, radii[0] * _unit(ray))] or rays
    common = max(worded, key=lambda ray: (round(sum(room(r, ray) for r in radii), 6), preference(ray)))

    def angle_of(ring: int, radius: float) -> float:
        if room(radius, common) >= min(enough, _NEAR * maze.ball.radius):
            return common
        free = worded if ring == 1 else rays
        return max(free, key=lambda ray: (room(radius, ray), -abs(difference(ray, common))))

    return [r * _unit(angle_of(ring.number, r)) for ring, r in zip(maze.rings, radii, strict=True)]


def _ball_place(maze: Maze, number: Array) -> Array:
    """Where the ball lies in ring 1 of a map without a path, (2,) in m: far from its openings, walls and number."""
    first = math.atan2(number[1], number[0])
    taken = [opening.angle for opening in maze.openings if opening.outer == 1] + [first - 0.2, first, first + 0.2]
    taken += [wall.angle for wall in maze.radial_walls_of(1)]
    rays = np.radians(np.arange(0.0, 360.0, 2.5)).tolist()
    ray = max(
        rays, key=lambda ray: (round(min(abs(difference(ray, angle)) for angle in taken), 6), math.cos(ray - 2.0))
    )
    return maze.track_radius(1) * _unit(ray)


def _draw_tilt_axes(ax: Axes, rim: float) -> None:
    """The x and y axes of the plate, with the sense of the two tilts."""
    arrow = {"arrowstyle": "-|>", "color": _INK, "lw": 1.0, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", xy=(rim * 1.15, 0.0), xytext=(rim * 1.01, 0.0), arrowprops=arrow)
    ax.annotate("", xy=(0.0, rim * 1.15), xytext=(0.0, rim * 1.01), arrowprops=arrow)
    _text(ax, rim * 1.19, 0.0, "$x$", size=_FONT + 2)
    _text(ax, 0.0, rim * 1.19, "$y$", size=_FONT + 2)
    size = _FONT - 1
    _text(ax, rim * 1.1, -rim * 0.05, r"$\beta > 0$ lowers this side", size=size, rotation=-90, va="top")
    _text(ax, rim * 0.05, rim * 1.1, r"$\gamma > 0$ lifts this side", size=size, ha="left")


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
    ax.text(x, y, text, **({"fontsize": size, "color": _INK, "ha": "center", "va": "center", "zorder": 7} | more))


def _unit(angle: float) -> Array:
    return np.array([math.cos(angle), math.sin(angle)])
