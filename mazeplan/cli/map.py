"""`mazeplan map`: check, draw, route and learn maps."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from mazeplan.cli.arguments import parse_opening, parse_ring
from mazeplan.cli.map_learn import learn
from mazeplan.cli.output import print_json, say
from mazeplan.errors import InputError

if TYPE_CHECKING:
    from mazeplan.maze.geometry import Maze
    from mazeplan.maze.graph import Route
    from mazeplan.records import Array

app = typer.Typer(help="Check, draw, route and learn maps.", no_args_is_help=True, rich_markup_mode=None)

app.command()(learn)

MapArgument = Annotated[str, typer.Argument(metavar="MAP", help="Map file, or the name of a packaged map.")]
FromOption = Annotated[str, typer.Option("--from", help="Ring where the ball is, such as ring1.")]
ToOption = Annotated[str | None, typer.Option("--to", help="Ring to reach; the centre if not given.")]
AngleOption = Annotated[
    float | None,
    typer.Option(
        "--start-angle",
        help="Angle of the ball in its ring, degrees; if not given 0, or as near to it as there is room.",
    ),
]
CloseOption = Annotated[list[str] | None, typer.Option("--close", help="Opening not to be used; repeatable.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON document.")]


@app.command()
def check(
    files: Annotated[list[str], typer.Argument(metavar="FILE...", help="Map files, or names of packaged maps.")],
    json: JsonOption = False,
) -> None:
    """Say whether maps can be used, and with line and key what is wrong with those that cannot."""
    from mazeplan.maze.mapfile import check_map

    results = [(file, check_map(file)) for file in files]
    if json:
        print_json(
            [
                {
                    "file": file,
                    "ok": result.maze is not None,
                    "errors": [str(error) for error in result.errors],
                    "warnings": list(result.warnings),
                }
                for file, result in results
            ]
        )
    for file, result in () if json else results:
        for line in (*result.errors, *result.warnings):
            say(f"mazeplan: {line}")
        if result.maze is not None:
            rings, openings = len(result.maze.rings), len(result.maze.openings)
            walls = len(result.maze.radial_walls)
            across = f", {walls} radial wall{'s' * (walls != 1)}" if walls else ""
            print(f"{file}: ok: {result.maze.name}, {rings} rings, {openings} openings{across}")
    if any(result.errors for _, result in results):
        raise typer.Exit(2)


@app.command()
def show(
    map_: MapArgument = "cme",
    output: Annotated[Path, typer.Option("--output", "-o", help="Picture to write: .png, .svg or .pdf.")] = Path(
        "maze.png"
    ),
    with_route: Annotated[bool, typer.Option("--route", help="Draw the route as well.")] = False,
    log: Annotated[Path | None, typer.Option("--log", help="Run log: draw where the ball went, too.")] = None,
    start: Annotated[
        str | None, typer.Option("--from", help="Ring where the ball is; where the log begins, or ring1.")
    ] = None,
    goal: ToOption = None,
    start_angle: Annotated[
        float | None,
        typer.Option(help="Angle of the ball in its ring, degrees; where the log begins, or 0."),
    ] = None,
    close: CloseOption = None,
) -> None:
    """Draw a map to scale; with `--route` also the route that `map route` finds, with `--log` the trail of a run."""
    from mazeplan.maze.drawing import save_drawing
    from mazeplan.maze.mapfile import load_map

    maze = load_map(map_)
    trail = None if log is None else _trail(log, maze)
    found = None
    if with_route:
        ring, angle = _beginning(trail, maze)
        start = start or ring
        found = _find(maze, start, goal, start_angle, angle, close or []).route
        if found is None:
            _no_route(maze, start, goal)
    save_drawing(maze, output, route=found, trail=trail)
    say(f"wrote {output}")


@app.command()
def route(
    map_: MapArgument = "cme",
    start: FromOption = "ring1",
    goal: ToOption = None,
    start_angle: AngleOption = None,
    close: CloseOption = None,
    json: JsonOption = False,
) -> None:
    """The route that is expected to be fastest: for every ring how far to turn, and the opening to leave by."""
    from mazeplan.maze.mapfile import load_map

    maze = load_map(map_)
    first, last, angle, found = _find(maze, start, goal, start_angle, 0.0, close or [])
    if json:
        print_json(_document(maze, first, last, angle, found))
        if found is None:
            raise typer.Exit(1)
        return
    if found is None:
        _no_route(maze, start, goal)
        return
    for leg in found.legs:
        turn, name, there = math.degrees(leg.turn_rad), leg.opening.name, leg.opening.leads_to(leg.ring)
        print(f"ring {leg.ring}: turn {turn:+7.1f} deg, opening {name} to ring {there}, {leg.expected_s:.2f} s")
    print(f"ring {last}: there, {found.expected_s:.2f} s expected")


def _trail(log: Path, maze: Maze) -> Array:
    """Where the estimator saw the ball, (N, 3) of x, y in m and time in s; what the camera saw where there was none.
    A log of another map is told of."""
    import numpy as np

    from mazeplan.cli.progress import log_read
    from mazeplan.maze.mapfile import dump_map

    read = log_read(log)
    ticks = read.ticks
    if read.header.get("map", dump_map(maze)) != dump_map(maze):
        say(f"{log} is of another map ({read.header.get('map_name')}); its trail is drawn on {maze.name} all the same")
    names = ("estimate_x", "estimate_y", "estimate_t") if "estimate_x" in ticks else ("x", "y", "t")
    return np.stack([ticks[name] for name in names], axis=1)


def _beginning(trail: Array | None, maze: Maze) -> tuple[str, float]:
    """Ring and angle (degrees) where a trail begins."""
    import numpy as np

    seen = np.empty((0, 3)) if trail is None else trail[np.isfinite(trail).all(axis=1)]
    if not len(seen):
        return "ring1", 0.0
    x, y = seen[0, :2]
    return f"ring{maze.ring_at(math.hypot(x, y))}", math.degrees(math.atan2(y, x))


class _Found(NamedTuple):
    """Rings from and to, angle at the beginning in degrees, and the route if there is one."""

    first: int
    last: int
    angle: float
    route: Route | None


def _find(
    maze: Maze, start: str, goal: str | None, start_angle: float | None, usual: float, close: list[str]
) -> _Found:
    """The route; usual: where the ball is, degrees, if `start_angle` does not say, or as near to it as there is
    room."""
    from mazeplan.choices import check_start_angle
    from mazeplan.maze.graph import RouteGraph

    if start_angle is not None and not math.isfinite(start_angle):
        raise InputError(f"--start-angle: got {start_angle}, expected a finite angle in degrees")
    first = parse_ring(start, maze)
    last = len(maze.rings) if goal is None else parse_ring(goal, maze)
    if start_angle is not None:
        check_start_angle(start_angle, first, maze, "--start-angle")
        angle = start_angle
    else:
        angle = usual
        if not maze.has_room(first, math.radians(usual)):
            angle = math.degrees(maze.clear_angle(first, math.radians(usual)))
    graph = RouteGraph(maze)
    for name in close:
        graph.close(parse_opening(name, maze))
    return _Found(first, last, angle, graph.route(first, last, math.radians(angle)))


def _no_route(maze: Maze, start: str, goal: str | None) -> None:
    goal = goal or f"ring{len(maze.rings)}"
    say(f"mazeplan: no route from {start} to {goal} through the open openings of map {maze.name}")
    raise typer.Exit(1)


def _document(maze: Maze, first: int, last: int, start_angle: float, found: Route | None) -> dict[str, Any]:
    legs = found.legs if found else ()
    return {
        "map": maze.name,
        "from": first,
        "to": last,
        "start_angle_deg": start_angle,
        "found": found is not None,
        "expected_s": None if found is None else found.expected_s,
        "legs": [
            {
                "ring": leg.ring,
                "opening": leg.opening.name,
                "opening_angle_deg": math.degrees(leg.opening.angle),
                "turn_deg": math.degrees(leg.turn_rad),
                "expected_s": leg.expected_s,
            }
            for leg in legs
        ],
    }
