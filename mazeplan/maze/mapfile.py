"""Map files (YAML) to and from `Maze`. The format is explained in maps/cme.yaml.

`load_map` returns the maze or raises the first error. `check_map` returns all errors and warnings.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from mazeplan.core import resources
from mazeplan.core.errors import MapError, guess
from mazeplan.maze.geometry import Ball, Maze, Opening, RadialWall, Ring
from mazeplan.maze.mapschema import (
    MapFile,
    Problem,
    cut_off,
    default_name,
    default_wall_name,
    doubts,
    opening_problems,
    ring_problems,
    wall_problems,
)
from mazeplan.maze.sections import as_tuples, problems
from mazeplan.maze.yamltree import Tree, check_format, key_path, parse_yaml, read_yaml, shown

FORMAT = 1  # format number; also that of a file without `format`
MAX_REPORTED = 50  # maximum number of reported errors of one file


@dataclass(frozen=True)
class MapCheck:
    """Result of a check: the maze (None if there are errors), all errors, and warnings as lines of text."""

    maze: Maze | None
    errors: tuple[MapError, ...]
    warnings: tuple[str, ...] = ()


def load_map(source: str | Path) -> Maze:
    """The maze in a file, or in the packaged map of that name ("cme"). Raises MapError with file, line and key."""
    result = check_map(source)
    if result.maze is None:
        raise result.errors[0]
    return result.maze


def check_map(source: str | Path) -> MapCheck:
    """Read a map and collect all its errors. It returns the errors of a bad file and does not raise them."""
    try:
        path = find_map(source)
        return _check_tree(read_yaml(path, error=MapError, what="a map (YAML)"), path)
    except MapError as error:
        return MapCheck(None, (error,))


def check_text(text: str, *, file: str | Path = "map") -> MapCheck:
    """As `check_map`, for YAML text; file: the name in messages."""
    try:
        return _check_tree(parse_yaml(text, file=file, error=MapError), file)
    except MapError as error:
        return MapCheck(None, (error,))


def packaged_maps() -> tuple[str, ...]:
    """Names of the maps that come with the program."""
    return tuple(sorted(path.stem for path in resources.share("maps").glob("*.yaml")))


def find_map(source: str | Path) -> Path:
    """Path of the file, or of the packaged map of this name. Raises MapError if the name is neither a packaged map nor
    a possible file."""
    try:
        path = resources.find("maps", source, ".yaml")
        missing = not path.exists()
    except (OSError, ValueError) as problem:  # a name that is too long
        raise MapError(f"{shown(str(source))} is not the name of a map or file: {problem.args[-1]}") from None
    if not str(source).isprintable():
        raise MapError(f"{shown(str(source))} is not the name of a map or file")
    if missing and not path.suffix and path.parent == Path("."):
        names = ", ".join(packaged_maps())
        raise MapError(
            f"no such file, and not a packaged map, which are: {names}{guess(path.name, packaged_maps())}", file=path
        )
    return path


def _check_tree(tree: Tree, file: str | Path) -> MapCheck:
    """The result of a check. Raises MapError for content that is not a map of this format."""

    def errors(found: Iterable[Problem]) -> tuple[MapError, ...]:
        return tuple(MapError(text, file=file, line=tree.line(key), key=key_path(key) or None) for key, text in found)

    if not isinstance(tree.data, dict):
        raise MapError(f"got {shown(tree.data)}, expected keys such as name, ball, rings", file=file, line=1)
    check_format(tree, FORMAT, file=file, error=MapError)
    try:
        spec = MapFile.model_validate(as_tuples({key: value for key, value in tree.data.items() if key != "format"}))
    except ValidationError as wrong:
        found = sorted(errors(problems(MapFile, wrong)), key=lambda error: error.line or 0)
        return MapCheck(None, tuple(found[:MAX_REPORTED]))
    # check openings only if the rings are right, and radial walls only if both are
    for rule in (ring_problems, opening_problems, wall_problems):
        if wrong := errors(rule(spec)):
            return MapCheck(None, wrong)
    maze = _maze(spec, str(file))
    if maze.radial_walls and (wrong := errors(cut_off(maze))):
        return MapCheck(None, wrong)
    return MapCheck(maze, (), tuple(map(str, errors(doubts(spec)))))


def _maze(spec: MapFile, source: str) -> Maze:
    return Maze(
        name=spec.name,
        ball=Ball(spec.ball.radius_mm / 1000.0, spec.ball.mass_g / 1000.0),
        rings=tuple(
            Ring(i, ring.inner_radius_mm / 1000.0, ring.outer_radius_mm / 1000.0)
            for i, ring in enumerate(spec.rings, start=1)
        ),
        openings=tuple(
            Opening(
                name=o.label,
                outer=min(o.rings),
                inner=max(o.rings),
                angle=math.radians(o.angle_deg),
                width=o.width_mm / 1000.0,
                closed=o.closed,
                extra_cost=float(o.extra_cost_s),
            )
            for o in spec.openings
        ),
        tilt_limit=math.radians(spec.tilt_limit_deg),
        wall_height=spec.wall_height_mm / 1000.0,
        rim_thickness=spec.rim_thickness_mm / 1000.0,
        radial_walls=tuple(
            RadialWall(w.label, w.ring, math.radians(w.angle_deg), w.thickness_mm / 1000.0) for w in spec.radial_walls
        ),
        balls=spec.balls,
        source=source,
    )


# Writing.


def dump_map(maze: Maze) -> str:
    """YAML text that loads as an equal maze. A number may differ by one bit if no decimal in mm or degrees gives it."""
    lines = [
        f"name: {json.dumps(maze.name)}",
        f"ball: {_flow(radius_mm=_milli(maze.ball.radius), mass_g=_milli(maze.ball.mass))}",
        f"tilt_limit_deg: {_degrees(maze.tilt_limit)}",
        f"wall_height_mm: {_milli(maze.wall_height)}",
        f"rim_thickness_mm: {_milli(maze.rim_thickness)}",
        *([] if maze.balls == 1 else [f"balls: {maze.balls}"]),
        "rings:",
    ]
    for ring in maze.rings:
        radii = _flow(inner_radius_mm=_milli(ring.inner_radius), outer_radius_mm=_milli(ring.outer_radius))
        lines.append(f"  - {radii}")
    lines.append("openings:" if maze.openings else "openings: []")
    lines += [f"  - {_opening_text(opening)}" for opening in maze.openings]
    if maze.radial_walls:
        lines += ["radial_walls:", *(f"  - {_wall_text(wall)}" for wall in maze.radial_walls)]
    return "\n".join(lines) + "\n"


def _flow(**values: str) -> str:
    return "{" + ", ".join(f"{key}: {value}" for key, value in values.items()) + "}"


def _opening_text(opening: Opening) -> str:
    angle = _degrees(opening.angle % (2.0 * math.pi))
    values = {"rings": f"[{opening.outer}, {opening.inner}]", "angle_deg": angle, "width_mm": _milli(opening.width)}
    if opening.name != default_name(opening.outer, opening.inner, float(angle)):
        values["name"] = json.dumps(opening.name)
    if opening.closed:
        values["closed"] = "true"
    if opening.extra_cost:
        values["extra_cost_s"] = repr(opening.extra_cost)
    return _flow(**values)


def _wall_text(wall: RadialWall) -> str:
    angle = _degrees(wall.angle % (2.0 * math.pi))
    values = {"ring": f"{wall.ring}", "angle_deg": angle, "thickness_mm": _milli(wall.thickness)}
    if wall.name != default_wall_name(wall.ring, float(angle)):
        values["name"] = json.dumps(wall.name)
    return _flow(**values)


def _milli(value: float) -> str:
    return _shortest(value * 1000.0, lambda milli: milli / 1000.0 == value)


def _degrees(value: float) -> str:
    return _shortest(math.degrees(value), lambda degrees: math.radians(degrees) == value)


def _shortest(number: float, same: Callable[[float], bool]) -> str:
    """The shortest decimal near `number` that reads back as the same value."""
    for digits in range(1, 18):
        rounded = float(f"{number:.{digits}g}")
        if same(rounded):
            return repr(rounded).removesuffix(".0")
    return repr(number)
