"""`calibrate camera`: lens, place over the plate, and background."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.option_checks import number
from mazeplan.apps.cli.output import print_json, say
from mazeplan.core.errors import InputError, SettingsError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mazeplan.apps.cli.progress import ProgressBar
    from mazeplan.maze.geometry import Maze
    from mazeplan.rigs.camera.calibration import Calibration, LensCalibration
    from mazeplan.rigs.camera.markers import Markers
    from mazeplan.rigs.hardware.files import RigFile

PLATES, BOARDS = 20, 40  # frames of the empty plate and of the chessboard, from a camera or video
Boards = Annotated[
    str | None,
    Option(
        "--boards",
        metavar="PICTURES",
        help="Chessboard pictures: folder, pattern, video or device. Default: keep the lens.",
    ),
]
Plate = Annotated[
    str | None,
    Option(
        "--plate",
        metavar="PICTURES",
        help="Pictures of the level plate without a ball. Default: from the rig's camera.",
    ),
]
Corners = Annotated[str, Option("--corners", metavar="NxN", help="Inner corners of the chessboard, across x down.")]
SquareMm = Annotated[
    float, Option("--square-mm", parser=number(), metavar="MM", help="Side of a chessboard square in mm.")
]


def camera(
    rig: opt.RigFileName = "hardware",
    boards: Boards = None,
    plate: Plate = None,
    corners: Corners = "9x6",
    square_mm: SquareMm = 20.0,
    map_: opt.Map = "cme",
    dry_run: opt.DryRun = False,
    as_json: opt.AsJson = False,
) -> None:
    """Calibrate the overhead camera: lens from a chessboard, place over the plate, background of the empty plate."""
    from mazeplan.maze.mapfile import load_map
    from mazeplan.rigs.camera.section import check_begun, save_background
    from mazeplan.rigs.hardware.files import hardware_file

    counts, maze = _corners(corners), load_map(map_)
    file = hardware_file(rig)
    if not dry_run:
        file.check_writable()
    given = dict(file.settings.camera or {})
    check_begun(given, file.data)
    markers = _markers(given, maze, file)
    lens, done = _calibrate(file, given, boards, plate, (counts, square_mm / 1000.0), maze, markers)
    section, written = _section(done, markers, given, file), None
    if not dry_run:
        save_background(done.background, file.target.parent / section["background"])
        written = str(file.write({"camera": section}))
    if as_json:
        out = {key: section[key] for key in ("error_px", "error_mm", "focal_px", "shift_mm")}
        print_json({"lens_px": lens.error_px, "left_out": list(lens.left_out), **out, "rig": written})
        return
    for name in lens.left_out:
        say(f"left out {name}")
    if lens.used:
        print(f"lens          {lens.error_px:.2f} px over {lens.used} pictures of the chessboard")
    print(f"plate         {done.error_px:.2f} px or {done.error_mm:.2f} mm, by its markers")
    print(f"camera        {1000.0 * float(done.camera.centre()[2]):.0f} mm above the plate")
    print(f"written       {written or 'nothing'}")


def _calibrate(
    file: RigFile, given: dict[str, Any], boards: str | None, plate: str | None, board: tuple[tuple[int, int], float],
    maze: Maze, markers: Markers,
) -> tuple[LensCalibration, Calibration]:  # fmt: skip
    """Find lens and place of the camera. board: inner corners of the chessboard, and side of its squares, m"""
    import numpy as np

    from mazeplan.apps.cli.progress import ProgressBar
    from mazeplan.rigs.camera.calibration import calibrate_plate
    from mazeplan.rigs.camera.source import pictures

    source = plate or str(given.get("source", 0))
    pivot = np.array(given.get("pivot_mm", (0.0, 0.0, 0.0)), dtype=float) / 1000.0
    # the rig asks for this size later; a file without size and lens leaves the choice to the device
    size = file.settings.picture if {"size", "focal_px"} & given.keys() else None
    with ProgressBar("calibrating", compiles=False) as bar:
        lens = _lens(given, file) if boards is None else _lens_of(boards, size, board, bar)
        seen = list(_shown(pictures(source, PLATES, size), bar))
        bar.show("place of the camera")
        return lens, calibrate_plate(lens, seen, maze, markers, pivot)


def _lens_of(
    boards: str, size: tuple[int, int] | None, board: tuple[tuple[int, int], float], bar: ProgressBar
) -> LensCalibration:
    """The lens from pictures of the chessboard. Raises InputError that names the bad picture, or their source."""
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


def _corners(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"([0-9]{1,2})x([0-9]{1,2})", text.strip().lower())
    if found is None or not (3 <= int(found[1]) <= 30 and 3 <= int(found[2]) <= 30):
        raise InputError(f"--corners: got {text!r}, expected inner corners across x down, such as 9x6, 3 to 30 each")
    return int(found[1]), int(found[2])


def _lens(given: dict[str, Any], file: RigFile) -> LensCalibration:
    """The lens in the rig's file. Raises SettingsError without one."""
    from mazeplan.rigs.camera.calibration import LensCalibration
    from mazeplan.rigs.camera.section import camera_section

    if "focal_px" not in given:
        problem = "has no lens yet: give pictures of a chessboard with --boards"
        raise SettingsError(problem, file=file.path, key="camera")
    model = camera_section(given, file.data).model()
    return LensCalibration(model.matrix, model.distortion, model.size, 0.0, 0)


def _markers(given: dict[str, Any], maze: Maze, file: RigFile) -> Markers:
    """The markers in the rig's file; without them, those in the corners of the plate."""
    from mazeplan.rigs.camera.markers import corner_markers
    from mazeplan.rigs.camera.section import marker_section

    if given.get("markers") is None:
        return corner_markers(maze)
    return marker_section(given["markers"], file.data).markers()


def _section(done: Calibration, markers: Markers, given: dict[str, Any], file: RigFile) -> dict[str, Any]:
    """The section `camera` for the rig's file."""
    from datetime import date

    from mazeplan.rigs.camera.section import mapping
    from mazeplan.rigs.hardware.files import background_of

    return mapping(
        done.camera,
        markers,
        source=given.get("source", 0),
        ball_hue_deg=given.get("ball_hue_deg"),
        background=background_of(file.target),
        date=date.today().isoformat(),
        error_px=round(done.error_px, 3),
        error_mm=round(done.error_mm, 3),
    )
