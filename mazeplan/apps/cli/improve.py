"""`improve`: collect, diagnose, update the model and navigate, in rounds."""

from __future__ import annotations

import sys
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
    from mazeplan.run.commands.improve import improve as run_rounds

    note_missing_model(rig, model)
    with ProgressBar("improving") as bar:
        improved = run_rounds(
            rig, model=model, rounds=rounds, runs=runs, seconds=seconds, reference=reference or [],
            columns=columns or [], effects=effects, map=map_, seed=seed, workers=workers, output=output,
            own_process=True, tell=bar.note, progress=bar.show, advance=bar.advance,
        )  # fmt: skip
    done = improved.rounds
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
