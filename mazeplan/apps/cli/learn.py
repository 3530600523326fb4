"""`learn`: fit the model of a rig to its logs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import plural, print_json
from mazeplan.core.errors import InputError, TableError

if TYPE_CHECKING:
    from mazeplan.control.estimation.rigid_body_filter import BodyModel
    from mazeplan.core.logs.table import Table
    from mazeplan.diagnosis.rig.reference import RigReference
    from mazeplan.learning.ball_models import BallModel
    from mazeplan.learning.identification import RigFit
    from mazeplan.learning.modelfile import RigModel
    from mazeplan.learning.rig_gp import RingLearning
    from mazeplan.maze.geometry import Maze

TABLE = "tilt_offset"  # an effect of the table, the same for all rings
WITH_BODY = ("pi", "sp", "spnn")  # kinds with effects that were fitted; the others leave physics out on purpose


def learn(
    logs: opt.Logs,
    output: opt.OutputFolder,
    kind: opt.Kind = "sp",
    device: opt.Device = "cpu",
    most: opt.LearnRows = 4000,
    smoothing: opt.Smoothing = "rts",
    seed: opt.Seed = 0,
    map_: opt.MapOfLog = None,
    force: opt.Force = False,
    as_json: opt.AsJson = False,
) -> None:
    """Fit the model of a rig, stage and ball, to its logs."""
    from mazeplan.core.logs.table import check_there, join, read_table

    for log in logs:  # checked before torch loads
        check_there(log)
    from mazeplan.apps.cli.log_context import logged_map
    from mazeplan.apps.cli.progress import ProgressBar
    from mazeplan.apps.report.words import verdict_lines
    from mazeplan.learning.fitting import NETWORKS, FitOptions
    from mazeplan.learning.gp_training import TrainingOptions, require_torch
    from mazeplan.learning.identification import fit_rig
    from mazeplan.learning.modelfile import RigModel, model_document, save_model
    from mazeplan.learning.rig_gp import learn_processes
    from mazeplan.learning.smoothing import Smoothing

    learns = kind not in ("p", "pi")
    if device == "cuda" and (not learns or kind in NETWORKS):
        raise InputError(
            f"--device: got cuda with --kind {kind}, which trains on the processor; expected cpu, or --kind sp or np"
        )
    if learns:
        require_torch()
    chosen = Smoothing("rts", model="snap") if smoothing == "rts" else Smoothing()
    options = FitOptions(most=most, training=TrainingOptions(device=device, starts=2), seed=seed)
    maze = logged_map(map_, *logs).maze
    with ProgressBar("learning") as bar:
        bar.show("reading")
        tables = [read_table(log) for log in logs]
        table = join(tables)
        try:
            fit = fit_rig(table, maze, tuple(table.source for table in tables), progress=bar.show)
        except ValueError as problem:
            raise TableError(str(problem), file=", ".join(str(log) for log in logs)) from None
        model, learned = fit.model, {}
        if kind == "p":
            model = replace(model, kind="p", balls=RigModel.nominal(maze).balls, scores={})
        if learns:
            model, learned = learn_processes(
                table, maze, model, kind, options, smoothing=chosen, progress=bar.show, advance=bar.advance
            )
        path = save_model(model, output)
        bar.show("judging")
        verdict = _verdict(model, tables, maze, output)
        bar.show("reference for later diagnoses")
        kept, model, body = _keep_reference(table, maze, model, output, kind in WITH_BODY)
        if model.body is not None:
            save_model(model, output)
    if as_json:
        kept = None if kept is None else str(kept)
        written = {"model": str(path), "reference": kept, **model_document(model), "windows": fit.windows}
        print_json(written | {"verdict": verdict["verdict"], "advice": verdict["advice"], "score": verdict})
    else:
        lines = [rows_line(table), *model_lines(fit, model), *_learned_lines(learned, kind)]
        lines += [*([body] if body else []), f"wrote {path}"]
        print("\n".join([*lines, *verdict_lines(verdict)]))


def _learned_lines(learned: dict[int, RingLearning], kind: str) -> list[str]:
    """What was learned beside the effects, ring by ring."""
    from mazeplan.learning.fitting import NETWORKS

    part = "networks" if kind in NETWORKS else "Gaussian process"
    return [
        f"ring {ring} {part}: {x.rows} rows, nRMSE of theta_dd on test blocks {x.before:.3f} by effects alone, "
        f"{x.after:.3f} with it"
        for ring, x in learned.items()
    ]


def rows_line(table: Table) -> str:
    """How many rows the logs have, and in how many of them the ball was not seen."""
    unseen = sum(not math.isfinite(theta) for theta in table["theta"])
    gaps = f", {unseen} of them without the ball: gaps" if unseen else ""
    return f"log          {plural(len(table), 'row')}{gaps}"


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


def _keep_reference(
    table: Table, maze: Maze, model: RigModel, folder: Path, body: bool
) -> tuple[Path | None, RigModel, str]:
    """Write the reference of the rig beside its model if the logs show a whole rig; otherwise remove an old one.

    body: whether to add the rigid ball to the model. Returns the file, the model, and a line about the ball"""
    from mazeplan.diagnosis.rig.record import body_filter, remaining_of, why_not_whole
    from mazeplan.diagnosis.rig.reference import reference_of, shortened
    from mazeplan.diagnosis.rig.reference_file import reference_path, save_reference

    why, reference, kept = why_not_whole([table]), None, None
    if why:
        reference_path(folder).unlink(missing_ok=True)
    else:
        reference = reference_of([shortened(table)], maze, model)
        kept = save_reference(reference, model, folder)
    if not body:
        return kept, model, ""
    new, line = with_rigid_ball(
        model, reference, why, lambda ball: remaining_of(body_filter(shortened(table), maze)[0], ball)
    )
    return kept, new, line


def with_rigid_ball(
    model: RigModel, reference: RigReference | None, why: str, remaining: Callable[[BodyModel], float]
) -> tuple[RigModel, str]:
    """The model with the rigid ball of the reference, if this ball explains the logs, and a line about it.

    why: why there is no reference
    remaining: size of the innovations of a ball over the noise of the camera. A run knows the ball by the camera and
        the tilt sensor of the model, which the fit of the reference left free"""
    from mazeplan.control.estimation.rigid_body_parameters import body_of, with_body
    from mazeplan.diagnosis.rig.result import REMAINS

    if reference is None:
        return model, f"rigid ball   none: {why}"
    ball, stderr = reference.body.model.ball, reference.body.stderr
    new = with_body(model, reference.body.model, stderr)
    used = body_of(new)
    left = math.inf if used is None else remaining(used)
    words = f"what remains is {left:.1f} times the noise of the camera"
    if not left <= REMAINS:  # also NaN
        return model, f"rigid ball   none: {words}; is the camera in the middle, and to scale?"
    friction = f"rolling friction {ball.rolling:.4f} ± {stderr['rolling']:.4f} m/s^2"
    return new, f"rigid ball   {friction}, friction at walls {ball.wall:.3f} ± {stderr['wall']:.3f}; {words}"


def model_lines(fit: RigFit, model: RigModel) -> list[str]:
    """The fitted parameters with their standard errors."""
    lines = []
    for name, axis, found in (("beta", model.stage.beta, fit.stage[0]), ("gamma", model.stage.gamma, fit.stage[1])):
        e = axis.stderr
        poles = ", ".join(f"{pole.real:.1f}{pole.imag:+.1f}j" for pole in axis.poles())
        lines.append(
            f"stage {name:5s}  gain {axis.gain:.4f} ± {e['gain']:.4f}, {axis.natural_frequency:.1f} ± "
            f"{e['natural_frequency']:.1f} rad/s, damping {axis.damping:.2f} ± {e['damping']:.2f}, dead time "
            f"{1e3 * axis.dead_time:.1f} ± {1e3 * e['dead_time']:.1f} ms, poles {poles} rad/s, rms {found.rms:.2g} rad"
        )
        if e["natural_frequency"] > axis.natural_frequency:
            lines.append(f"stage {name:5s}  the record shows only the slower pole; the faster one is too fast for it")
    delay, error = 1e3 * model.camera_delay, 1e3 * (model.camera_delay_stderr or 0.0)
    lines.append(f"camera       {delay:.1f} ± {error:.1f} ms behind the tilt sensor")
    own = {*fit.windows, *model.processes}
    table = {"; ".join(_parameters(ball, TABLE, True)) for ball in model.balls.values()} - {""}
    once = len(table) == 1  # the same in each ring that has it, so one line is enough
    lines += [f"table        {text}" for text in table if once]
    for ring, ball in sorted(model.balls.items()):
        names = [effect.name for effect in ball.effects if not (once and effect.name == TABLE)]
        words = [text for name in names for text in _parameters(ball, name, ring in own)]
        note = f" ({fit.windows[ring]} windows)" if ring in fit.windows else ""
        note = note if ring in own else " (no data of its own)"
        lines.append(f"ring {ring}{note}  {'; '.join(words)}")
    return lines


def _parameters(ball: BallModel, name: str, measured: bool) -> list[str]:
    """The fitted parameters of an effect of a ring. measured: whether to add their standard errors"""
    texts, errors = [], ball.stderr.get(name, {})
    for effect in ball.effects:
        for key, value in effect.values().items():
            if effect.name == name and key in errors:
                unit = effect.effect.parameters[key].unit
                error = f" ± {errors[key]:.4f}" if measured else ""
                texts.append(f"{name} {key} {value:.4f}{error} {'' if unit == '1' else unit}".rstrip())
    return texts
