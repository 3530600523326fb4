"""`map check`, `show`, `route` and `learn`."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.map_learn import learn
from mazeplan.apps.cli.option_checks import listed
from mazeplan.apps.cli.output import plural, print_json, say
from mazeplan.core.errors import InputError
from mazeplan.core.maths.angles import place_deg
from mazeplan.run.commands.log_context import parse_opening

if TYPE_CHECKING:
    from mazeplan.core.logs.run_log import RunLog
    from mazeplan.core.records import Array
    from mazeplan.maze.geometry import Maze
    from mazeplan.maze.graph import Route

app = typer.Typer(help="Check, draw, route and learn maps.", no_args_is_help=True, rich_markup_mode=None)
app.command()(learn)

LOOK_S = 0.25  # s between two looks at a watched file
MapArgument = Annotated[str, typer.Argument(metavar="MAP", help="Map file, or name of a packaged map.")]
MapFiles = Annotated[list[str], typer.Argument(metavar="MAP", help="Map files, or names of packaged maps.")]
Picture = Annotated[
    Path,
    typer.Option(
        "--output", "-o", parser=opt.file(*opt.PICTURES, chosen=True), callback=opt.new_file, metavar="FILE",
        help="Picture to write: .png, .svg or .pdf.",
    ),
]  # fmt: skip
Watch = Annotated[bool, typer.Option("--watch", help="Draw again at each save of the map.")]
WithRoute = Annotated[bool, typer.Option("--route", help="Also draw the route to the centre, or to the goal of --log.")]
WithLabels = Annotated[
    bool, typer.Option("--labels", help="Also write the names of openings, and a scale of degrees around the rim.")
]
TrailLog = Annotated[
    Path | None, typer.Option("--log", metavar="LOG", help="Run log: also draw the trail of the ball.")
]


@app.command()
def check(files: MapFiles, json: opt.AsJson = False) -> None:
    """Check maps, and name the line and key of each problem."""
    from mazeplan.maze.mapfile import check_map

    results = [(file, check_map(file)) for file in files]
    if json:
        keys = ("file", "ok", "errors", "warnings")
        rows = [(file, r.maze is not None, [*map(str, r.errors)], [*r.warnings]) for file, r in results]
        print_json([dict(zip(keys, row, strict=True)) for row in rows])
    for file, result in () if json else results:
        for line in (*result.errors, *result.warnings):
            say(f"mazeplan: {line}")
        if result.maze is not None:
            rings, openings = len(result.maze.rings), len(result.maze.openings)
            walls = len(result.maze.radial_walls)
            across = f", {plural(walls, 'radial wall')}" if walls else ""
            print(f"{file}: ok: {result.maze.name}, {rings} rings, {openings} openings{across}")
    if any(result.errors for _, result in results):
        raise typer.Exit(2)


@app.command()
def show(
    map_: MapArgument = "cme",
    output: Picture = Path("maze.png"),
    with_route: WithRoute = False,
    labels: WithLabels = False,
    log: TrailLog = None,
    watch: Watch = False,
    force: opt.Force = False,
) -> None:
    """Draw a map to scale, with --route the route of `map route`, with --log the trail of a run."""
    draw = partial(_draw, map_, with_route=with_route, labels=labels, log=log)
    if watch:
        from mazeplan.maze.mapfile import find_map

        _watch(find_map(map_), draw, output)
        return
    draw(output)
    say(f"wrote {output}")


def _watch(source: Path, draw: Callable[[Path], None], output: Path) -> None:
    """Draw whenever the file changes, until Ctrl-C. A mistake in the map is a message, and the old picture stays."""
    say(f"watching {source}, drawing {output}; Ctrl-C ends")
    seen: object = None
    with suppress(KeyboardInterrupt):
        while True:
            now = source.stat().st_mtime_ns if source.exists() else None  # an editor may be replacing it
            if now not in (seen, None):
                seen = now
                try:
                    draw(output)
                except InputError as problem:
                    say(f"mazeplan: {problem}")
            time.sleep(LOOK_S)


def _draw(map_: str, output: Path, *, with_route: bool, labels: bool, log: Path | None) -> None:
    """Draw a map into a file, with the options of `map show`."""
    from mazeplan.maze.drawing import save_drawing
    from mazeplan.maze.mapfile import load_map

    maze = load_map(map_)
    trail, second, start, goal, title = None, None, ("ring1", 0.0), None, f"map {maze.name}"
    if log is not None:
        from mazeplan.apps.report.run import lead, second_trail
        from mazeplan.apps.report.run import trail as trail_of

        read = _log_of(log, maze)
        trail, second = trail_of(read), second_trail(read)
        start, number = _beginning(trail, maze), read.header.get("goal_ring")
        goal = f"ring{number}" if number else None
        title += f", rig {read.header.get('rig')}, seed {read.header.get('seed')}\n{lead(read)}"
    best = _find(maze, start[0], goal, None, start[1], ()).require_route(maze) if with_route else None
    save_drawing(maze, output, route=best, trail=trail, names=labels, title=title, second=second)


@app.command()
def route(
    map_: MapArgument = "cme",
    start: opt.StartRing = "ring1",
    goal: opt.MapGoal = None,
    start_angle: opt.MapAngle = None,
    close: opt.Close = None,
    json: opt.AsJson = False,
) -> None:
    """Find the fastest expected route: for each ring the turn and the opening."""
    from mazeplan.maze.mapfile import load_map

    maze = load_map(map_)
    found = _find(maze, start, goal, start_angle, 0.0, listed(close))
    if json:
        print_json(_document(maze, found))
        if found.route is None:
            raise typer.Exit(1)
        return
    best = found.require_route(maze)
    for leg in best.legs:
        turn, name, there = math.degrees(leg.turn_rad), leg.opening.name, leg.opening.leads_to(leg.ring)
        print(f"ring {leg.ring}: turn {turn:+7.1f} deg, opening {name} to ring {there}, {leg.expected_s:.2f} s")
    print(f"ring {found.last}: goal, {best.expected_s:.2f} s expected")


def _log_of(log: Path, maze: Maze) -> RunLog:
    """Read the log of a run. Prints a line if the log is of another map."""
    from mazeplan.core.logs.run_log import read_log
    from mazeplan.maze.mapfile import dump_map
    from mazeplan.maze.mapschema import MAX_BALLS

    read = read_log(log)
    same = [dump_map(replace(maze, balls=balls)) for balls in range(1, MAX_BALLS + 1)]
    if read.header.get("map", same[0]) not in same:
        say(f"{log} is of another map ({read.header.get('map_name')}); drawing its trail on {maze.name}")
    return read


def _beginning(trail: Array, maze: Maze) -> tuple[str, float]:
    """Ring and angle (degrees) where a trail begins; ring1 and 0 for a ball that was never seen."""
    import numpy as np

    seen = trail[np.isfinite(trail).all(axis=1)]
    if not len(seen):
        return "ring1", 0.0
    x, y = seen[0, :2]
    return f"ring{maze.ring_at(math.hypot(x, y))}", place_deg(math.atan2(y, x))


class _Found(NamedTuple):
    """First and last ring, start angle in degrees, and the route, if there is one."""

    first: int
    last: int
    angle: float
    route: Route | None

    def require_route(self, maze: Maze) -> Route:
        """The route. Without one, prints a message and ends with status 1."""
        if self.route is None:
            closed = sum(opening.closed for opening in maze.openings)
            shut = f" ({closed} of {len(maze.openings)} are closed in it)" if closed else ""
            way = f"from ring{self.first} to ring{self.last} through the openings of map {maze.name}"
            say(f"mazeplan: no route {way}{shut}")
            raise typer.Exit(1)
        return self.route


def _find(
    maze: Maze, start: str, goal: str | None, start_angle: float | None, usual: float, close: Iterable[str]
) -> _Found:
    """Find the route.

    start_angle: degrees; raises InputError if the ball has no room there
    usual: start angle without `start_angle`, degrees, moved to the nearest free angle
    close: openings to close"""
    from mazeplan.maze.graph import RouteGraph
    from mazeplan.run.resolve import check_start_angle, ring_number

    first = ring_number(start, maze)
    last = len(maze.rings) if goal is None else ring_number(goal, maze)
    if start_angle is not None:
        check_start_angle(start_angle, first, maze, "--start-angle")
        angle = start_angle
    else:
        free = maze.has_room(first, math.radians(usual))
        angle = usual if free else place_deg(maze.clear_angle(first, math.radians(usual)))
    graph = RouteGraph(maze)
    for name in close:
        graph.close(parse_opening(name, maze))
    return _Found(first, last, angle, graph.route(first, last, math.radians(angle)))


def _document(maze: Maze, found: _Found) -> dict[str, Any]:
    best = found.route
    legs = [
        {
            "ring": leg.ring,
            "opening": leg.opening.name,
            "opening_angle_deg": place_deg(leg.opening.angle),
            "turn_deg": math.degrees(leg.turn_rad),
            "expected_s": leg.expected_s,
        }
        for leg in (best.legs if best else ())
    ]
    task = {"map": maze.name, "from": found.first, "to": found.last, "start_angle_deg": found.angle}
    return {**task, "found": best is not None, "expected_s": best.expected_s if best else None, "legs": legs}
