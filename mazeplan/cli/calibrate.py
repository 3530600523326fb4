"""`calibrate tilt`, `calibrate camera`."""

from __future__ import annotations

import math
import sys
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mazeplan.cli.arguments import check_folder
from mazeplan.cli.calibrate_camera import camera
from mazeplan.cli.output import print_json, say
from mazeplan.errors import SettingsError

if TYPE_CHECKING:
    from mazeplan.rigs.hardware.files import RigFile
    from mazeplan.rigs.hardware.tiltcalibration import Reading, TiltFit

app = typer.Typer(help="Calibrate a rig on a table; what was found goes into its file.", no_args_is_help=True)
RigFileName = Annotated[str, typer.Option("--rig", help="The rig's YAML file; hardware: hardware.yaml in this folder.")]
WANTED_DEG = 0.1

app.command("camera")(camera)


@app.command("tilt")
def tilt(
    rig: RigFileName = "hardware",
    readings: Annotated[
        Path | None,
        typer.Option("--readings", help="CSV with v0, v1, beta_deg, gamma_deg; default: ask at the board."),
    ] = None,
    keep: Annotated[
        Path | None,
        typer.Option(
            "--keep", help="File (CSV) that gets the readings that were asked for; default: a new one beside the rig's."
        ),
    ] = None,
    grid: Annotated[int, typer.Option("--grid", min=3, max=15, help="Tilts per axis that are asked for.")] = 7,
    map_: Annotated[str, typer.Option("--map", help="Packaged map or YAML file: for the tilt limit.")] = "cme",
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Fit and report; leave the rig's file as it is.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")] = False,
) -> None:
    """The tilt sensor, and where pulses are known the servos, from what a clinometer says.

    Exit status 1: fitted, but worse than 0.1 degrees; the rig's file stays as it is."""
    from mazeplan.errors import InputError
    from mazeplan.maze.mapfile import load_map
    from mazeplan.rigs.hardware.files import hardware_file
    from mazeplan.rigs.hardware.tiltcalibration import fit_tilt, read_readings, write_readings

    file, limit = hardware_file(rig), math.degrees(load_map(map_).tilt_limit)
    if keep is not None:
        check_folder("--keep", keep.absolute().parent)
        write_readings(keep, [])  # before anything is asked
    place = readings
    if readings is not None:
        taken = read_readings(readings)
        if keep is not None:
            write_readings(keep, taken)
    else:
        place = keep or _unused(file.target.with_name(f"{file.target.stem}-readings.csv"))
        taken = _ask_at_board(file, limit, grid, place)
    try:
        fit = fit_tilt(taken)
    except InputError as problem:
        there = place if place is not None and place.exists() else None
        raise InputError(problem.problem, file=there, key=problem.key) from None
    sections = {"tilt": fit.section(today())}
    servo = _servo(fit, file.data.get("servo"))
    if servo is not None:
        sections["servo"] = servo
    good = fit.error_deg <= WANTED_DEG
    try:
        written = None if dry_run or not good else file.write(sections)
    except SettingsError as problem:
        _report(fit, str(readings or "reading"), as_json, None)
        raise problem
    _report(fit, str(readings or "reading"), as_json, None if written is None else str(written))
    sys.exit(0 if good else 1)


def today() -> str:
    """The date, as files have it."""
    from datetime import date

    return date.today().isoformat()


def _servo(fit: TiltFit, given: Any) -> dict[str, Any] | None:
    """`servo:` with the level pulses and gains that were found, and its limits as they were."""
    if fit.level_us is None or fit.us_per_deg is None:
        return None
    old = dict(given) if isinstance(given, dict) else {}
    for axis, level, gain in zip(("beta", "gamma"), fit.level_us, fit.us_per_deg, strict=True):
        old[axis] = {**dict(old.get(axis) or {}), "level_us": round(level, 1), "us_per_deg": round(gain, 3)}
    return old


def _unused(path: Path) -> Path:
    """This file, or one numbered like it that is not there yet: what was typed once is not written over."""
    names = chain([path], (path.with_stem(f"{path.stem}-{number}") for number in count(2)))
    return next(name for name in names if not name.exists())


def _ask_at_board(file: RigFile, limit_deg: float, tilts: int, keep: Path) -> list[Reading]:
    """Move the plate from tilt to tilt, and ask; what is said is kept at once. Ctrl-D ends the asking."""
    from mazeplan.rigs.hardware.parts import open_board
    from mazeplan.rigs.hardware.tiltcalibration import write_readings
    from mazeplan.rigs.hardware.tiltreadings import Enough, grid, take_readings
    from mazeplan.rigs.settings import placed

    try:
        file.settings.check_limits()
    except SettingsError as problem:
        raise placed(problem, file.data) from None
    pulses = grid(file.settings.servo, limit_deg, tilts)
    board = open_board(file.settings)
    say(f"{len(pulses)} tilts; type what the clinometer says as: beta gamma, in degrees; empty: leave this one out")
    say(f"Ctrl-D: no more of them; what is typed is kept in {keep}")

    def ask(number: int, pair: tuple[float, float]) -> tuple[float, float] | None:
        while True:
            try:
                answer = typer.prompt(
                    f"{number} of {len(pulses)}: beta gamma", default="", show_default=False, err=True
                )
            except typer.Abort as ended:  # of Ctrl-D as of Ctrl-C
                if isinstance(ended.__context__, EOFError):
                    say("")
                    raise Enough from None
                raise
            words = answer.replace(",", " ").split()
            if not words:
                return None
            try:
                beta, gamma = (float(word) for word in words)
            except ValueError:
                say("expected two numbers, such as: -2.3 0.4")
                continue
            if math.isfinite(beta) and math.isfinite(gamma):
                return beta, gamma
            say("expected two finite numbers")

    try:
        return take_readings(board, pulses, ask, lambda taken: write_readings(keep, taken))
    finally:
        board.close()


def _report(fit: TiltFit, place: str, as_json: bool, written: str | None) -> None:
    """What was found, for people or programs."""
    axes = {"beta": fit.beta, "gamma": fit.gamma}
    servos = {}
    if fit.level_us is not None and fit.us_per_deg is not None:
        servos = {
            axis: {"level_us": level, "us_per_deg": gain}
            for axis, level, gain in zip(axes, fit.level_us, fit.us_per_deg, strict=True)
        }
    if as_json:
        found = {
            axis: {"terms": f.terms, "rms_deg": f.rms, "worst_deg": f.worst, "left_out_deg": f.left_out, "used": f.used}
            for axis, f in axes.items()
        }
        out = [{"line": o.line, "axis": o.axis, "got": o.got, "expected": o.expected} for o in fit.outliers]
        print_json(
            {
                "readings": fit.readings, "error_deg": fit.error_deg, "tilt": found, "servo": servos or None,
                "outliers": out, "rig": written,
            }
        )  # fmt: skip
        return
    for axis, found in axes.items():
        print(
            f"{axis:6s} rms {found.rms:.3f} deg, worst {found.worst:.3f}, at a reading left out {found.left_out:.3f}; "
            f"terms {' '.join(found.terms)}"
        )
    for axis, servo in servos.items():
        print(f"servo  {axis}: level at {servo['level_us']:.1f} us, {servo['us_per_deg']:.2f} us per degree")
    for slip in fit.outliers:
        at = f"{place}:{slip.line}" if place != "reading" else f"reading {slip.line}"
        print(f"{at}: {slip.axis}: got {slip.got:g}, the others say {slip.expected:.2f}: it took no part")
    if fit.error_deg > WANTED_DEG:
        say(f"error {fit.error_deg:.2f} deg, expected at most {WANTED_DEG}: take more readings, over the whole range")
        say("the rig's file stays as it is")
    if written is not None:
        say(f"wrote {'tilt and servo' if servos else 'tilt'} to {written}")
