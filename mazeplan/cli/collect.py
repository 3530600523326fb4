"""`collect`."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mazeplan.cli.output import say
from mazeplan.errors import InputError

if TYPE_CHECKING:
    from mazeplan.collect import Collected


def collect(
    output: Annotated[Path, typer.Option("-o", "--output", help="Run log (MCAP) to write.")],
    rig: Annotated[str, typer.Option("--rig", help="Name of a rig (rig list), YAML file, or module:Class.")] = "toy",
    seconds: Annotated[float, typer.Option("--seconds", help="Duration in s of rig time.")] = 300.0,
    map_: Annotated[str, typer.Option("--map", help="Packaged map or YAML file.")] = "cme",
    ring: Annotated[str, typer.Option("--ring", help="Ring to start in.")] = "ring1",
    rings: Annotated[
        bool,
        typer.Option(
            "--rings", help="All rings in turn: the ball is driven to the next one; sines alone starve the inner ones."
        ),
    ] = False,
    place: Annotated[
        bool, typer.Option("--place", help="With --rings: place the ball in each ring, every 20 s, by hand.")
    ] = False,
    model: Annotated[
        str | None, typer.Option("--model", help="Model to drive with: packaged or folder; default: the rig's own.")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of commands, places and simulated noise.")] = 0,
    tilt: Annotated[
        float | None, typer.Option("--tilt", help="Largest tilt in degrees; default: the limit of the map.")
    ] = None,
    highest_hz: Annotated[float, typer.Option("--highest-hz", help="Highest frequency of the sines in Hz.")] = 1.5,
) -> None:
    """Excite a rig with 50 random sines per axis and log what it does."""
    from mazeplan.cli.arguments import parse_ring, positive
    from mazeplan.cli.emergency import interrupt, stop_key
    from mazeplan.cli.navigate import note_missing_model
    from mazeplan.cli.progress import campaign_progress
    from mazeplan.collect import Collection, run_collection, run_tour
    from mazeplan.maze.mapfile import load_map
    from mazeplan.rigs.registry import make_rig, rig_label
    from mazeplan.rigs.watchdog import watched

    if place and not rings:
        raise InputError("needs --rings: without it the ball is placed once anyway", key="--place")
    if model is not None and (place or not rings):
        raise InputError("needs --rings without --place: only then the ball is driven", key="--model")
    maze = load_map(map_)
    first = parse_ring(ring, maze)
    others = [r.number for r in maze.rings if r.number != first] if rings else []
    most = None if tilt is None else math.radians(positive("--tilt", tilt))
    if most is not None and most > maze.tilt_limit:
        raise InputError(f"--tilt: got {tilt:g}, expected at most {math.degrees(maze.tilt_limit):g} degrees")
    highest = positive("--highest-hz", highest_hz)
    plan = Collection(positive("--seconds", seconds), (first, *others), seed, most, highest, rig, map_)
    bar = campaign_progress(math.ceil(seconds), label="seconds")
    if not rings or place:
        machine = watched(make_rig(rig, maze), own_process=True)
        with _kept(output), stop_key(machine, interrupt), bar as advance:
            rows = run_collection(machine, maze, plan, output, rig_name=rig_label(rig), progress=advance)
        say(f"wrote {rows} samples to {output}")
        return

    from mazeplan.choices import resolve_model
    from mazeplan.job import Setup

    note_missing_model(rig, model, maze)
    setup = Setup(maze, resolve_model(model, rig, maze), rig_name=rig_label(rig), model_name=model or "")
    machine = watched(make_rig(rig, maze), own_process=True)
    with _kept(output), stop_key(machine, interrupt), bar as advance:
        done = run_tour(machine, setup, plan, output, progress=advance)
    report(done)
    say(f"wrote {done.rows} samples to {output}")


@contextmanager
def _kept(output: Path) -> Iterator[None]:
    """Whoever interrupts is told that nothing is lost."""
    try:
        yield
    except KeyboardInterrupt:
        if output.exists():
            say(f"what was recorded until then is in {output}")
        raise


def report(done: Collected) -> None:
    """Where the ball was and how it got there, on stderr."""
    say("time       " + ", ".join(f"ring {ring} {time:.0f} s" for ring, time in done.ring_s.items()))
    say(f"drives     {done.drives}, of which {done.failed} did not arrive; {done.changes} changes of ring")
    say("openings   " + ", ".join(f"{name} {count}" for name, count in done.passed.items()))
