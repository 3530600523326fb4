"""The inputs of a report: finds the kind of each input, and checks its document.

FILE.mcap            log of a run
FILE.json            output of `evaluate`, `compare`, `diagnose` or `improve` with --json
FOLDER               output of `diagnose -o` (report.json, evidence.json), or a model (model.yaml)
FILE.csv             table on which a model is judged
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mazeplan.apps.report import diagnosis_documents, documents
from mazeplan.apps.report.documents import checked
from mazeplan.core import file_kinds
from mazeplan.core.errors import InputError
from mazeplan.core.file_format import format_problem
from mazeplan.maze.geometry import Maze

KINDS = "a run log, or the JSON of evaluate, compare, diagnose or improve, or the folder of diagnose -o or of a model"
FORMAT = 1  # also the format of a document without the key `format`
MOST = 200 * 2**20  # bytes, largest document


@dataclass(frozen=True)
class Input:
    """One input of a report. Raises InputError for a document or evidence that differs from what the commands print.

    kind: run, table, model, evaluation, comparison or diagnosis.
    path: its file or folder.
    name: its name on the page.
    document: its JSON, which becomes a pydantic model; None for runs, tables and models.
    evidence: evidence for the pictures of a diagnosis.
    place: keys that lead to the document in its file.
    maze: the maze of a comparison; None: the packaged map cme."""

    kind: str
    path: Path
    name: str
    document: Any = None
    evidence: Any = None
    place: tuple[str | int, ...] = ()
    maze: Maze | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "document", self._checked())
        if isinstance(self.evidence, dict):
            rig, file = self.evidence.get("kind") == "rig", self.path / "evidence.json"
            if rig != isinstance(self.document, diagnosis_documents.RigDocument):
                raise InputError("belongs to another report.json than the one beside it", file=file, key="kind")
            model = diagnosis_documents.RigEvidenceDocument if rig else diagnosis_documents.EvidenceDocument
            object.__setattr__(self, "evidence", checked(model, self.evidence, file))

    def _checked(self) -> Any:
        document, path = self.document, self.path
        if not isinstance(document, dict):
            return document
        if self.kind == "evaluation":
            return checked(documents.EvaluationDocument, document, path, self.place)
        if self.kind == "comparison":
            for key in document:
                number = key.removeprefix("ring")
                if not number.isdecimal() or int(number) < 1:
                    raise InputError(f"got the key {key[:20]!r}, expected ring1, ring2 ...", file=path)
            rings = checked(dict[str, documents.ComparedRing], document, path, self.place)
            residuals = {key: sorted(ring.residual.mean) for key, ring in rings.items() if ring.residual is not None}
            for key, kinds in residuals.items():
                if kinds != (first := next(iter(residuals.values()))):
                    problem = f"got kinds {kinds}, expected those of the other rings: {first}"
                    raise InputError(problem, file=path, key=f"{key}.residual.mean")
            return {int(key.removeprefix("ring")): rings[key] for key in sorted(rings, key=lambda key: int(key[4:]))}
        whole = "reference" in document and "advice" in document
        model = diagnosis_documents.RigDocument if whole else diagnosis_documents.RingDocument
        file = path / "report.json" if path.is_dir() else path
        return checked(model, document, file, self.place)


def read_input(path: Path) -> list[Input]:
    """The inputs in a file or folder. A document of `improve` has several inputs. Raises InputError for other files."""
    if (path / "model.yaml").is_file():
        return [Input("model", path, path.name)]
    if path.is_dir():
        if not (path / "report.json").is_file():
            raise InputError(f"got a folder without report.json or model.yaml, expected {KINDS}", file=path)
        evidence = path / "evidence.json"
        shown = read_document(evidence) if evidence.is_file() else None
        return [Input("diagnosis", path, path.name, read_document(path / "report.json"), shown)]
    for suffix, kind in ((".mcap", "run"), (".csv", "table")):
        if path.suffix.lower() == suffix:
            return [Input(kind, path, path.stem)]
    return of_document(read_document(path), path)


def read_document(path: Path) -> dict[str, Any]:
    """The object in a JSON file, without its `format`. Raises InputError for other files."""
    try:
        size = path.stat().st_size / 2**20
        if size > MOST / 2**20:
            raise InputError(f"got {size:.0f} MB, expected at most {MOST / 2**20:.0f}", file=path)
        document = json.loads(path.read_bytes().decode("utf-8-sig"))
    except json.JSONDecodeError as problem:
        if file_kinds.got(path) != "JSON":
            raise InputError(file_kinds.refused(path, KINDS), file=path) from None
        raise InputError(f"is no JSON: {problem.msg}; expected {KINDS}", file=path, line=problem.lineno) from None
    except (OSError, ValueError):
        raise InputError(file_kinds.refused(path, KINDS), file=path) from None
    except RecursionError:
        raise InputError(f"is nested too deeply; expected {KINDS}", file=path) from None
    if not isinstance(document, dict):
        raise InputError(f"got a {type(document).__name__}, expected {KINDS}", file=path)
    given = document.pop("format", FORMAT)
    if problem := format_problem(given, FORMAT, document.get("version")):
        raise InputError(problem, file=path, key="format")
    return document


def of_document(document: dict[str, Any], path: Path) -> list[Input]:
    """The inputs in a document, whose keys tell its kind. Raises InputError for an unknown document."""
    if "rounds" in document:
        found = []
        for i, entry in enumerate(checked(diagnosis_documents.ImproveDocument, document, path).rounds):
            place, name = ("rounds", i, "diagnosis"), f"{path.stem}, round {i + 1}"
            found.append(
                Input("diagnosis", path, name, {**entry.diagnosis, "navigation": entry.navigation}, None, place)
            )
        return found
    for key, kind in (("results", "evaluation"), ("verdict", "diagnosis")):
        if key in document:
            return [Input(kind, path, path.stem, document)]
    if document and all(key.startswith("ring") for key in document):
        return [Input("comparison", path, path.stem, document)]
    if "rings" in document and "success" in document:
        raise InputError("got the document of one run, expected its log (navigate --log FILE.mcap)", file=path)
    names = ", ".join(repr(key[:20]) for key in list(document)[:4])
    raise InputError(f"got JSON with {f'the keys {names}' if names else 'nothing in it'}, expected {KINDS}", file=path)
