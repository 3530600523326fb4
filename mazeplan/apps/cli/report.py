"""`report`: runs, evaluations, models and diagnoses as figures in one HTML file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from mazeplan.apps.cli.options import Force, file, new_file
from mazeplan.apps.cli.output import say
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


def report(inputs: Inputs, output: Page, title: Title = None, force: Force = False) -> None:
    """Draw runs, evaluations, models and diagnoses into one HTML file without external content."""
    from mazeplan.apps.cli.progress import ProgressBar
    from mazeplan.apps.report.inputs import read_input
    from mazeplan.apps.report.write import write_inputs

    with ProgressBar("drawing", compiles=False) as bar:
        write_inputs([part for path in inputs for part in read_input(path)], output, title, bar.show)
    say(f"wrote {output}")


def write_report(kind: str, document: dict[str, Any], path: Path, name: str) -> None:
    """Write the page of a command's document.

    kind: kind of input, as in `report.inputs`
    name: name of what the page is about"""
    from mazeplan.apps.report.inputs import Input
    from mazeplan.apps.report.write import write_inputs

    write_inputs([Input(kind, path, name, finite(document))], path)
    say(f"wrote {path}")
