"""Options of `calibrate tilt` and `calibrate camera`, in the same form as in `options`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Option

from mazeplan.apps.cli.option_checks import file, new_file, number

Readings = Annotated[
    Path | None,
    Option("--readings", metavar="FILE", help="CSV with v0, v1, beta_deg, gamma_deg. Default: ask at the board."),
]
Keep = Annotated[
    Path | None,
    Option(
        "--keep",
        parser=file(".csv"),
        callback=new_file,
        metavar="FILE",
        help="CSV for the typed readings. Default: a new one.",
    ),
]
Grid = Annotated[int, Option("--grid", min=3, max=15, metavar="N", help="Number of tilts per axis to ask for.")]
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
Sheet = Annotated[
    Path | None,
    Option(
        "--sheet",
        parser=file(".pdf", ".svg", ".png", chosen=True),
        callback=new_file,
        metavar="FILE",
        help="Only draw the markers to scale (PDF; SVG or PNG: one file per page).",
    ),
]
