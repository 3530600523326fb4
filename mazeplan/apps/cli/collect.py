"""`collect`: excite a rig and record it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import print_json, say

if TYPE_CHECKING:
    from mazeplan.run.collect import Collected


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
    as_json: opt.AsJson = False,
) -> None:
    """Excite a rig with 50 random sines per axis and write a log."""
    from mazeplan.apps.cli.emergency import interrupt, stop_key
    from mazeplan.apps.cli.navigate import note_missing_model
    from mazeplan.apps.cli.progress import ProgressBar
    from mazeplan.run.commands.collect import collect as record

    if rings and not place:
        note_missing_model(rig, model)
    with _report_kept(output), ProgressBar("seconds", transient=False) as bar:
        done = record(
            output, seconds, rig=rig, map=map_, ring=ring, rings=rings, place=place, model=model, seed=seed, tilt=tilt,
            highest_hz=highest_hz, own_process=True, guard=lambda machine: stop_key(machine, interrupt),
            advance=bar.advance,
        )  # fmt: skip
    if done.tour is not None:
        report(done.tour)
    if as_json:
        print_json(done.document)
    say(f"wrote {done.document['samples']} samples to {output}")


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
