"""`map check`, `show`, `route` and `learn`."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import plural, print_result, say
from mazeplan.apps.cli.progress import ProgressBar
from mazeplan.core.errors import InputError, TableError
from mazeplan.core.maths.angles import place_deg
from mazeplan.core.whole_file import write_text
from mazeplan.run.commands.log_context import logged_map

if TYPE_CHECKING:
    from mazeplan.maze.geometry import Maze
    from mazeplan.maze.graph import Route
    from mazeplan.maze.learnedmap import LearnedMap
    from mazeplan.maze.transitions import BallTrack

app = typer.Typer(help="Check, draw, route and learn maps.", no_args_is_help=True)

LOOK_S = 0.25  # s between two looks at a watched file
MapArgument = Annotated[str, typer.Argument(metavar="MAP", help="Map file, or name of a packaged map.")]
MapFiles = Annotated[list[str], typer.Argument(metavar="MAP", help="Map files, or names of packaged maps.")]
Picture = Annotated[Path, opt.output_file("Picture to write: .png, .svg or .pdf.", ".png", ".svg", ".pdf", chosen=True)]
Watch = Annotated[bool, typer.Option("--watch", help="Draw again at each save of the map.")]
WithRoute = Annotated[bool, typer.Option("--route", help="Also draw the route to the centre, or to the goal of --log.")]
WithLabels = Annotated[
    bool, typer.Option("--labels", help="Also write the names of openings, and a scale of degrees around the rim.")
]
TrailLog = Annotated[Path | None, opt.value("--log", "LOG", "Run log: also draw the trail of the ball.")]
LearnedFile = Annotated[Path, opt.output_file("Map file to write.", *opt.YAML)]
MinCount = Annotated[int, opt.value("--min-count", "N", "Fewest passages of an opening.", min=1)]


@app.command()
def check(files: MapFiles, as_json: opt.AsJson = False) -> None:
    """Check maps, and name the line and key of each problem."""
    from mazeplan.maze.mapfile import check_map

    results = [(file, check_map(file)) for file in files]
    document, lines = list[dict[str, Any]](), list[str]()
    for file, result in results:
        errors, warnings, maze = [str(error) for error in result.errors], list(result.warnings), result.maze
        document.append({"file": file, "ok": maze is not None, "errors": errors, "warnings": warnings})
        for line in () if as_json else (*errors, *warnings):
            say(f"mazeplan: {line}")
        if maze is not None:
            across = f", {plural(len(maze.radial_walls), 'radial wall')}" if maze.radial_walls else ""
            lines.append(f"{file}: ok: {maze.name}, {len(maze.rings)} rings, {len(maze.openings)} openings{across}")
    print_result(as_json, document, *lines)
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

    if log is None:
        maze = load_map(map_)
        first, last, theta = 1, len(maze.rings), 0.0
        drawn: dict[str, Any] = {"title": f"map {maze.name}"}
    else:
        from mazeplan.apps.report.runs import lead, second_trail, trail
        from mazeplan.core.logs.run_log_reader import read_log

        maze, read = logged_map(map_, log).maze, read_log(log)  # it warns if the log is of another map
        header, start = read.header, (read.result or {}).get("start") or {}
        first, last = header.get("start_ring", 1), header.get("goal_ring", len(maze.rings))
        theta = start.get("theta", 0.0)
        title = f"map {maze.name}, rig {header.get('rig')}, seed {header.get('seed')}\n{lead(read)}"
        drawn = {"title": title, "trail": trail(read), "second": second_trail(read)}
    best = _route(maze, first, last, theta) if with_route else None
    if with_route and best is None:
        _end_without_route(maze, first, last)
    save_drawing(maze, output, route=best, names=labels, **drawn)


@app.command()
def route(
    map_: MapArgument = "cme",
    start: opt.StartRing = "ring1",
    goal: opt.GoalRing = "centre",
    start_angle: opt.StartAngle = None,
    close: opt.Close = None,
    as_json: opt.AsJson = False,
) -> None:
    """Find the fastest expected route: for each ring the turn and the opening."""
    from mazeplan.maze.mapfile import load_map
    from mazeplan.run.resolve import check_start_angle, ring_number

    maze = load_map(map_)
    first, last = ring_number(start, maze), ring_number(goal, maze)
    if start_angle is not None:
        check_start_angle(start_angle, first, maze, "--start-angle")
    theta = math.radians(start_angle or 0.0)
    if not maze.has_room(first, theta):
        theta = maze.clear_angle(first, theta)
    best = _route(maze, first, last, theta, opt.listed(close))
    legs, lines = list[dict[str, Any]](), list[str]()
    for leg in best.legs if best else ():
        turn, opening = math.degrees(leg.turn_rad), leg.opening
        place = {"opening": opening.name, "opening_angle_deg": place_deg(opening.angle)}
        legs.append({"ring": leg.ring, **place, "turn_deg": turn, "expected_s": leg.expected_s})
        to = f"opening {opening.name} to ring {opening.leads_to(leg.ring)}"
        lines.append(f"ring {leg.ring}: turn {turn:+7.1f} deg, {to}, {leg.expected_s:.2f} s")
    lines += [f"ring {last}: goal, {best.expected_s:.2f} s expected"] if best else []
    degrees = place_deg(theta) if start_angle is None else start_angle
    task = {"map": maze.name, "from": first, "to": last, "start_angle_deg": degrees, "found": best is not None}
    print_result(as_json, {**task, "expected_s": best.expected_s if best else None, "legs": legs}, *lines)
    if best is None:
        _end_without_route(maze, first, last)


def _route(maze: Maze, first: int, last: int, theta: float, close: Iterable[str] = ()) -> Route | None:
    """The fastest route without the openings in `close`. theta: start angle, rad"""
    from mazeplan.maze.graph import RouteGraph
    from mazeplan.run.resolve import opening_name

    graph = RouteGraph(maze)
    for name in close:
        graph.close(opening_name(name, maze))
    return graph.route(first, last, theta)


def _end_without_route(maze: Maze, first: int, last: int) -> NoReturn:
    closed = sum(opening.closed for opening in maze.openings)
    shut = f" ({closed} of {len(maze.openings)} are closed in it)" if closed else ""
    say(f"mazeplan: no route from ring{first} to ring{last} through the openings of map {maze.name}{shut}")
    raise typer.Exit(1)


@app.command()
def learn(
    logs: opt.Logs,
    output: LearnedFile = Path("learned.yaml"),
    min_count: MinCount = 2,
    map_: opt.MapOfLog = None,
    columns: opt.Columns = None,
    force: opt.Force = False,
    as_json: opt.AsJson = False,
) -> None:
    """Learn rings and openings from the places of the ball and its changes of ring. The map has the missing figures."""
    from mazeplan.maze.learnedmap import learn_map, map_text

    names = ", ".join(str(log) for log in logs)
    with ProgressBar("learning a map") as bar:
        bar.show("reading")
        prior = logged_map(map_, *logs)
        track = _track(logs, columns or [])
        try:
            learned = learn_map(track, prior.maze, prior_name=prior.source, min_count=min_count, progress=bar.show)
        except TableError as problem:
            raise TableError(problem.problem, file=names) from None
    if learned.maze is not None:
        write_text(output, map_text(learned, [log.name for log in logs]))
    known = {key: value for key, value in asdict(learned).items() if key != "maze"}  # lengths in m, angles in rad
    document = {"map": None if learned.maze is None else str(output), **known}
    print_result(as_json, document, *_learned_lines(learned))
    for line in (*(f"warning: {line}" for line in learned.warnings), *learned.problems):
        say(f"mazeplan: {names}: {line}")
    if learned.maze is None:
        raise typer.Exit(1)
    say(f"wrote {output}")


def _track(logs: list[Path], columns: list[str]) -> BallTrack:
    """The measured places of the ball in all logs. Raises TableError with file and line."""
    import numpy as np

    from mazeplan.core.logs.columns import parse_columns
    from mazeplan.core.logs.table import join, read_table
    from mazeplan.maze.transitions import BallTrack

    tables = [read_table(log, parse_columns(columns)) for log in logs]
    for log, table in zip(logs, tables, strict=True):
        if "x" not in table or "y" not in table:
            raise TableError("needs x and y, or theta and r: theta alone shows no rings", file=log)
    whole = join(tables)
    seen = np.isfinite(whole["x"]) & np.isfinite(whole["y"])
    return BallTrack(whole["t"][seen], whole["x"][seen], whole["y"][seen], whole.segment[seen])


def _learned_lines(learned: LearnedMap) -> list[str]:
    """Rings and openings as two tables."""
    lines = ["ring  inner mm         outer mm         samples at them"]
    for ring in learned.rings:
        inner, outer = (
            f"{1e3 * radius:6.2f} {'(a guess)' if sigma is None else f'± {1e3 * sigma:.3f}' if radius else '(disc)'}"
            for radius, sigma in ((ring.inner_radius, ring.inner_stderr), (ring.outer_radius, ring.outer_stderr))
        )
        lines.append(f"{ring.number:4d}  {inner:16s} {outer:16s} {ring.inner_touches}, {ring.outer_touches}")
    lines.append("rings  angle deg       passages")
    lines += [
        f"{o.outer}-{o.outer + 1}    {place_deg(o.angle, 2):6.2f} ± {math.degrees(o.angle_stderr):4.2f}  "
        f"{o.count:8d}{f'  left out: {o.problem}' * bool(o.problem)}"
        for o in learned.openings
    ]
    x, y = (1e3 * value for value in learned.centre)
    return [*lines, f"centre of the circles x {x:.2f}, y {y:.2f} mm; camera noise {1e3 * learned.noise:.2f} mm"]
