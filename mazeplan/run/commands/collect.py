"""`collect`: excite a rig and record it."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import ClassVar

from mazeplan.core.errors import InputError
from mazeplan.core.progress import Advance, no_advance, of_total
from mazeplan.core.results import DocumentResult
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.interface import Rig
from mazeplan.rigs.registry import make_rig, rig_label
from mazeplan.rigs.watchdog import watched
from mazeplan.run.collect import Collected, Collection, run_collection, run_tour
from mazeplan.run.resolve import resolve_model, ring_number
from mazeplan.run.specification import Setup

LEAST_TILT = 0.2  # degrees; a smaller tilt hardly moves a ball


@dataclass(frozen=True)
class RecordResult(DocumentResult):
    """A record of a rig: the document of `collect --json`, the log, and what the tour did, if the ball was driven."""

    kind: ClassVar[str] = "record"

    log: Path
    tour: Collected | None


def collect(
    output: str | Path,
    seconds: float = 300.0,
    *,
    rig: str | Path | Rig | type = "toy",
    map: str | Path | Maze = "cme",
    ring: int | str = 1,
    rings: bool = False,
    place: bool = False,
    model: str | Path | RigModel | None = None,
    seed: int = 0,
    tilt: float | None = None,
    highest_hz: float = 1.5,
    own_process: bool = False,
    guard: Callable[[Rig], AbstractContextManager[object]] = nullcontext,
    advance: Advance = no_advance,
) -> RecordResult:
    """Excite a rig with 50 random sines per axis and write a log.

    output: run log (MCAP) to write
    seconds: length of the record, s of rig time
    ring: where the ball is placed; rings: whether the ball visits all rings, driven with the model
    place: with `rings`: whether a person places the ball in each ring instead
    tilt: largest tilt, degrees; None: the map's limit
    highest_hz: highest frequency of the sines
    guard: context in which the rig is driven, such as an emergency stop
    advance: gets the progress, s

    Raises InputError, RigError."""
    if (model is not None and (place or not rings)) or (place and not rings):
        raise InputError("--model needs --rings without --place, --place needs --rings: else they have no effect")
    if not 0.0 < seconds < math.inf:
        raise InputError(f"got {seconds:g}, expected a finite number > 0 of s", key="--seconds")
    maze = map if isinstance(map, Maze) else load_map(map)
    first = ring_number(ring, maze)
    others = [r.number for r in maze.rings if r.number != first] if rings else []
    if tilt is not None and not (tilt >= LEAST_TILT and math.radians(tilt) <= maze.tilt_limit):
        allowed = f"{LEAST_TILT:g} to {math.degrees(maze.tilt_limit):g}"
        raise InputError(f"--tilt: got {tilt:g}, expected {allowed} degrees")
    spec, label = str(rig) if isinstance(rig, str | Path) else None, rig_label(rig)
    plan = Collection(seconds, (first, *others), seed, None if tilt is None else math.radians(tilt), highest_hz)
    setup, tour = None, None
    if rings and not place:
        name = "" if isinstance(model, RigModel | None) else str(model)
        setup = Setup(maze, resolve_model(model, spec, maze), rig_name=label, model_name=name)
    machine = watched(make_rig(rig, maze), own_process=own_process)
    if highest_hz > 0.5 * machine.rate_hz:
        why = f"expected at most {0.5 * machine.rate_hz:g} Hz: half the samples a second of the rig"
        raise InputError(f"--highest-hz: got {highest_hz:g}, {why}")
    shown = of_total(advance, math.ceil(seconds))
    with guard(machine):
        if setup is not None:
            tour = run_tour(machine, setup, plan, output, progress=shown)
        samples = tour.rows if tour else run_collection(machine, maze, plan, output, rig_name=label, progress=shown)
    document = {
        "log": str(output), "samples": samples, "seconds": seconds, "rig": label, "seed": seed,
        "map": maze.name if isinstance(map, Maze) else str(map), "tour": None if tour is None else asdict(tour),
    }  # fmt: skip
    return RecordResult(document, Path(output), tour)
