"""`report`: runs, evaluations, models and diagnoses as figures in one HTML file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from mazeplan.apps.cli.options import Force, Video, file, new_file
from mazeplan.apps.cli.output import say
from mazeplan.core.errors import InputError
from mazeplan.core.results import finite

Inputs = Annotated[
    list[Path],
    Argument(
        metavar="INPUT",
        help="Run logs; JSON documents of evaluate, compare, diagnose or improve; folders of diagnose -o.",
    ),
]
Page = Annotated[
    Path,
    Option(
        "-o", "--output", parser=file(".html", ".htm"), callback=new_file, metavar="FILE", help="HTML file to write."
    ),
]
Title = Annotated[str | None, Option("--title", metavar="TEXT", help="Title of the page. Default: its content.")]


def report(inputs: Inputs, output: Page, video: Video = None, title: Title = None, force: Force = False) -> None:
    """Draw runs, evaluations, models and diagnoses into one HTML file without external content."""
    from mazeplan.apps.cli.progress import ProgressBar
    from mazeplan.apps.report.inputs import read_input
    from mazeplan.apps.report.write import write_inputs
    from mazeplan.apps.view.film import write_film
    from mazeplan.core.logs.run_log_reader import read_messages

    if video is not None:
        _check_film(inputs, video)
    with ProgressBar("drawing", compiles=False) as bar:
        write_inputs([part for path in inputs for part in read_input(path)], output, title, bar.show)
        if video is not None:
            bar.show(video.name)
            write_film(read_messages(inputs[0])[1], video)
    film = f", film {video}" if video is not None else ""
    say(f"wrote {output}{film}")


def _check_film(inputs: list[Path], video: Path) -> None:
    """Raises InputError unless the input is one run log and a film can have this name."""
    if len(inputs) != 1 or inputs[0].suffix != ".mcap":
        raise InputError(f"--video: got {len(inputs)} inputs, expected one run log (.mcap)")
    from mazeplan.apps.view.film import check_film

    check_film(video)


def write_report(kind: str, document: dict[str, Any], path: Path, name: str) -> None:
    """Write the page of a command's document.

    kind: kind of input, as in `report.inputs`
    name: name of what the page is about"""
    from mazeplan.apps.report.inputs import Input
    from mazeplan.apps.report.write import write_inputs

    write_inputs([Input(kind, path, name, finite(document))], path)
    say(f"wrote {path}")
