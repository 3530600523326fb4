"""`learn`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mazeplan.cli.output import print_json
from mazeplan.errors import InputError, TableError

if TYPE_CHECKING:
    from mazeplan.models.identification import Fit

KINDS = ("p", "pi", "np", "sp")


def learn(
    logs: Annotated[list[Path], typer.Argument(help="Run logs (MCAP) or tables (CSV).")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder of the model.")],
    kind: Annotated[str, typer.Option("--kind", help="p: nominal ball, stage fitted; pi: ball fitted too.")] = "pi",
    map_: Annotated[str, typer.Option("--map", help="Packaged map or YAML file.")] = "cme",
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")] = False,
) -> None:
    """Fit the model of a rig, stage and ball, to logs of it."""
    from dataclasses import replace

    from mazeplan.data.table import join, read_table
    from mazeplan.maze.mapfile import load_map
    from mazeplan.models.identification import fit_rig
    from mazeplan.models.modelfile import RigModel, model_document, save_model

    if kind not in KINDS:
        raise InputError(f"--kind: got {kind!r}, expected one of {', '.join(KINDS)}")
    if kind in ("np", "sp"):
        raise InputError(f"--kind: {kind} (Gaussian process) is not available in this version, expected p or pi")
    maze = load_map(map_)
    tables = [read_table(log) for log in logs]
    try:
        fit = fit_rig(join(tables), maze, tuple(table.source for table in tables))
    except ValueError as problem:
        raise TableError(str(problem), file=", ".join(str(log) for log in logs)) from None
    model = fit.model
    if kind == "p":
        scores = {name: value for name, value in model.scores.items() if name == "stage_arx"}
        model = replace(model, kind="p", balls=RigModel.nominal(maze).balls, scores=scores)
    path = save_model(model, output)
    if as_json:
        print_json({"model": str(path), **model_document(model), "windows": fit.windows})
    else:
        report(fit, path)


def report(fit: Fit, path: Path) -> None:
    """What was found, with standard errors."""
    model = fit.model
    for name, axis, found in (("beta", model.stage.beta, fit.stage[0]), ("gamma", model.stage.gamma, fit.stage[1])):
        e = axis.stderr
        poles = ", ".join(f"{pole.real:.1f}{pole.imag:+.1f}j" for pole in axis.poles())
        print(
            f"stage {name:5s}  gain {axis.gain:.4f} ± {e['gain']:.4f}, {axis.natural_frequency:.1f} ± "
            f"{e['natural_frequency']:.1f} rad/s, damping {axis.damping:.2f} ± {e['damping']:.2f}, dead time "
            f"{1e3 * axis.dead_time:.1f} ± {1e3 * e['dead_time']:.1f} ms, poles {poles} rad/s, rms {found.rms:.2g} rad"
        )
    for line in fit.arx.lines() if fit.arx is not None else ("ARX          the log is too short for it",):
        print(line)
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
                    unit = effect.parameters[name].unit
                    parts.append(
                        f"{effect.name} {name} {value:.4f} ± {error:.4f} {unit if unit != '1' else ''}".rstrip()
                    )
        note = f" ({fit.windows[ring]} windows)" if ring in fit.windows else " (no data of its own)"
        print(f"ring {ring}{note}  " + "; ".join(parts))
    print(f"wrote {path}")
