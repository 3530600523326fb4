"""`mazeplan map learn`: rings and openings from logs in which the ball changed rings."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mazeplan.cli.output import print_json, say
from mazeplan.errors import InputError, TableError

if TYPE_CHECKING:
    from mazeplan.maze.geometry import Maze
    from mazeplan.maze.learnedmap import LearnedMap
    from mazeplan.maze.transitions import LearnedOpening, Track


def learn(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Run logs (MCAP) or tables (CSV).")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Map file to write.")] = Path("learned.yaml"),
    min_count: Annotated[int, typer.Option("--min-count", min=1, help="Passages that make an opening.")] = 2,
    map_: Annotated[
        str | None,
        typer.Option("--map", help="Map for what the logs do not tell; default: the log's own, else cme."),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON document.")] = False,
) -> None:
    """Learn rings and openings from where the ball was and changed rings."""
    from mazeplan.cli.progress import Working
    from mazeplan.maze.learnedmap import learn_map, map_text

    names = ", ".join(str(log) for log in logs)
    with Working("learning a map") as shown:
        shown.tell("reading")
        prior, prior_name = _prior(map_, logs)
        track, given = _track(logs), map_ is not None
        try:
            learned = learn_map(
                track, prior, prior_name=prior_name, borrow=given, min_count=min_count, progress=shown.tell
            )
        except TableError as problem:
            raise TableError(problem.problem, file=names) from None
    if learned.maze is not None:
        try:
            output.write_text(map_text(learned, [log.name for log in logs]), encoding="utf-8")
        except OSError as problem:
            raise InputError(f"cannot be written: {problem.strerror or problem}", file=output) from None
    if json:
        print_json(document(learned, output))
    else:
        report(learned)
    for line in learned.warnings:
        say(f"warning: {line}")
    for line in learned.problems:
        say(f"mazeplan: {names}: {line}")
    if learned.maze is None:
        raise typer.Exit(1)
    say(f"wrote {output}")


def _prior(map_: str | None, logs: list[Path]) -> tuple[Maze, str]:
    """The map for what logs do not tell, and what it is called."""
    from mazeplan.data.runlog import read_log
    from mazeplan.maze.mapfile import check_text, load_map

    if map_ is not None:
        return load_map(map_), f"map {map_}"
    for log in logs:
        if log.suffix == ".mcap" and log.is_file():
            text = read_log(log).header.get("map")
            maze = check_text(text, file=log).maze if isinstance(text, str) else None
            if maze is not None:
                return maze, f"the log's map {maze.name}"
    return load_map("cme"), "the packaged map cme"


def _track(logs: list[Path]) -> Track:
    """Where the ball was seen in all logs. Raises TableError with file and line."""
    import numpy as np

    from mazeplan.data.table import join, read_table
    from mazeplan.maze.transitions import Track

    tables = [read_table(log) for log in logs]
    for log, table in zip(logs, tables, strict=True):
        if "x" not in table or "y" not in table:
            raise TableError("needs x and y, or theta and r: theta alone shows no rings", file=log)
    whole = join(tables)
    seen = np.isfinite(whole["x"]) & np.isfinite(whole["y"])
    return Track(whole["t"][seen], whole["x"][seen], whole["y"][seen], whole.segment[seen])


def document(learned: LearnedMap, output: Path) -> dict[str, Any]:
    """What `map learn --json` prints."""
    return {
        "map": str(output) if learned.maze is not None else None,
        "prior": learned.prior,
        "samples": learned.samples,
        "passages": learned.passages,
        "skipped": learned.skipped,
        "camera": {
            "x_mm": 1e3 * learned.centre[0],
            "y_mm": 1e3 * learned.centre[1],
            "noise_mm": 1e3 * learned.noise,
        },
        "rings": [
            {
                "ring": ring.number,
                "inner_radius_mm": 1e3 * ring.inner_radius,
                "outer_radius_mm": 1e3 * ring.outer_radius,
                "inner_stderr_mm": _milli(ring.inner_stderr),
                "outer_stderr_mm": _milli(ring.outer_stderr),
                "touches": [ring.inner_touches, ring.outer_touches],
                "note": ring.note,
            }
            for ring in learned.rings
        ],
        "openings": [
            _opening(opening, width, source)
            for opening, (width, source) in zip(learned.openings, learned.widths, strict=True)
        ],
        "borrowed": [opening.name for opening in learned.borrowed],
        "warnings": list(learned.warnings),
        "problems": list(learned.problems),
    }


def _opening(opening: LearnedOpening, width: float, source: str) -> dict[str, Any]:
    return {
        "rings": [opening.outer, opening.outer + 1],
        "angle_deg": math.degrees(opening.angle),
        "angle_stderr_deg": math.degrees(opening.angle_stderr),
        "width_mm": 1e3 * width,
        "width_stderr_mm": _milli(opening.width_stderr),
        "width_from": source,
        "count": opening.count,
        "inward": opening.inward,
        "outward": opening.outward,
        "sign": opening.sign,
        "outer_centroid_mm": [1e3 * value for value in opening.outer_centroid],
        "inner_centroid_mm": [1e3 * value for value in opening.inner_centroid],
        "direction_deg": math.degrees(opening.direction),
        "written": not opening.problem,
        "problem": opening.problem,
    }


def _milli(value: float | None) -> float | None:
    return None if value is None else 1e3 * value


def report(learned: LearnedMap) -> None:
    """Rings and openings as two tables."""
    print("ring  inner mm         outer mm         samples at them")
    for ring in learned.rings:
        inner, outer = (
            f"{1e3 * radius:6.2f} {'(a guess)' if sigma is None else f'± {1e3 * sigma:.3f}' if radius else '(disc)'}"
            for radius, sigma in ((ring.inner_radius, ring.inner_stderr), (ring.outer_radius, ring.outer_stderr))
        )
        print(f"{ring.number:4d}  {inner:16s} {outer:16s} {ring.inner_touches}, {ring.outer_touches}")
    print("rings  angle deg       width mm  width from                  in  out  outer -> inner point, mm")
    for opening, (width, source) in zip(learned.openings, learned.widths, strict=True):
        (x1, y1), (x2, y2) = opening.outer_centroid, opening.inner_centroid
        print(
            f"{opening.outer}-{opening.outer + 1}    {math.degrees(opening.angle):6.2f} ± "
            f"{math.degrees(opening.angle_stderr):4.2f}  {1e3 * width:8.2f}  {source:26s} {opening.inward:3d}  "
            f"{opening.outward:3d}  ({1e3 * x1:.1f}, {1e3 * y1:.1f}) -> ({1e3 * x2:.1f}, {1e3 * y2:.1f})"
            + (f"  left out: {opening.problem}" if opening.problem else "")
        )
    for opening in learned.borrowed:
        print(
            f"{opening.outer}-{opening.inner}    {math.degrees(opening.angle):6.2f}  never passed, from {learned.prior}"
        )
    x, y = learned.centre
    print(f"centre of the circles x {1e3 * x:.2f}, y {1e3 * y:.2f} mm; camera noise {1e3 * learned.noise:.2f} mm")
