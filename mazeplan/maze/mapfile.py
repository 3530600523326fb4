"""Map files (YAML) to and from `Maze`. The format is explained in maps/cme.yaml.

`load_map` returns the maze or raises the first error. `check_map` returns all errors and warnings.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from mazeplan.core import resources
from mazeplan.core.errors import MapError
from mazeplan.core.name_hints import guess
from mazeplan.maze.geometry import ROOMY, Ball, Maze, Opening, RadialWall, Ring
from mazeplan.maze.mapschema import MapFile, OpeningSection
from mazeplan.maze.sections import as_tuples, problems
from mazeplan.maze.wallrules import (
    cut_off,
    default_wall_name,
    duplicate_names,
    overlaps,
    wall_name,
    wall_problems,
)
from mazeplan.maze.yamltree import Key, Tree, check_format, key_path, parse_yaml, read_yaml, shown

FORMAT = 1  # format number; also that of a file without `format`
MIN_WALL_MM = 1.0  # thinner walls break in print and let a fast ball through in simulation

DENSITIES = (0.02, 25.0)  # g/cm^3 of a ball, from foam to platinum

MAX_REPORTED = 50  # maximum number of reported errors of one file

Problem = tuple[Key, str]


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
    def error(problem: Problem) -> MapError:
        key, text = problem
        return MapError(text, file=file, line=tree.line(key), key=key_path(key) or None)

    if not isinstance(tree.data, dict):
        return MapCheck(None, (error(((), f"got {shown(tree.data)}, expected keys such as name, ball, rings")),))
    if tree.data and not any(key in tree.data for key in MapFile.model_fields):
        names = ", ".join(shown(str(key)) for key in list(tree.data)[:3])
        problem = f"got the keys {names} ..., expected a map: keys such as name, ball, rings"
        return MapCheck(None, (error(((), problem)),))
    try:
        check_format(tree, FORMAT, file=file, error=MapError)
        spec = MapFile.model_validate(as_tuples({key: value for key, value in tree.data.items() if key != "format"}))
    except MapError as newer:
        return MapCheck(None, (newer,))
    except ValidationError as wrong:
        return MapCheck(None, tuple(sorted(map(error, problems(MapFile, wrong)), key=_line)[:MAX_REPORTED]))
    # check openings only if the rings are right, and radial walls only if both are
    for rule in (_ring_problems, _opening_problems, wall_problems):
        if found := tuple(error(item) for item in rule(spec)):
            return MapCheck(None, found)
    maze = _maze(spec, str(file))
    if maze.radial_walls and (found := tuple(error(item) for item in cut_off(maze))):
        return MapCheck(None, found)
    return MapCheck(maze, (), tuple(str(error(item)) for item in _warnings(spec)))


def _line(error: MapError) -> int:
    return error.line or 0


# Rules. Lengths in mm, as in the file.


def _ring_problems(spec: MapFile) -> Iterator[Problem]:
    diameter = 2.0 * spec.ball.radius_mm
    last = len(spec.rings) - 1
    if spec.wall_height_mm < spec.ball.radius_mm:
        yield (
            ("wall_height_mm",),
            f"got {spec.wall_height_mm:g}, expected at least the ball's radius {spec.ball.radius_mm:g}",
        )
    volume, mass = 4.0 / 3.0 * math.pi * (0.1 * spec.ball.radius_mm) ** 3, spec.ball.mass_g
    low, high = (density * volume for density in DENSITIES)
    if not low <= mass <= high:
        yield ("ball", "mass_g"), f"got {mass:g}, expected {low:.2g} to {high:.3g} for a ball of this radius"
    for i, ring in enumerate(spec.rings):
        inner, outer = ("rings", i, "inner_radius_mm"), ("rings", i, "outer_radius_mm")
        if i == last and ring.inner_radius_mm != 0.0:
            yield inner, f"got {ring.inner_radius_mm:g}, expected 0: the last ring is the disc in the centre"
        if i < last and ring.inner_radius_mm == 0.0:
            yield inner, "got 0, expected more: only the last ring is a disc"
        if ring.outer_radius_mm <= ring.inner_radius_mm:
            yield outer, f"got {ring.outer_radius_mm:g}, expected more than inner_radius_mm {ring.inner_radius_mm:g}"
            continue
        room = ring.outer_radius_mm - ring.inner_radius_mm if i < last else 2.0 * ring.outer_radius_mm
        if room <= diameter:
            yield outer, f"got a ring {room:g} mm wide, expected more than the ball's diameter {diameter:g}"
        if i > 0:
            limit = spec.rings[i - 1].inner_radius_mm - MIN_WALL_MM
            if ring.outer_radius_mm > limit:
                yield (
                    outer,
                    f"got {ring.outer_radius_mm:g}, expected at most {limit:g}: rings are listed from the outermost, "
                    f"with a wall of at least {MIN_WALL_MM:g} mm between them",
                )


def crowded(balls: int, ball_mm: float, centre_mm: float) -> str | None:
    """A sentence if so many balls do not fit into the centre, else None. Radii in mm."""
    if balls == 1 or centre_mm >= ROOMY * ball_mm - 1e-6:  # 2.2 times 5 is more than 11 in binary numbers
        return None
    least = f"at least {ROOMY * ball_mm:.4g} mm, {ROOMY:g} times the ball's"
    return f"{balls} balls need a centre with a radius of {least}, not {centre_mm:.4g} mm"


def _opening_problems(spec: MapFile) -> Iterator[Problem]:
    wrong = [problem for i in range(len(spec.openings)) for problem in _one_opening(spec, i)]
    yield from wrong
    if wrong:
        return
    yield from duplicate_names("openings", [(_name(o), bool(o.name)) for o in spec.openings])
    gaps: dict[int, list[tuple[float, int, float]]] = {}
    for i, opening in enumerate(spec.openings):
        gaps.setdefault(max(opening.rings), []).append((opening.angle_deg, i, opening.width_mm))
    for inner in sorted(gaps):  # an opening with parallel sides is widest in angle at the inner face of its wall
        yield from overlaps("openings", "wall", spec.rings[inner - 1].outer_radius_mm, gaps[inner])
    for ring in _unreachable(spec, [_pair(o) for o in spec.openings]):
        yield ("rings", ring - 1), f"ring {ring} cannot be reached from ring 1, expected openings that lead to it"


def _one_opening(spec: MapFile, i: int) -> Iterator[Problem]:
    opening, key = spec.openings[i], ("openings", i)
    outer, inner = _pair(opening)
    if inner > len(spec.rings):
        yield (*key, "rings"), f"got ring {inner}, expected 1 to {len(spec.rings)}"
        return
    if inner != outer + 1:
        yield (*key, "rings"), f"got {list(opening.rings)}, expected two neighbours, such as [1, 2]"
        return
    diameter, wall = 2.0 * spec.ball.radius_mm, 2.0 * spec.rings[inner - 1].outer_radius_mm
    if opening.width_mm <= diameter:
        yield (*key, "width_mm"), f"got {opening.width_mm:g}, expected more than the ball's diameter {diameter:g}"
    if opening.width_mm >= wall:
        yield (
            (*key, "width_mm"),
            f"got {opening.width_mm:g}, expected less than {wall:g}, the wall's inner diameter",
        )


def _warnings(spec: MapFile) -> Iterator[Problem]:
    for ring in _unreachable(spec, [_pair(o) for o in spec.openings if not o.closed]):
        yield ("rings", ring - 1), f"warning: ring {ring} can be reached only through closed openings"
    if problem := crowded(spec.balls, spec.ball.radius_mm, spec.rings[-1].outer_radius_mm):
        yield ("balls",), f"warning: {problem}"


def _unreachable(spec: MapFile, pairs: list[tuple[int, int]]) -> list[int]:
    """Rings cut off from ring 1. Openings join neighbouring rings, so a wall without openings cuts off all rings inside
    it."""
    joined = set(pairs)
    for ring in range(2, len(spec.rings) + 1):
        if (ring - 1, ring) not in joined:
            return list(range(ring, len(spec.rings) + 1))
    return []


def _pair(opening: OpeningSection) -> tuple[int, int]:
    return min(opening.rings), max(opening.rings)


def _name(opening: OpeningSection) -> str:
    outer, inner = _pair(opening)
    return opening.name or default_name(outer, inner, opening.angle_deg)


def default_name(outer: int, inner: int, angle_deg: float) -> str:
    """Default name of an opening: rings and angle, such as "1-2@45"."""
    return f"{outer}-{inner}@{angle_deg:.10g}"


def _maze(spec: MapFile, source: str) -> Maze:
    rings = tuple(
        Ring(i, ring.inner_radius_mm / 1000.0, ring.outer_radius_mm / 1000.0)
        for i, ring in enumerate(spec.rings, start=1)
    )
    openings = tuple(
        Opening(
            name=_name(o),
            outer=_pair(o)[0],
            inner=_pair(o)[1],
            angle=math.radians(o.angle_deg),
            width=o.width_mm / 1000.0,
            closed=o.closed,
            extra_cost=float(o.extra_cost_s),
        )
        for o in spec.openings
    )
    return Maze(
        name=spec.name,
        ball=Ball(spec.ball.radius_mm / 1000.0, spec.ball.mass_g / 1000.0),
        rings=rings,
        openings=openings,
        tilt_limit=math.radians(spec.tilt_limit_deg),
        wall_height=spec.wall_height_mm / 1000.0,
        rim_thickness=spec.rim_thickness_mm / 1000.0,
        radial_walls=tuple(
            RadialWall(wall_name(w), w.ring, math.radians(w.angle_deg), w.thickness_mm / 1000.0)
            for w in spec.radial_walls
        ),
        balls=spec.balls,
        source=source,
    )


# Writing.


def dump_map(maze: Maze) -> str:
    """YAML text that loads as an equal maze. A number may differ by one bit if no decimal in mm or degrees gives it."""
    lines = [
        f"name: {json.dumps(maze.name)}",
        f"ball: {{radius_mm: {_milli(maze.ball.radius)}, mass_g: {_milli(maze.ball.mass)}}}",
        f"tilt_limit_deg: {_degrees(maze.tilt_limit)}",
        f"wall_height_mm: {_milli(maze.wall_height)}",
        f"rim_thickness_mm: {_milli(maze.rim_thickness)}",
        *([] if maze.balls == 1 else [f"balls: {maze.balls}"]),
        "rings:",
    ]
    lines += [
        f"  - {{inner_radius_mm: {_milli(ring.inner_radius)}, outer_radius_mm: {_milli(ring.outer_radius)}}}"
        for ring in maze.rings
    ]
    lines.append("openings:" if maze.openings else "openings: []")
    lines += [f"  - {{{_opening_text(opening)}}}" for opening in maze.openings]
    if maze.radial_walls:
        lines.append("radial_walls:")
        lines += [f"  - {{{_wall_text(wall)}}}" for wall in maze.radial_walls]
    return "\n".join(lines) + "\n"


def _opening_text(opening: Opening) -> str:
    angle = _degrees(opening.angle % (2.0 * math.pi))
    parts = [f"rings: [{opening.outer}, {opening.inner}]", f"angle_deg: {angle}", f"width_mm: {_milli(opening.width)}"]
    if opening.name != default_name(opening.outer, opening.inner, float(angle)):
        parts.append(f"name: {json.dumps(opening.name)}")
    if opening.closed:
        parts.append("closed: true")
    if opening.extra_cost:
        parts.append(f"extra_cost_s: {opening.extra_cost!r}")
    return ", ".join(parts)


def _wall_text(wall: RadialWall) -> str:
    angle = _degrees(wall.angle % (2.0 * math.pi))
    parts = [f"ring: {wall.ring}", f"angle_deg: {angle}", f"thickness_mm: {_milli(wall.thickness)}"]
    if wall.name != default_wall_name(wall.ring, float(angle)):
        parts.append(f"name: {json.dumps(wall.name)}")
    return ", ".join(parts)


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
