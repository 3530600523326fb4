"""`diagnose` of all rings together: compares a rig with its reference."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mazeplan.core.logs.table import Table, as_table, join, name_of
from mazeplan.diagnosis.rig.reference import known_reference, reference_of, save_reference
from mazeplan.diagnosis.rig.update import kept_in_model, moved_model, reference_after
from mazeplan.diagnosis.rig.verdict import RigVerdict, verdict_on
from mazeplan.diagnosis.rig.words import advice, errors_in_words
from mazeplan.learning.modelfile import RigModel, save_model
from mazeplan.physics.registry import own_effects
from mazeplan.run.commands.diagnosis_request import DiagnosisRequest, DiagnosisResult, lines_of_test, write_reports
from mazeplan.run.commands.log_context import check_wiring, logged_map


def diagnose_rig(tables: Sequence[Table], request: DiagnosisRequest) -> DiagnosisResult:
    """Find the differences between a rig and its reference, all rings together. Raises TableError, InputError."""
    further = [] if request.test is None else [request.test]
    found = logged_map(request.map, *request.logs, *further, *request.references)
    maze, known = found.maze, request.known
    added = own_effects(request.effects)
    for one in tables:
        check_wiring(one, maze)
    request.progress("reference")
    references = [as_table(log, request.columns) for log in request.references]
    folder = None if isinstance(request.model, RigModel | None) else str(request.model)
    was = reference_of(references, maze, known) if references else known_reference(folder, known, maze)
    test = None if request.test is None else as_table(request.test, request.columns)
    table = tables[0] if len(tables) == 1 else join(tables)
    done = verdict_on(table, maze, was, request.progress, test, added)
    document: dict[str, Any] = done.document() | {"model": None, "report": None}
    names = [name_of(log) for log in request.logs]
    title = " and ".join(names[:2]) + (" and others" if len(names) > 2 else "")
    if request.output is not None:
        _write_model(done, document, known, request.output)
    needed = {"--model MODEL (the folder of `mazeplan learn`)": known, "-o FOLDER": request.output}
    add = " and ".join(option for option, value in needed.items() if value is None)
    document["advice"] = advice(done, document["model"], add, shlex.join(map(_typed, request.logs)))
    evidence = {"kind": "rig", "title": title, **done.held.evidence(done.plate.body.pictures.dt)}
    if request.output is not None:
        write_reports(document, evidence, request.output)
    on_test = lines_of_test("" if done.test is None else errors_in_words(done, done.test))
    lines = [document["sentence"], *on_test, *document["advice"], *(f"note: {note}" for note in done.notes)]
    lines += [f"{key}: {document[key]}" for key in ("report", "model") if document[key] is not None]
    return DiagnosisResult(document, evidence, tuple(lines))


def _typed(log: Any) -> str:
    """A log as in a command line."""
    return str(log) if isinstance(log, str | Path) else name_of(log)


def _write_model(done: RigVerdict, document: dict[str, Any], known: RigModel | None, output: Path) -> None:
    """Write the model with the found effects, and its reference. Sets `model` in the document."""
    if known is not None and kept_in_model(done.effects):
        new = moved_model(known, done.effects, done.searched.fit, done.zero)
        document["model"] = str(save_model(new, output / "model").parent)
        if not done.was.body.open:
            save_reference(reference_after(done), new, output / "model")
