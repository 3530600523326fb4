"""`learn`: fit the model of a rig to its logs."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import print_json, say
from mazeplan.core.errors import InputError, TableError

if TYPE_CHECKING:
    from mazeplan.core.logs.table import Table
    from mazeplan.learning.modelfile import RigModel
    from mazeplan.maze.geometry import Maze
    from mazeplan.run.learn import Drive, Learned

RUNS = 8  # of each model on a simulated rig


def learn(
    logs: opt.Logs,
    output: opt.OutputFolder,
    kind: opt.Kind = "sp",
    device: opt.Device = "cpu",
    most: opt.LearnRows = 4000,
    smoothing: opt.Smoothing = "rts",
    seed: opt.Seed = 0,
    rig: opt.DrivenRig = None,
    map_: opt.MapOfLog = None,
    columns: opt.Columns = None,
    force: opt.Force = False,
    as_json: opt.AsJson = False,
) -> None:
    """Fit the model of a rig, stage and ball, to its logs."""
    from mazeplan.core.logs.column_units import parse_columns
    from mazeplan.core.logs.table import check_there, read_table

    for log in logs:  # checked before torch loads
        check_there(log)
    from mazeplan.apps.cli.log_context import logged_map
    from mazeplan.apps.cli.model import model_lines
    from mazeplan.apps.cli.progress import ProgressBar
    from mazeplan.apps.report.words import verdict_lines
    from mazeplan.learning.fits import fits_words
    from mazeplan.learning.fitting import FitOptions
    from mazeplan.learning.gp_training import TrainingOptions
    from mazeplan.learning.modelfile import model_document, save_model
    from mazeplan.learning.smoothing import Smoothing
    from mazeplan.learning.torch_device import DEVICES
    from mazeplan.run.learn import learn as learn_model

    if device not in DEVICES:
        raise InputError(f"--device: got {device!r}, expected one of {', '.join(DEVICES)}")
    if device == "cuda":
        say("--device cuda: all kinds train on the processor")
    chosen = Smoothing("rts", model="snap") if smoothing == "rts" else Smoothing()
    options = FitOptions(most=most, training=TrainingOptions(starts=2), seed=seed)
    maze = logged_map(map_, *logs).maze
    with ProgressBar("learning") as bar:
        bar.show("reading")
        tables = [read_table(log, parse_columns(columns or [])) for log in logs]
        try:
            done = learn_model(
                tables, maze, kind, options, smoothing=chosen, progress=bar.show, advance=bar.advance,
                drive=None if rig is None else _drive(rig, maze),
            )  # fmt: skip
        except ValueError as problem:
            raise TableError(str(problem), file=", ".join(str(log) for log in logs)) from None
        path = save_model(done.model, output)
        kept = _keep_reference(done, output)
        bar.show("judging")
        verdict = _verdict(done.model, tables, maze, output)
    if as_json:
        written = {"model": str(path), "reference": kept, **model_document(done.model), "windows": done.fit.windows}
        judged = {"fits": done.fits(), "judged": done.judgement.document()}
        print_json(written | judged | {"verdict": verdict["verdict"], "advice": verdict["advice"], "score": verdict})
    else:
        lines = [*model_lines(done.model), f"fit: {fits_words(done.model)}", done.judgement.words()]
        lines += [f"rigid ball: {done.why}"] if done.model.body is None and done.why else []
        driven: dict[str, float] = done.model.scores.get("driven_s", {})
        lines += [f"driven: {', '.join(f'{name} {time:.2f} s' for name, time in driven.items())}"] if driven else []
        print("\n".join([*lines, f"wrote {path}", *verdict_lines(verdict)]))


def _drive(rig: str, maze: Maze) -> Drive:
    """Does a few runs on a simulated rig. Raises InputError for a rig in real time."""
    from mazeplan.rigs.interface import traits
    from mazeplan.rigs.registry import make_rig
    from mazeplan.run.campaign.one_run import start_angle
    from mazeplan.run.execution import attempt_job
    from mazeplan.run.specification import Job, Setup

    if traits(make_rig(rig, maze)).realtime:
        raise InputError(f"got {rig}, a rig in real time; expected a simulated one: learn would drive it", key="--rig")

    def times(model: RigModel) -> list[float]:
        out = []
        for i in range(RUNS):
            job = Job(1, len(maze.rings), start_angle(i), i)
            result, _ = attempt_job(make_rig(rig, maze), Setup(maze, model, rig_name=rig), job)
            out.append(result.time_s if result.success else math.inf)
        return out

    return times


def _verdict(model: RigModel, tables: list[Table], maze: Maze, folder: Path) -> dict[str, Any]:
    """The score of the model on the logs that it was learned from."""
    from mazeplan.apps.report.model_score import ring_errors, score_document

    try:
        rings = ring_errors(model, tables, maze)
    except InputError:  # the logs are too short for any ring
        rings = {}
    document = score_document(rings, str(folder), "LOG", [r.number for r in maze.rings[:-1]])
    document["because"] += "; on the logs that it was learned from"
    document["advice"].append(f"judge it on a log that it has not seen: mazeplan score {folder} NEW.mcap")
    return document


def _keep_reference(done: Learned, folder: Path) -> str | None:
    """Write the reference of the rig beside its model if the logs show a whole rig; otherwise remove an old one."""
    from mazeplan.diagnosis.rig.reference_file import reference_path, save_reference

    if done.reference is None:
        reference_path(folder).unlink(missing_ok=True)
        return None
    return str(save_reference(done.reference, done.model, folder))
