"""`learn`: fit the model of a rig to its logs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import print_json
from mazeplan.core.errors import TableError

if TYPE_CHECKING:
    from mazeplan.core.logs.table import Table
    from mazeplan.learning.ball_models import BallModel
    from mazeplan.learning.identification import RigFit
    from mazeplan.learning.modelfile import RigModel
    from mazeplan.maze.geometry import Maze


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
    from mazeplan.apps.cli.log_context import logged_map
    from mazeplan.apps.cli.progress import ProgressBar
    from mazeplan.core.logs.table import join, read_table
    from mazeplan.learning.fitting import NETWORKS, FitOptions
    from mazeplan.learning.gp_training import TrainingOptions, require_torch
    from mazeplan.learning.identification import fit_rig
    from mazeplan.learning.modelfile import RigModel, model_document, save_model
    from mazeplan.learning.rig_gp import learn_processes
    from mazeplan.learning.smoothing import Smoothing

    learns = kind not in ("p", "pi")
    if learns:
        require_torch()
    chosen = Smoothing("rts", model="snap") if smoothing == "rts" else Smoothing()
    options = FitOptions(most=most, training=TrainingOptions(device=device, starts=2), seed=seed)
    maze = logged_map(map_, logs[0]).maze
    with ProgressBar("learning") as bar:
        bar.show("reading")
        tables = [read_table(log) for log in logs]
        table = join(tables)
        try:
            fit = fit_rig(table, maze, tuple(table.source for table in tables), progress=bar.show)
        except ValueError as problem:
            raise TableError(str(problem), file=", ".join(str(log) for log in logs)) from None
        model, lines = fit.model, []
        if kind == "p":
            model = replace(model, kind="p", balls=RigModel.nominal(maze).balls, scores={})
        if learns:
            model, learned = learn_processes(
                table, maze, model, kind, options, smoothing=chosen, progress=bar.show, advance=bar.advance
            )
            part = "networks" if kind in NETWORKS else "Gaussian process"
            lines = [
                f"ring {ring} {part}: {x.rows} rows, nRMSE of theta_dd on test blocks {x.before:.3f} by "
                f"effects alone, {x.after:.3f} with it"
                for ring, x in learned.items()
            ]
        path = save_model(model, output)
        bar.show("reference for later diagnoses")
        reference = _keep_reference(table, maze, model, output)
    if as_json:
        kept = None if reference is None else str(reference)
        print_json({"model": str(path), "reference": kept, **model_document(model), "windows": fit.windows})
    else:
        print("\n".join([*model_lines(fit, model), *lines, f"wrote {path}"]))


def _keep_reference(table: Table, maze: Maze, model: RigModel, folder: Path) -> Path | None:
    """Write the reference of the rig beside its model if the logs show a whole rig; else remove an old one."""
    from mazeplan.diagnosis.rig.record import whole_rig
    from mazeplan.diagnosis.rig.reference import reference_of, shortened
    from mazeplan.diagnosis.rig.reference_file import reference_path, save_reference

    if not whole_rig([table]):
        reference_path(folder).unlink(missing_ok=True)
        return None
    return save_reference(reference_of([shortened(table)], maze, model), model, folder)


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
    for ring, ball in sorted(model.balls.items()):
        note = " (no data of its own)" if ring not in model.processes else ""
        note = f" ({fit.windows[ring]} windows)" if ring in fit.windows else note
        lines.append(f"ring {ring}{note}  {_parameters(ball)}")
    return lines


def _parameters(ball: BallModel) -> str:
    """The fitted parameters of a ring's effects."""
    parts = []
    for effect in ball.effects:
        for name, value in effect.values().items():
            error = ball.stderr.get(effect.name, {}).get(name)
            if error is not None:
                unit = effect.effect.parameters[name].unit
                parts.append(f"{effect.name} {name} {value:.4f} ± {error:.4f} {'' if unit == '1' else unit}".rstrip())
    return "; ".join(parts)
