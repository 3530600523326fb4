"""`learn`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mazeplan.cli.output import print_json
from mazeplan.errors import InputError, TableError

if TYPE_CHECKING:
    from mazeplan.data.table import Table
    from mazeplan.maze.geometry import Maze
    from mazeplan.models.identification import Fit
    from mazeplan.models.modelfile import RigModel
    from mazeplan.models.rig_learning import RingLearning

KINDS = ("p", "pi", "np", "sp")


def learn(
    logs: Annotated[list[Path], typer.Argument(help="Run logs (MCAP) or tables (CSV).")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder of the model.")],
    kind: Annotated[
        str,
        typer.Option(
            "--kind",
            help="p: nominal ball, stage fitted; pi: ball fitted too; sp: a Gaussian process for what that leaves; "
            "np: a Gaussian process alone.",
        ),
    ] = "sp",
    device: Annotated[str, typer.Option("--device", help="cpu or cuda, for training np and sp.")] = "cpu",
    most: Annotated[int, typer.Option("--most", min=300, help="Training rows of a process and ring.")] = 4000,
    smoothing: Annotated[str, typer.Option("--smoothing", help="Of np and sp: rts or savgol.")] = "rts",
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the training's starts.")] = 0,
    map_: Annotated[
        str | None, typer.Option("--map", help="Packaged map or YAML file; default: that of the first log, else cme.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")] = False,
) -> None:
    """Fit the model of a rig, stage and ball, to logs of it."""
    from dataclasses import replace

    from mazeplan.cli.arguments import check_folder, logged_map
    from mazeplan.cli.progress import Working
    from mazeplan.data.smoothing import Smoothing
    from mazeplan.data.table import join, read_table
    from mazeplan.models.fitting import FitOptions
    from mazeplan.models.gp_training import TrainingOptions, require_torch
    from mazeplan.models.identification import fit_rig
    from mazeplan.models.modelfile import RigModel, model_document, save_model
    from mazeplan.models.rig_learning import learn_processes

    if kind not in KINDS:
        raise InputError(f"--kind: got {kind!r}, expected one of {', '.join(KINDS)}")
    if smoothing not in ("rts", "savgol"):
        raise InputError(f"--smoothing: got {smoothing!r}, expected rts or savgol")
    if kind in ("np", "sp"):
        require_torch()
    chosen = Smoothing("rts", model="snap") if smoothing == "rts" else Smoothing()
    options = FitOptions(most=most, training=TrainingOptions(device=device, starts=2), seed=seed)
    maze, _ = logged_map(map_, logs[0])
    check_folder("-o", output)
    with Working("learning") as shown:
        shown.tell("reading")
        tables = [read_table(log) for log in logs]
        table = join(tables)
        try:
            fit = fit_rig(table, maze, tuple(table.source for table in tables), progress=shown.tell)
        except ValueError as problem:
            raise TableError(str(problem), file=", ".join(str(log) for log in logs)) from None
        model = fit.model
        if kind == "p":
            model = replace(model, kind="p", balls=RigModel.nominal(maze).balls, scores={})
        learned: dict[int, RingLearning] = {}
        if kind in ("np", "sp"):
            model, learned = learn_processes(
                table, maze, model, kind, options, smoothing=chosen, progress=shown.tell, advance=shown.advance
            )
        path = save_model(model, output)
        shown.tell("what the rig is like, for later diagnoses")
        kept = _keep_reference(table, maze, model, output)
    if as_json:
        reference = None if kept is None else str(kept)
        print_json({"model": str(path), "reference": reference, **model_document(model), "windows": fit.windows})
        return
    report(fit, model)
    for ring, x in learned.items():
        print(
            f"ring {ring} process: {x.rows} rows, nRMSE of theta_dd on test blocks {x.before:.3f} by effects alone, "
            f"{x.after:.3f} with it"
        )
    print(f"wrote {path}")


def _keep_reference(table: Table, maze: Maze, model: RigModel, folder: Path) -> Path | None:
    """What the rig is like, beside its model, where the logs show a whole rig; else nothing, and an old one goes."""
    from mazeplan.diagnosis.bodyrecord import whole_rig
    from mazeplan.diagnosis.bodyreference import reference_of, shortened
    from mazeplan.diagnosis.referencefile import reference_path, save_reference

    if not whole_rig([table]):
        reference_path(folder).unlink(missing_ok=True)
        return None
    return save_reference(reference_of([shortened(table)], maze, model), model, folder)


def report(fit: Fit, model: RigModel) -> None:
    """What was found, with standard errors."""
    for name, axis, found in (("beta", model.stage.beta, fit.stage[0]), ("gamma", model.stage.gamma, fit.stage[1])):
        e = axis.stderr
        poles = ", ".join(f"{pole.real:.1f}{pole.imag:+.1f}j" for pole in axis.poles())
        print(
            f"stage {name:5s}  gain {axis.gain:.4f} ± {e['gain']:.4f}, {axis.natural_frequency:.1f} ± "
            f"{e['natural_frequency']:.1f} rad/s, damping {axis.damping:.2f} ± {e['damping']:.2f}, dead time "
            f"{1e3 * axis.dead_time:.1f} ± {1e3 * e['dead_time']:.1f} ms, poles {poles} rad/s, rms {found.rms:.2g} rad"
        )
        if e["natural_frequency"] > axis.natural_frequency:
            print(f"stage {name:5s}  its faster pole is faster than the record can tell: only the slower one is known")
    print(
        f"camera       {1e3 * model.camera_delay:.1f} ± {1e3 * (model.camera_delay_stderr or 0.0):.1f} ms "
        "behind the tilt sensor"
    )
    for ring, ball in sorted(model.balls.items()):
        parts = []
        for effect in ball.effects:
            for name, value in effect.values().items():
                error = ball.stderr.get(effect.name, {}).get(name)
                if error is not None:
                    unit = effect.effect.parameters[name].unit
                    parts.append(
                        f"{effect.name} {name} {value:.4f} ± {error:.4f} {unit if unit != '1' else ''}".rstrip()
                    )
        note = " (no data of its own)" if ring not in model.processes else ""
        note = f" ({fit.windows[ring]} windows)" if ring in fit.windows else note
        print(f"ring {ring}{note}  " + "; ".join(parts))
