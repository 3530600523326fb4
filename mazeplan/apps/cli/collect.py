"""`collect`: excite a rig and record it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import say
from mazeplan.core.errors import InputError

if TYPE_CHECKING:
    from mazeplan.run.collect import Collected

LEAST_TILT = 0.2  # degrees; a smaller tilt hardly moves a ball


def collect(
    output: opt.CollectedLog,
    rig: opt.RigName = "toy",
    seconds: opt.Seconds = 300.0,
    map_: opt.Map = "cme",
    ring: opt.FirstRing = "ring1",
    rings: opt.AllRings = False,
    place: opt.Place = False,
    model: opt.Model = None,
    seed: opt.Seed = 0,
    tilt: opt.Tilt = None,
    highest_hz: opt.HighestHz = 1.5,
    force: opt.Force = False,
) -> None:
    """Excite a rig with 50 random sines per axis and write a log."""
    from mazeplan.apps.cli.emergency import interrupt, stop_key
    from mazeplan.apps.cli.navigate import note_missing_model
    from mazeplan.apps.cli.progress import campaign_progress
    from mazeplan.maze.mapfile import load_map
    from mazeplan.rigs.registry import make_rig, rig_label
    from mazeplan.rigs.watchdog import watched
    from mazeplan.run.collect import Collection, run_collection, run_tour
    from mazeplan.run.resolve import resolve_model, ring_number
    from mazeplan.run.specification import Setup

    if model is not None and (place or not rings):
        raise InputError("needs --rings without --place: only then the model drives the ball", key="--model")
    maze = load_map(map_)
    first = ring_number(ring, maze)
    others = [r.number for r in maze.rings if r.number != first] if rings else []
    limit = math.degrees(maze.tilt_limit)
    if tilt is not None and not (tilt >= LEAST_TILT and math.radians(tilt) <= maze.tilt_limit):
        raise InputError(f"--tilt: got {tilt:g}, expected {LEAST_TILT:g} to {limit:g} degrees")
    most = None if tilt is None else math.radians(tilt)
    plan = Collection(seconds, (first, *others), seed, most, highest_hz, rig, map_)
    setup, tour = None, None
    if rings and not place:
        note_missing_model(rig, model)
        setup = Setup(maze, resolve_model(model, rig, maze), rig_name=rig_label(rig), model_name=model or "")
    machine = watched(make_rig(rig, maze), own_process=True)
    if highest_hz > 0.5 * machine.rate_hz:
        why = f"expected at most {0.5 * machine.rate_hz:g} Hz: half the samples a second of the rig"
        raise InputError(f"--highest-hz: got {highest_hz:g}, {why}")
    bar = campaign_progress(math.ceil(seconds), label="seconds")
    with _report_kept(output), stop_key(machine, interrupt), bar as advance:
        if setup is None:
            rows = run_collection(machine, maze, plan, output, rig_name=rig_label(rig), progress=advance)
        else:
            tour = run_tour(machine, setup, plan, output, progress=advance)
            rows = tour.rows
    if tour is not None:
        report(tour)
    say(f"wrote {rows} samples to {output}")


@contextmanager
def _report_kept(output: Path) -> Iterator[None]:
    """On Ctrl-C, print the file that holds the samples so far."""
    try:
        yield
    except KeyboardInterrupt:
        if output.exists():
            say(f"the samples so far are in {output}")
        raise


def report(tour: Collected) -> None:
    """Print the time in each ring, the drives and the passed openings on stderr."""
    say("time       " + ", ".join(f"ring {ring} {time:.0f} s" for ring, time in tour.ring_s.items()))
    say(f"drives     {tour.drives}, {tour.failed} did not arrive; {tour.changes} changes of ring")
    say("openings   " + ", ".join(f"{name} {count}" for name, count in tour.passed.items()))
