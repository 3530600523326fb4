"""`calibrate camera`."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mazeplan.cli.output import print_json, say

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mazeplan.cli.progress import Working
    from mazeplan.rigs.camera.calibration import Calibration, Lens
    from mazeplan.rigs.camera.markers import Markers
    from mazeplan.rigs.hardware.files import RigFile

PLATES = 20  # pictures of the empty plate that are taken from a camera or video
BOARDS = 40


def camera(
    rig: Annotated[
        str, typer.Option("--rig", help="The rig's YAML file; hardware: hardware.yaml in this folder.")
    ] = "hardware",
    boards: Annotated[
        str | None,
        typer.Option(
            "--boards", help="Pictures of a chessboard: folder, pattern, video or device; default: keep the lens."
        ),
    ] = None,
    plate: Annotated[
        str | None,
        typer.Option("--plate", help="Pictures of the level plate without ball; default: the rig's own camera."),
    ] = None,
    corners: Annotated[str, typer.Option("--corners", help="Inner corners of the chessboard, across x down.")] = "9x6",
    square_mm: Annotated[float, typer.Option("--square-mm", help="Side of a square of the chessboard.")] = 20.0,
    circles: Annotated[bool, typer.Option("--circles", help="The plate has no markers: go by its walls.")] = False,
    map_: Annotated[str, typer.Option("--map", help="Packaged map or YAML file.")] = "cme",
    marker_sheet: Annotated[
        Path | None,
        typer.Option(
            "--sheet", help="Only draw the markers where they belong, to scale (.pdf; .svg, .png: a file a page)."
        ),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Calibrate and report; leave the rig's file as it is.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")] = False,
) -> None:
    """The overhead camera: lens from a chessboard, place over the plate, look of the empty floor."""
    from mazeplan.cli.arguments import positive
    from mazeplan.cli.progress import Working
    from mazeplan.errors import SettingsError
    from mazeplan.maze.mapfile import load_map
    from mazeplan.rigs.camera.calibration import calibrate_lens, calibrate_plate
    from mazeplan.rigs.camera.section import check_begun
    from mazeplan.rigs.camera.source import pictures
    from mazeplan.rigs.hardware.files import hardware_file
    from mazeplan.rigs.settings import placed

    square, counts = positive("--square-mm", square_mm), _corners(corners)
    maze = load_map(map_)
    if marker_sheet is not None:
        from mazeplan.rigs.camera.sheet import draw_sheet

        names = ", ".join(str(name) for name in draw_sheet(maze, marker_sheet))
        say(f"wrote {names}; print at 100 %: the ruler below must be 100 mm long")
        return
    file = hardware_file(rig)
    given = dict(file.settings.camera or {})
    try:
        check_begun(given)
    except SettingsError as problem:
        raise placed(problem, file.data) from None
    source = plate or str(given.get("source", 0))
    markers = None if circles else _markers(given, maze, file)
    with Working("calibrating", compiles=False) as shown:
        if boards is None:
            lens = _lens(given, file)
        else:
            lens = calibrate_lens(_shown(pictures(boards, BOARDS), shown), counts, square / 1000.0)
        seen = list(_shown(pictures(source, PLATES), shown))
        shown.tell("the place of the camera")
        done = calibrate_plate(lens, seen, maze, markers, _pivot(given))
    section = _section(done, markers, given, file)
    written = None
    if not dry_run:
        from mazeplan.rigs.camera.section import save_background

        save_background(done.background, file.target.parent / section["background"])
        written = str(file.write({"camera": section}))
    if as_json:
        out = {key: section[key] for key in ("error_px", "error_mm", "focal_px", "shift_mm")}
        print_json({"lens_px": lens.error_px, "left_out": list(lens.left_out), "by": done.by, **out, "rig": written})
    else:
        _report(lens, done, written)


def _shown(found: Iterator[Any], shown: Working) -> Iterator[Any]:
    """Pictures as they come, each told by its name; then that the lens is worked out."""
    for name, image in found:
        shown.tell(Path(name).name)
        yield name, image
    shown.tell("what the pictures have in common")


def _report(lens: Lens, done: Calibration, written: str | None) -> None:
    for name in lens.left_out:
        say(f"left out {name}")
    if lens.used:
        print(f"lens          {lens.error_px:.2f} px over {lens.used} pictures of the chessboard")
    print(f"plate         {done.error_px:.2f} px or {done.error_mm:.2f} mm, by {done.by}")
    print(f"camera        {1000.0 * float(done.camera.centre()[2]):.0f} mm above the plate")
    print(f"written       {written or 'nothing'}")


def _corners(text: str) -> tuple[int, int]:
    from mazeplan.errors import InputError

    found = re.fullmatch(r"([0-9]{1,2})x([0-9]{1,2})", text.strip().lower())
    if found is None or not (3 <= int(found[1]) <= 30 and 3 <= int(found[2]) <= 30):
        raise InputError(f"--corners: got {text!r}, expected inner corners across x down, such as 9x6, 3 to 30 each")
    return int(found[1]), int(found[2])


def _lens(given: dict[str, Any], file: RigFile) -> Lens:
    """The lens that the rig's file knows. Raises InputError when it knows none."""
    from mazeplan.errors import SettingsError
    from mazeplan.rigs.camera.calibration import Lens
    from mazeplan.rigs.camera.section import camera_section

    if "focal_px" not in given:
        raise SettingsError("no lens there yet: give pictures of a chessboard, --boards", file=file.path, key="camera")
    model = camera_section(given, file=file.path).model()
    return Lens(model.matrix, model.distortion, model.size, 0.0, 0)


def _markers(given: dict[str, Any], maze: Any, file: RigFile) -> Markers:
    """Where the rig's file says that markers are, else where `--sheet` draws them."""
    from mazeplan.rigs.camera.markers import corner_markers
    from mazeplan.rigs.camera.section import marker_section

    if given.get("markers") is None:
        return corner_markers(maze)
    return marker_section(given["markers"], file=file.path).markers()


def _pivot(given: dict[str, Any]) -> Any:
    import numpy as np

    return np.array(given.get("pivot_mm", (0.0, 0.0, 0.0)), dtype=float) / 1000.0


def _section(done: Calibration, markers: Markers | None, given: dict[str, Any], file: RigFile) -> dict[str, Any]:
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
