"""`evaluate`: many runs, in processes or on Dask, kept in a store, with or without faults."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.navigate import note_missing_model
from mazeplan.apps.cli.output import print_json, say


def evaluate(
    runs: opt.Runs = None,
    rig: opt.RigName = "toy",
    map_: opt.Map = "cme",
    model: opt.Model = None,
    effects: opt.EffectModule = None,
    policy: opt.Policy = None,
    behavior: opt.Behavior = "navigate",
    behavior_module: opt.BehaviorModule = None,
    settings: opt.Settings = None,
    start: opt.StartRing = "ring1",
    goal: opt.GoalRing = "centre",
    balls: opt.Balls = None,
    seed: opt.Seed = 0,
    time_limit: opt.TimeLimit = 20.0,
    workers: opt.Workers = None,
    dask: opt.Dask = None,
    store: opt.Store = None,
    no_deadline: opt.NoDeadline = False,
    faults: opt.Faults = None,
    compare: opt.Compare = None,
    report: opt.Report = None,
    force: opt.Force = False,
    as_json: opt.AsJson = False,
) -> None:
    """Run many navigations and summarise success, times and failures; with --faults also the response to each fault."""
    if compare is not None:
        _compare(compare, as_json)
        return
    from mazeplan.apps.cli.progress import ProgressBar
    from mazeplan.apps.report.evaluation import evaluation_section
    from mazeplan.apps.report.inputs import Input
    from mazeplan.apps.report.page import section_text
    from mazeplan.maze.mapfile import load_map
    from mazeplan.rigs.registry import make_rig
    from mazeplan.run.assembly import with_balls
    from mazeplan.run.commands.evaluate import evaluate as run_all

    make_rig(rig, with_balls(load_map(map_), balls))
    note_missing_model(rig, model)
    with ProgressBar("runs", transient=False) as bar:
        done = run_all(
            runs, rig=rig, map=map_, model=model, effects=effects, policy=policy, behavior=behavior,
            behavior_modules=behavior_module or (), settings=settings, start=start, goal=goal, balls=balls, seed=seed,
            time_limit=time_limit, workers=workers, dask=dask, store=store, deadline=not no_deadline, faults=faults,
            own_process=True, say=bar.note, advance=bar.advance,
        )  # fmt: skip
    if report is not None:
        say(f"wrote {done.report(report)}")
    if as_json:
        print_json(done.document)
    else:
        name = done.document["setup"]["rig"] + (" with faults" if faults else "")
        print(section_text(evaluation_section(Input("evaluation", Path(name), name, done.json()))))
    sys.exit(_exit_status(done.document))


def _compare(files: tuple[Path, Path], as_json: bool) -> None:
    from mazeplan.apps.report.inputs import read_document
    from mazeplan.run.campaign.pairs import paired

    a, b = (read_document(file, "the JSON of evaluate") for file in files)
    done = paired(a, b, (str(files[0]), str(files[1])))
    if as_json:
        print_json(done.document)
    else:
        print(done.sentence)


def _exit_status(document: dict[str, Any]) -> int:
    """0 if all runs arrived, or with faults if all faults ended as they should.

    Raises RigError if a rig failed in a campaign without faults."""
    from mazeplan.core.errors import RigError
    from mazeplan.core.records import FailureKind
    from mazeplan.run.commands.evaluate import good

    if "faults" in document:
        return 0 if good(document["faults"]) else 1
    failures = (failure for result in document["results"] for failure in result["failures"])
    failed = next((failure for failure in failures if failure["kind"] == FailureKind.RIG_FAILED.value), None)
    if failed is not None:
        raise RigError(failed["words"])
    return 0 if document["success"] == document["runs"] else 1
