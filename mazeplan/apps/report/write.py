"""Writes the page of inputs, or of a result that Python got."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mazeplan.apps.report.diagnosis import diagnosis_section, write_diagnosis
from mazeplan.apps.report.inputs import Input, of_document
from mazeplan.apps.report.models import model_section, models_section, record_section
from mazeplan.apps.report.page import PagePicture, PageSection, write_page
from mazeplan.apps.report.runs import evaluation_section, run_section
from mazeplan.core.errors import InputError
from mazeplan.core.logs.run_log_reader import read_log
from mazeplan.core.progress import Words, no_words
from mazeplan.core.results import Result

__all__ = ["picture_of", "write_diagnosis", "write_inputs", "write_result"]
SECTIONS = {
    "comparison": models_section, "diagnosis": diagnosis_section, "evaluation": evaluation_section,
    "model": model_section, "record": record_section,
}  # fmt: skip


def write_inputs(inputs: Sequence[Input], path: Path, show: Words = no_words) -> None:
    """Write one page about all inputs. show: gets the name of each input before it is drawn. Raises InputError."""
    sections = []
    for given in inputs:
        show(given.path.name)
        sections.append(_section(given))
    write_page(path, sections[0].title + " and more" * (len(sections) > 1), sections)


def write_result(result: Result, path: Path) -> None:
    """Write the page of a result. Raises InputError, also for a navigation without a log."""
    write_inputs(_inputs(result, path), path)


def picture_of(result: Result) -> str:
    """The first picture on the page of a result, as a data URL; empty without one. Raises InputError."""
    sections = map(_section, _inputs(result, Path(result.kind or "result")))
    return next((part.source() for s in sections for part in s.parts if isinstance(part, PagePicture)), "")


def _section(given: Input) -> PageSection:
    if given.kind != "run":
        return SECTIONS[given.kind](given)
    log = read_log(given.path)
    if "excitation" in log.header:
        raise InputError("got a log of `collect`, expected one of `navigate --log`", file=given.path)
    return run_section(log)


def _inputs(result: Result, path: Path) -> list[Input]:
    document: dict[str, Any] = result.json()
    if result.kind == "run" and document["log"] is None:
        raise InputError("got a run without a log, expected navigate(log=FILE.mcap)", key="report")
    if result.kind == "run":
        return [Input("run", Path(document["log"]), Path(document["log"]).stem)]
    if result.kind:
        return [Input(result.kind, path, path.stem, document, getattr(result, "evidence", None))]
    return of_document(document, path)
