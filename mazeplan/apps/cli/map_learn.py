"""`map learn`: rings and openings from logs in which the ball changed rings."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import print_json, say
from mazeplan.core.errors import TableError
from mazeplan.core.maths.angles import place_deg
from mazeplan.core.whole_file import write_text
from mazeplan.run.commands.log_context import logged_map

if TYPE_CHECKING:
    from mazeplan.maze.learnedmap import LearnedMap
    from mazeplan.maze.transitions import BallTrack

MapFile = Annotated[
    Path,
    typer.Option(
        "--output", "-o", parser=opt.file(*opt.YAML), callback=opt.new_file, metavar="FILE", help="Map file to write."
    ),
]  # fmt: skip
MinCount = Annotated[int, typer.Option("--min-count", min=1, metavar="N", help="Fewest passages of an opening.")]
PriorMap = Annotated[
    str | None, typer.Option("--map", metavar="MAP", help="Map for missing figures. Default: the log's, else cme.")
]


def learn(
    logs: opt.Logs,
    output: MapFile = Path("learned.yaml"),
    min_count: MinCount = 2,
    map_: PriorMap = None,
    columns: opt.Columns = None,
    force: opt.Force = False,
    json: opt.AsJson = False,
) -> None:
    """Learn rings and openings from the places of the ball and its changes of ring."""
    from mazeplan.apps.cli.progress import ProgressBar
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
    if json:
        print_json(document(learned, output))
    else:
        print("\n".join(map_lines(learned)))
    for line in learned.warnings:
        say(f"warning: {line}")
    for line in learned.problems:
        say(f"mazeplan: {names}: {line}")
    if learned.maze is None:
        raise typer.Exit(1)
    say(f"wrote {output}")


def _track(logs: list[Path], columns: list[str]) -> BallTrack:
    """The measured places of the ball in all logs. Raises TableError with file and line."""
    import numpy as np

    from mazeplan.core.logs.column_units import parse_columns
    from mazeplan.core.logs.table import join, read_table
    from mazeplan.maze.transitions import BallTrack

    tables = [read_table(log, parse_columns(columns)) for log in logs]
    for log, table in zip(logs, tables, strict=True):
        if "x" not in table or "y" not in table:
            raise TableError("needs x and y, or theta and r: theta alone shows no rings", file=log)
    whole = join(tables)
    seen = np.isfinite(whole["x"]) & np.isfinite(whole["y"])
    return BallTrack(whole["t"][seen], whole["x"][seen], whole["y"][seen], whole.segment[seen])


def document(learned: LearnedMap, output: Path) -> dict[str, Any]:
    """The document of `map learn --json`; lengths in m, angles in rad."""
    known = {key: value for key, value in asdict(learned).items() if key != "maze"}
    return {"map": None if learned.maze is None else str(output), **known}


def map_lines(learned: LearnedMap) -> list[str]:
    """Rings and openings as two tables."""
    lines = ["ring  inner mm         outer mm         samples at them"]
    for ring in learned.rings:
        inner, outer = (
            f"{1e3 * radius:6.2f} {'(a guess)' if sigma is None else f'± {1e3 * sigma:.3f}' if radius else '(disc)'}"
            for radius, sigma in ((ring.inner_radius, ring.inner_stderr), (ring.outer_radius, ring.outer_stderr))
        )
        lines.append(f"{ring.number:4d}  {inner:16s} {outer:16s} {ring.inner_touches}, {ring.outer_touches}")
    lines.append("rings  angle deg       width mm  width from                  passages")
    lines += [
        f"{o.outer}-{o.outer + 1}    {place_deg(o.angle, 2):6.2f} ± {math.degrees(o.angle_stderr):4.2f}  "
        f"{1e3 * (o.width or 0.0):8.2f}  {o.width_from:26s}  {o.count:8d}{f'  left out: {o.problem}' * bool(o.problem)}"
        for o in learned.openings
    ]
    x, y = (1e3 * value for value in learned.centre)
    return [*lines, f"centre of the circles x {x:.2f}, y {y:.2f} mm; camera noise {1e3 * learned.noise:.2f} mm"]
