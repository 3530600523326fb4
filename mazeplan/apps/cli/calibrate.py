"""`calibrate tilt` and `calibrate camera`."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Option

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.calibrate_camera import camera
from mazeplan.apps.cli.output import free_name, print_json, say
from mazeplan.core.errors import InputError, SettingsError

if TYPE_CHECKING:
    from mazeplan.rigs.hardware.files import RigFile
    from mazeplan.rigs.hardware.tiltcalibration import Reading, TiltFit

app = typer.Typer(help="Calibrate a real rig, and write the result into its file.", no_args_is_help=True)
LARGEST_ERROR_DEG = 0.1
Readings = Annotated[
    Path | None,
    Option("--readings", metavar="FILE", help="CSV with v0, v1, beta_deg, gamma_deg. Default: ask at the board."),
]
Grid = Annotated[int, Option("--grid", min=3, max=15, metavar="N", help="Number of tilts per axis to ask for.")]

app.command("camera")(camera)


@app.command("tilt")
def tilt(
    rig: opt.RigFileName = "hardware",
    readings: Readings = None,
    grid: Grid = 7,
    map_: opt.Map = "cme",
    dry_run: opt.DryRun = False,
    force: opt.Force = False,
    as_json: opt.AsJson = False,
) -> None:
    """Fit the tilt sensor, and with known pulses the servos, to readings of a clinometer. The map sets the tilt limit.

    Exit status 1: the error exceeds 0.1 degrees, and the rig's file stays as it is."""
    from datetime import date

    from mazeplan.maze.mapfile import load_map
    from mazeplan.rigs.hardware.files import hardware_file
    from mazeplan.rigs.hardware.tiltcalibration import fit_tilt, read_readings

    file, limit = hardware_file(rig), math.degrees(load_map(map_).tilt_limit)
    if not dry_run:
        file.check_writable()
    if readings is None:
        place = free_name(file.target.with_name(f"{file.target.stem}-readings.csv"))
        taken = _ask_at_board(file, limit, grid, place)
    else:
        place, taken = readings, read_readings(readings)
    try:
        fit = fit_tilt(taken)
    except InputError as problem:
        raise InputError(problem.problem, file=place if place.exists() else None, key=problem.key) from None
    sections = {"tilt": fit.section(date.today().isoformat())}
    servo = _servo_section(fit, file.data.get("servo"))
    if servo is not None:
        sections["servo"] = servo
    good, written = fit.error_deg <= LARGEST_ERROR_DEG, None
    try:
        written = None if dry_run or not good else str(file.write(sections))
    finally:
        _report(fit, readings, as_json, written)
    sys.exit(0 if good else 1)


def _servo_section(fit: TiltFit, given: Any) -> dict[str, Any] | None:
    """The section `servo` with the fitted level pulses and gains; None for readings without pulses."""
    servos = _servos(fit)
    if not servos:
        return None
    section = dict(given) if isinstance(given, dict) else {}
    for axis, found in servos.items():
        rounded = {"level_us": round(found["level_us"], 1), "us_per_deg": round(found["us_per_deg"], 3)}
        section[axis] = {**dict(section.get(axis) or {}), **rounded}
    return section


def _servos(fit: TiltFit) -> dict[str, dict[str, float]]:
    """{axis: fitted level pulse and gain}; empty for readings without pulses."""
    if fit.level_us is None or fit.us_per_deg is None:
        return {}
    fitted = zip(("beta", "gamma"), fit.level_us, fit.us_per_deg, strict=True)
    return {axis: {"level_us": level, "us_per_deg": gain} for axis, level, gain in fitted}


def _ask_at_board(file: RigFile, limit_deg: float, tilts: int, keep: Path) -> list[Reading]:
    """Move the plate from tilt to tilt and ask for the readings. Each answer is written to the file `keep` at once."""
    from mazeplan.rigs.files import placed
    from mazeplan.rigs.hardware.parts import open_board
    from mazeplan.rigs.hardware.tiltcalibration import write_readings
    from mazeplan.rigs.hardware.tiltreadings import grid, take_readings

    try:
        file.settings.check_limits()
    except SettingsError as problem:
        raise placed(problem, file.data) from None
    pulses = grid(file.settings.servo, limit_deg, tilts)
    board = open_board(file.settings)
    say(f"{len(pulses)} tilts; type the clinometer's beta and gamma in degrees, or nothing to skip a tilt")
    say(f"Ctrl-D ends the readings; they are kept in {keep}")

    def ask(number: int, pair: tuple[float, float]) -> tuple[float, float] | None:
        return _ask(f"{number} of {len(pulses)}: beta gamma")

    try:
        return take_readings(board, pulses, ask, lambda taken: write_readings(keep, taken))
    finally:
        board.close()


def _ask(question: str) -> tuple[float, float] | None:
    """The typed beta and gamma, degrees; None for an empty line. Raises StopReadings at Ctrl-D."""
    from mazeplan.rigs.hardware.tiltreadings import StopReadings

    while True:
        try:
            answer = typer.prompt(question, default="", show_default=False, err=True)
        except typer.Abort as end:  # typer raises it for Ctrl-D as well as for Ctrl-C
            if isinstance(end.__context__, EOFError):
                say("")
                raise StopReadings from None
            raise
        words = answer.replace(",", " ").split()
        if not words:
            return None
        try:
            beta, gamma = (float(word) for word in words)
        except ValueError:
            beta = gamma = math.nan
        if math.isfinite(beta) and math.isfinite(gamma):
            return beta, gamma
        say("expected two finite numbers, such as: -2.3 0.4")


def _report(fit: TiltFit, readings: Path | None, as_json: bool, written: str | None) -> None:
    """Print the fit. written: the rig's file, if it was written"""
    axes, servos = {"beta": fit.beta, "gamma": fit.gamma}, _servos(fit)
    if as_json:
        found = {
            axis: {"terms": f.terms, "rms_deg": f.rms, "worst_deg": f.worst, "left_out_deg": f.left_out, "used": f.used}
            for axis, f in axes.items()
        }
        out = [{"line": o.line, "axis": o.axis, "got": o.got, "expected": o.expected} for o in fit.outliers]
        document = {"readings": fit.readings, "error_deg": fit.error_deg, "tilt": found, "servo": servos or None}
        print_json({**document, "outliers": out, "rig": written})
        return
    for axis, f in axes.items():
        errors = f"rms {f.rms:.3f} deg, worst {f.worst:.3f}, at held-out readings {f.left_out:.3f}"
        print(f"{axis:6s} {errors}; terms {' '.join(f.terms)}")
    for axis, servo in servos.items():
        print(f"servo  {axis}: level at {servo['level_us']:.1f} us, {servo['us_per_deg']:.2f} us per degree")
    for slip in fit.outliers:
        at = f"reading {slip.line}" if readings is None else f"{readings}:{slip.line}"
        print(f"{at}: {slip.axis}: got {slip.got:g}, the others predict {slip.expected:.2f}: not used")
    if fit.error_deg > LARGEST_ERROR_DEG:
        wanted = f"expected at most {LARGEST_ERROR_DEG}: take more readings, over the whole range"
        say(f"error {fit.error_deg:.2f} deg, {wanted}")
        say("the rig's file stays as it is")
    if written is not None:
        say(f"wrote {'tilt and servo' if servos else 'tilt'} to {written}")
