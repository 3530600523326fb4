"""`report`: what happened, as pictures in one HTML file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mazeplan.cli.arguments import check_folder
from mazeplan.cli.output import say
from mazeplan.errors import InputError

if TYPE_CHECKING:
    from mazeplan.report.inputs import Input
    from mazeplan.report.page import Section


def report(
    inputs: Annotated[
        list[Path],
        typer.Argument(
            metavar="INPUT...",
            help="Run logs; what evaluate, compare, diagnose or improve printed with --json; folders of diagnose -o; "
            "folders of models, with the logs and tables on which they are judged.",
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="HTML file to write.")],
    pictures: Annotated[
        Path | None, typer.Option("--pictures", help="Folder for each picture as PNG and SVG, too.")
    ] = None,
    title: Annotated[str | None, typer.Option("--title", help="Of the page; default: what it shows.")] = None,
) -> None:
    """Pictures of runs, evaluations (several are compared), models and diagnoses: one HTML file that loads nothing."""
    from mazeplan.cli.progress import Working
    from mazeplan.report.inputs import read_input
    from mazeplan.report.page import write_page

    check_page("-o", output)
    if pictures is not None:
        check_folder("--pictures", pictures)
    with Working("drawing", compiles=False) as shown:
        found = _sections([part for path in inputs for part in read_input(path)], shown.tell)
        write_page(output, title or found[0].title + (" and more" if len(found) > 1 else ""), found, pictures)
    say(f"wrote {output}" + (f", pictures in {pictures}" if pictures is not None else ""))


def check_page(option: str, path: Path) -> None:
    """Whether a page could be written there, before long work is lost for want of it. Raises InputError."""
    if path.suffix.lower() not in (".html", ".htm") or path.is_dir():
        folder = ", a folder" if path.is_dir() else ""
        raise InputError(f"{option}: got {str(path)!r}{folder}, expected a file that ends in .html")
    check_folder(option, path.absolute().parent)


def write_report(kind: str, document: dict[str, Any], path: Path, name: str) -> None:
    """The page of a document that a command is about to print; kind: as `report.inputs` has it; name: of what."""
    from mazeplan.cli.output import finite
    from mazeplan.report.inputs import Input
    from mazeplan.report.page import write_page

    sections = _sections([Input(kind, path, name, finite(document))])
    write_page(path, sections[0].title, sections)
    say(f"wrote {path}")


def _sections(given: list[Input], tell: Callable[[str], None] = lambda text: None) -> list[Section]:
    """In the order of the inputs, but evaluations together, where the first of them is. Where there is a model, logs
    and tables are what it is judged on. tell: gets the name of each before it is drawn."""
    from mazeplan.data.runlog import read_log
    from mazeplan.report.diagnosis import diagnosis_section
    from mazeplan.report.evaluation import evaluation_section
    from mazeplan.report.models import model_section, models_section
    from mazeplan.report.run import run_section

    judges = [part.path for part in given if part.kind in ("run", "table")]
    models = [part for part in given if part.kind == "model"]
    table = next((part for part in given if part.kind == "table"), None)
    if table is not None and not models:
        raise InputError("got a table, expected the folder of a model beside it, to be judged on it", file=table.path)
    together = [part for part in given if part.kind == "evaluation"]
    found = []
    for part in given:
        tell(part.path.name)
        if part.kind == "model":
            found.append(model_section(part.path, judges))
        elif part.kind in ("run", "table") and models:
            continue
        elif part.kind == "run":
            log = read_log(part.path)
            if "excitation" in log.header:
                told = "got a log of `collect`, expected one of `navigate --log`"
                raise InputError(f"{told}, or the folder of a model beside it, to be judged on it", file=part.path)
            found.append(run_section(log))
        elif part.kind == "comparison":
            found.append(models_section(part))
        elif part.kind == "diagnosis":
            found.append(diagnosis_section(part))
        elif part is together[0]:
            found.append(evaluation_section(together))
    return found
