"""`improve`: collect, diagnose, update the model and navigate, in rounds."""

from __future__ import annotations

import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import print_json


def improve(
    rig: opt.RigName,
    model: opt.KnownModel = None,
    rounds: opt.Rounds = 1,
    runs: opt.RoundRuns = 16,
    seconds: opt.Seconds = 400.0,
    reference: opt.Reference = None,
    columns: opt.Columns = None,
    effects: opt.EffectModule = None,
    map_: opt.Map = "cme",
    seed: opt.Seed = 0,
    workers: opt.Processes = 1,
    output: opt.ReportFolder = None,
    force: opt.Force = False,
    as_json: opt.AsJson = False,
) -> None:
    """Collect, diagnose, update the model, and navigate with the old and the new model.

    Exit status 1: a diagnosis found an unknown effect, or not all navigations arrived with the last model."""
    from mazeplan.apps.cli.navigate import note_missing_model
    from mazeplan.apps.cli.progress import ProgressBar
    from mazeplan.core.logs.column_units import parse_columns
    from mazeplan.core.logs.table import read_table
    from mazeplan.maze.mapfile import load_map
    from mazeplan.physics.registry import own_effects
    from mazeplan.rigs.registry import make_rig
    from mazeplan.run.campaign import improve as campaign

    maze = load_map(map_)
    own = own_effects(effects)
    make_rig(rig, maze)
    note_missing_model(rig, model)
    options = campaign.Options(rounds, runs, seconds, seed, workers, map_, True, effects)
    with ExitStack() as stack:
        folder = output or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="mazeplan-improve-")))
        bar = stack.enter_context(ProgressBar("improving"))
        known = [read_table(log, parse_columns(columns or [])) for log in reference or []]
        shown: dict[str, Any] = {"tell": bar.note, "working": bar.show, "advance": bar.advance}
        done = campaign.improve(rig, folder, options, model=model, reference=known, own=own, **shown)
    if output is None:
        for entry in done:
            entry["diagnosis"]["model"] = None
    if as_json:
        print_json({"rounds": done})
    else:
        print("\n".join(round_lines(done)))
    unknown = any(entry["diagnosis"]["verdict"] == "unknown_effect" for entry in done)
    sys.exit(1 if unknown or done[-1]["navigation"]["after"]["success"] != runs else 0)


def round_lines(rounds: list[dict[str, Any]]) -> list[str]:
    """Lines for each round: the diagnosis, the navigations before and after, and the model."""
    lines = []
    for number, entry in enumerate(rounds, start=1):
        lines.append(f"round {number}: {entry['diagnosis']['sentence']}")
        for when, n in entry["navigation"].items():
            mean = n["time_s"]["mean"]
            lines.append(
                f"  {when:7s} {n['success']} of {n['runs']} arrived" + (f", mean {mean:.2f} s" if mean else "")
            )
        if entry["diagnosis"]["model"]:
            lines.append(f"  model   {entry['diagnosis']['model']}")
    return lines
