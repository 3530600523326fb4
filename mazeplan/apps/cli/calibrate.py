"""`calibrate tilt` and `calibrate camera`: tilt sensor and servos; lens, place over the plate, and background."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterator
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import free_name, say
from mazeplan.apps.cli.progress import ProgressBar
from mazeplan.core.errors import InputError, SettingsError

if TYPE_CHECKING:
    from mazeplan.rigs.camera.calibration import LensCalibration
    from mazeplan.rigs.hardware.settings import RigFile
    from mazeplan.rigs.hardware.tiltcalibration import Reading, TiltFit

PLATES, BOARDS = 20, 40  # frames of the empty plate and of the chessboard, from a camera or video
LARGEST_ERROR_DEG = 0.1


def _corners(text: str) -> tuple[int, int]:
    """Parser of the inner corners of a chessboard, such as 9x6."""
    found = re.fullmatch(r"([0-9]{1,2})x([0-9]{1,2})", text.strip().lower())
    if found is None or not (3 <= int(found[1]) <= 30 and 3 <= int(found[2]) <= 30):
        raise typer.BadParameter(f"got {text!r}, expected inner corners across x down, such as 9x6, 3 to 30 each")
    return int(found[1]), int(found[2])


app = typer.Typer(help="Calibrate a real rig, and write the result into its file.", no_args_is_help=True)
RigFileName = Annotated[str, opt.value("--rig", "RIG", "YAML file of the rig; `hardware` means ./hardware.yaml.")]
Boards = Annotated[
    str | None,
    opt.value("--boards", "PICTURES", "Chessboard: folder, pattern, video or device. Default: keep the lens."),
]
Plate = Annotated[
    str | None, opt.value("--plate", "PICTURES", "Level plate without a ball. Default: pictures of the rig's camera.")
]
Corners = Annotated[
    Any, opt.value("--corners", "NxN", "Inner corners of the chessboard, across x down.", parser=_corners)
]
SquareMm = Annotated[
    float, opt.value("--square-mm", "MM", "Side of a chessboard square in mm.", parser=opt.number(0.1, 1e3))
]
Readings = Annotated[
    Path | None, opt.value("--readings", "FILE", "CSV with v0, v1, beta_deg, gamma_deg. Default: ask at the board.")
]
Grid = Annotated[int, opt.value("--grid", "N", "Number of tilts per axis to ask for.", min=3, max=15)]


@app.command("camera")
def camera(
    rig: RigFileName = "hardware",
    boards: Boards = None,
    plate: Plate = None,
    corners: Corners = "9x6",
    square_mm: SquareMm = 20.0,
    map_: opt.Map = "cme",
) -> None:
    """Calibrate the overhead camera: lens from a chessboard, place over the plate, background of the empty plate."""
    import numpy as np

    from mazeplan.maze.mapfile import load_map
    from mazeplan.rigs.camera.calibration import calibrate_plate
    from mazeplan.rigs.camera.pinhole import corner_markers
    from mazeplan.rigs.camera.source import pictures
    from mazeplan.rigs.hardware.settings import hardware_file, mapping

    maze, file = load_map(map_), hardware_file(rig)
    given = file.settings.camera
    markers = corner_markers(maze) if given.markers is None else given.markers.markers()
    # the rig asks for this size later; a file without size and lens leaves the choice to the device
    size = given.size if {"size", "focal_px"} & given.model_fields_set else None
    with ProgressBar("calibrating", compiles=False) as bar:
        lens = _lens(file) if boards is None else _lens_of(boards, size, (corners, square_mm / 1000.0), bar)
        seen = list(_shown(pictures(plate or str(given.source), PLATES, size), bar))
        bar.show("place of the camera")
        done = calibrate_plate(lens, seen, maze, markers, np.array(given.pivot_mm) / 1000.0)
    section = mapping(
        done.camera, markers, source=given.source, background=f"{file.target.stem}-background.png",
        date=date.today().isoformat(), error_px=round(done.error_px, 3), error_mm=round(done.error_mm, 3),
    )  # fmt: skip
    done.background.write(file.target.parent / section["background"])
    written = str(file.write({"camera": section}))
    for name in lens.left_out:
        say(f"left out {name}")
    if lens.used:
        print(f"lens          {lens.error_px:.2f} px over {lens.used} pictures of the chessboard")
    print(f"plate         {done.error_px:.2f} px or {done.error_mm:.2f} mm, by its markers")
    print(f"camera        {1000.0 * float(done.camera.centre()[2]):.0f} mm above the plate")
    print(f"written       {written}")


def _lens(file: RigFile) -> LensCalibration:
    """The lens in the rig's file. Raises SettingsError without one."""
    from mazeplan.rigs.camera.calibration import LensCalibration

    if not file.settings.camera.calibrated:
        problem = "has no lens yet: give pictures of a chessboard with --boards"
        raise SettingsError(problem, file=file.path, key="camera")
    model = file.settings.camera.model()
    return LensCalibration(model.matrix, model.distortion, model.size, 0.0, 0)


def _lens_of(
    boards: str, size: tuple[int, int] | None, board: tuple[tuple[int, int], float], bar: ProgressBar
) -> LensCalibration:
    """The lens from pictures of the chessboard. Raises InputError that names the bad picture, or their source.

    board: inner corners of the chessboard, and side of its squares, m"""
    from mazeplan.rigs.camera.calibration import calibrate_lens
    from mazeplan.rigs.camera.source import pictures

    try:
        return calibrate_lens(_shown(pictures(boards, BOARDS, size), bar), *board)
    except InputError as problem:
        raise problem if problem.file is not None else InputError(problem.problem, file=boards) from None


def _shown(found: Iterator[Any], bar: ProgressBar) -> Iterator[Any]:
    """Yield the pictures, and show their names in the bar."""
    for name, image in found:
        bar.show(Path(name).name)
        yield name, image
    bar.show("fitting all pictures")


@app.command("tilt")
def tilt(
    rig: RigFileName = "hardware",
    readings: Readings = None,
    grid: Grid = 7,
    map_: opt.Map = "cme",
) -> None:
    """Fit the tilt sensor, and with known pulses the servos, to readings of a clinometer. The map sets the tilt limit.

    Exit status 1: the error exceeds 0.1 degrees, and the rig's file stays as it is."""
    from mazeplan.maze.mapfile import load_map
    from mazeplan.rigs.hardware.settings import hardware_file
    from mazeplan.rigs.hardware.tiltcalibration import fit_tilt, read_readings

    file, limit = hardware_file(rig), math.degrees(load_map(map_).tilt_limit)
    if readings is None:
        place = free_name(file.target.with_name(f"{file.target.stem}-readings.csv"))
        taken = _ask_at_board(file, limit, grid, place)
    else:
        place, taken = readings, read_readings(readings)
    try:
        fit = fit_tilt(taken)
    except InputError as problem:
        raise InputError(problem.problem, file=place if place.exists() else None, key=problem.key) from None
    good, written = fit.sensor.error_deg <= LARGEST_ERROR_DEG, None
    try:
        written = str(file.write(_tilt_sections(fit, file.data.get("servo")))) if good else None
    finally:
        _report(fit, readings, written)
    sys.exit(0 if good else 1)


def _tilt_sections(fit: TiltFit, given: Any) -> dict[str, Any]:
    """The sections `tilt`, and `servo` with the fitted level pulses and gains. given: the section `servo` so far"""
    sections: dict[str, Any] = {"tilt": {**fit.sensor.model_dump(mode="json"), "date": date.today().isoformat()}}
    servo = dict(given) if isinstance(given, dict) else {}
    for axis, found in fit.servos.items():
        rounded = {"level_us": round(found["level_us"], 1), "us_per_deg": round(found["us_per_deg"], 3)}
        servo[axis] = {**dict(servo.get(axis) or {}), **rounded}
    return {**sections, "servo": servo} if fit.servos else sections


def _ask_at_board(file: RigFile, limit_deg: float, tilts: int, keep: Path) -> list[Reading]:
    """Move the plate from tilt to tilt and ask for the readings. Each answer is written to the file `keep` at once."""
    from mazeplan.rigs.hardware.tiltcalibration import grid, take_readings, write_readings
    from mazeplan.rigs.link.board import open_board

    file.settings.check_limits(file.data)
    pulses = grid(file.settings.servo, limit_deg, tilts)
    board = open_board(file.settings.port, file.settings.servo.limits())
    say(f"{len(pulses)} tilts; type the clinometer's beta and gamma in degrees, or nothing to skip a tilt")
    say(f"Ctrl-D ends the readings; they are kept in {keep}")

    def ask(number: int, pair: tuple[float, float]) -> tuple[float, float] | None:
        return _ask(f"{number} of {len(pulses)}: beta gamma")

    try:
        return take_readings(board, pulses, ask, lambda taken: write_readings(keep, taken))
    finally:
        board.close()


def _ask(question: str) -> tuple[float, float] | None:
    """The typed beta and gamma, degrees; None for an empty line. Raises EOFError at Ctrl-D."""
    while True:
        try:
            answer = typer.prompt(question, default="", show_default=False, err=True)
        except typer.Abort as end:  # typer raises it for Ctrl-D as well as for Ctrl-C
            if isinstance(end.__context__, EOFError):
                say("")
                raise EOFError from None
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


def _report(fit: TiltFit, readings: Path | None, written: str | None) -> None:
    """Print the fit. written: the rig's file, if it was written"""
    axes, servos = {"beta": fit.beta, "gamma": fit.gamma}, fit.servos
    for axis, f in axes.items():
        errors = f"rms {f.rms_deg:.3f} deg, worst {f.worst_deg:.3f}, at held-out readings {f.left_out_deg:.3f}"
        print(f"{axis:6s} {errors}; terms {' '.join(f.terms)}")
    for axis, servo in servos.items():
        print(f"servo  {axis}: level at {servo['level_us']:.1f} us, {servo['us_per_deg']:.2f} us per degree")
    for slip in fit.outliers:
        at = f"reading {slip.line}" if readings is None else f"{readings}:{slip.line}"
        print(f"{at}: {slip.axis}: got {slip.got:g}, the others predict {slip.expected:.2f}: not used")
    if fit.sensor.error_deg > LARGEST_ERROR_DEG:
        wanted = f"expected at most {LARGEST_ERROR_DEG}: take more readings, over the whole range"
        say(f"error {fit.sensor.error_deg:.2f} deg, {wanted}")
        say("the rig's file stays as it is")
    if written is not None:
        say(f"wrote {'tilt and servo' if servos else 'tilt'} to {written}")
