"""`report`: runs, evaluations, models and diagnoses as figures in one HTML file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from mazeplan.apps.cli.options import Force, Video, file, folder, new_file, new_folder
from mazeplan.apps.cli.output import finite, say
from mazeplan.core.errors import InputError

if TYPE_CHECKING:
    from mazeplan.apps.report.inputs import Input
    from mazeplan.apps.report.page import PageSection
    from mazeplan.maze.geometry import Maze

Inputs = Annotated[
    list[Path],
    Argument(
        metavar="INPUT",
        help="Run logs; JSON documents of evaluate, compare, diagnose or improve; folders of diagnose -o; folders of "
        "models with the logs and tables to score them on.",
    ),
]
Page = Annotated[
    Path,
    Option(
        "-o", "--output", parser=file(".html", ".htm"), callback=new_file, metavar="FILE", help="HTML file to write."
    ),
]
Pictures = Annotated[
    Path | None,
    Option(
        "--pictures",
        parser=folder,
        callback=new_folder,
        metavar="FOLDER",
        help="Also write each figure as PNG and SVG.",
    ),
]
Title = Annotated[str | None, Option("--title", metavar="TEXT", help="Title of the page. Default: its content.")]


def report(
    inputs: Inputs,
    output: Page,
    pictures: Pictures = None,
    video: Video = None,
    title: Title = None,
    force: Force = False,
) -> None:
    """Draw runs, evaluations, models and diagnoses into one HTML file without external content."""
    from mazeplan.apps.cli.progress import ProgressBar
    from mazeplan.apps.report.inputs import read_input
    from mazeplan.apps.report.page import write_page
    from mazeplan.apps.view.film import write_film
    from mazeplan.core.logs.run_log_reader import read_messages

    if video is not None:
        _check_film(inputs, video)
    with ProgressBar("drawing", compiles=False) as bar:
        sections = _sections([part for path in inputs for part in read_input(path)], bar.show)
        write_page(output, title or sections[0].title + " and more" * (len(sections) > 1), sections, pictures)
        if video is not None:
            bar.show(video.name)
            write_film(read_messages(inputs[0])[1], video)
    film = f", film {video}" if video is not None else ""
    say(f"wrote {output}" + (f", pictures in {pictures}" if pictures is not None else "") + film)


def _check_film(inputs: list[Path], video: Path) -> None:
    """Raises InputError unless the input is one run log and a film can have this name."""
    if len(inputs) != 1 or inputs[0].suffix != ".mcap":
        raise InputError(f"--video: got {len(inputs)} inputs, expected one run log (.mcap)")
    from mazeplan.apps.view.film import check_film

    check_film(video)


def write_report(kind: str, document: dict[str, Any], path: Path, name: str, maze: Maze | None = None) -> None:
    """Write the page of a command's document.

    kind: kind of input, as in `report.inputs`
    name: name of what the page is about
    maze: the maze of a comparison"""
    from mazeplan.apps.report.inputs import Input
    from mazeplan.apps.report.page import write_page

    sections = _sections([Input(kind, path, name, finite(document), maze=maze)])
    write_page(path, sections[0].title, sections)
    say(f"wrote {path}")


def _sections(given: list[Input], show: Callable[[str], None] = lambda text: None) -> list[PageSection]:
    """One section for each input; all evaluations share one section. Raises InputError.

    show: gets the name of each input before it is drawn

    If an input is the folder of a model, logs and tables are the data to score the model on."""
    from mazeplan.apps.report.diagnosis import diagnosis_section
    from mazeplan.apps.report.evaluation import evaluation_section
    from mazeplan.apps.report.models import model_section, models_section
    from mazeplan.apps.report.run import run_section
    from mazeplan.core.logs.run_log import read_log
    from mazeplan.core.logs.table import check_there

    data = [part.path for part in given if part.kind in ("run", "table")]
    models = any(part.kind == "model" for part in given)
    evaluations = [part for part in given if part.kind == "evaluation"]
    sections = []
    for part in given:
        show(part.path.name)
        if part.kind == "model":
            sections.append(model_section(part.path, data))
        elif part.kind in ("run", "table") and models:
            continue
        elif part.kind == "table":
            check_there(part.path)
            raise InputError("got a table, expected the folder of a model to score on it as well", file=part.path)
        elif part.kind == "run":
            log = read_log(part.path)
            if "excitation" in log.header:
                problem = "got a log of `collect`, expected one of `navigate --log`"
                raise InputError(f"{problem}, or the folder of a model to score on it as well", file=part.path)
            sections.append(run_section(log))
        elif part.kind == "comparison":
            sections.append(models_section(part))
        elif part.kind == "diagnosis":
            sections.append(diagnosis_section(part))
        elif part is evaluations[0]:
            sections.append(evaluation_section(evaluations))
    return sections
