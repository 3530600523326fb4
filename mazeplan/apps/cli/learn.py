"""`learn`: fit the model of a rig to its logs."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import plural, print_json, say
from mazeplan.core.errors import InputError, TableError

if TYPE_CHECKING:
    from mazeplan.core.logs.table import Table
    from mazeplan.learning.ball_models import BallModel
    from mazeplan.learning.identification import RigFit
    from mazeplan.learning.modelfile import RigModel
    from mazeplan.learning.rig_gp import RingLearning
    from mazeplan.learning.stage_fit import StageFit
    from mazeplan.maze.geometry import Maze
    from mazeplan.physics.rig.stage import StageAxis
    from mazeplan.run.learn import Drive, Learned

RUNS = 8  # of each model on a simulated rig
TABLE = "tilt_offset"  # an effect of the table, the same for all rings


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
    force: opt.Force = False,
    as_json: opt.AsJson = False,
) -> None:
    """Fit the model of a rig, stage and ball, to its logs."""
    from mazeplan.core.logs.table import check_there, read_table

    for log in logs:  # checked before torch loads
        check_there(log)
    from mazeplan.apps.cli.log_context import logged_map
    from mazeplan.apps.cli.progress import ProgressBar
    from mazeplan.apps.report.words import verdict_lines
    from mazeplan.core.logs.table import join
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
        tables = [read_table(log) for log in logs]
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
        lines = [rows_line(join(tables)), *model_lines(done.fit, done.model), *_learned_lines(done.rings, kind)]
        lines += [
            _ball_line(done),
            f"fit          {fits_words(done.model)}",
            done.judgement.words(),
            *_driven_line(done.model),
            f"wrote {path}",
        ]
        print("\n".join([*lines, *verdict_lines(verdict)]))


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


def _learned_lines(learned: dict[int, RingLearning], kind: str) -> list[str]:
    """What was learned beside the effects, ring by ring."""
    return [
        f"ring {ring} Gaussian process: {x.rows} rows, nRMSE of theta_dd on test blocks {x.before:.3f} by effects "
        f"alone, {x.after:.3f} with it"
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


def _keep_reference(done: Learned, folder: Path) -> str | None:
    """Write the reference of the rig beside its model if the logs show a whole rig; otherwise remove an old one."""
    from mazeplan.diagnosis.rig.reference_file import reference_path, save_reference

    if done.reference is None:
        reference_path(folder).unlink(missing_ok=True)
        return None
    return str(save_reference(done.reference, done.model, folder))


def _ball_line(done: Learned) -> str:
    """The rigid ball of the model, or why it has none."""
    body = done.model.body
    if body is None:
        return f"rigid ball   none: {done.why or 'a bead in each ring predicts as well, or the kind leaves it out'}"
    shown = (
        ("rolling", "rolling friction", " m/s^2"),
        ("wall", "friction at walls", ""),
        ("restitution", "rebound", ""),
    )
    words = [
        f"{name} {body.values.get(key, 0.0):.3f} ± {body.stderr.get(key, math.nan):.3f}{unit}"
        for key, name, unit in shown
    ]
    return f"rigid ball   {', '.join(words)}"


def _driven_line(model: RigModel) -> list[str]:
    """How each model drove the simulated rig."""
    driven: dict[str, float] = model.scores.get("driven_s", {})
    return [f"driven       {', '.join(f'{name} {time:.2f} s' for name, time in driven.items())}"] if driven else []


def _measured_by(found: StageFit) -> str:
    """What an axis was fitted to."""
    if math.isnan(found.rms):
        return "by the ball, as no tilt was measured"
    return f"{found.times_noise:.1f} times the noise of the tilt sensor"


def axis_words(axis: StageAxis) -> str:
    """How an axis follows its commands, with standard errors."""
    e = {**dict.fromkeys(("gain", "natural_frequency", "damping", "dead_time"), math.nan), **axis.stderr}
    kind = (
        f"follows at once: faster than {axis.natural_frequency:.0f} rad/s",
        f"first order, {axis.natural_frequency:.1f} ± {e['natural_frequency']:.1f} rad/s",
        f"second order, {axis.natural_frequency:.1f} ± {e['natural_frequency']:.1f} rad/s, damping {axis.damping:.2f} "
        f"± {e['damping']:.2f}",
    )[axis.order]
    more = [f"gain {axis.gain:.4f} ± {e['gain']:.4f}"]
    more += [f"dead time {1e3 * axis.dead_time:.1f} ± {1e3 * e['dead_time']:.1f} ms"] if axis.dead_time else []
    more += [f"rate at most {math.degrees(axis.rate_limit):.0f} deg/s"] if math.isfinite(axis.rate_limit) else []
    more += [f"backlash {math.degrees(axis.backlash):.2f} deg"] if axis.backlash else []
    more += [f"steps of {math.degrees(axis.resolution):.2f} deg"] if axis.resolution else []
    return ", ".join([kind, *more])


def model_lines(fit: RigFit, model: RigModel) -> list[str]:
    """The fitted parameters with their standard errors."""
    lines = [
        f"stage {name:5s}  {axis_words(axis)}; {_measured_by(found)}"
        for name, axis, found in zip(("beta", "gamma"), (model.stage.beta, model.stage.gamma), fit.stage, strict=True)
    ]
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
