"""The inputs of a report: finds the kind of each input, and reads its document.

FILE.mcap            log of a run
FILE.json            output of `evaluate`, `compare`, `diagnose` or `improve` with --json; round.json of `improve`
FOLDER               output of `diagnose -o` (report.json, evidence.json), or of `evaluate --store`
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.core import file_kinds
from mazeplan.core.errors import InputError, MapError
from mazeplan.core.file_kinds import format_problem
from mazeplan.core.records import Array
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import check_text, load_map

KINDS = (
    "a run log, or the JSON of evaluate, compare, diagnose or improve, or the folder of diagnose -o or evaluate --store"
)
FORMAT = 1  # also the format of a document without the key `format`
DAMAGE = (KeyError, TypeError, ValueError, AttributeError, IndexError)


@dataclass(frozen=True)
class Input:
    """One input of a report: its kind, its file or folder, its name on the page, and its JSON, None for runs.

    evidence: for the pictures of a diagnosis"""

    kind: str
    path: Path
    name: str
    document: Any = None
    evidence: Any = None


def number(value: Any) -> float:
    """A number of a document; NaN for a missing one (null)."""
    return math.nan if value is None else float(value)


def row(values: Any) -> Array:
    """Numbers of a document, (N,); NaN for missing ones (null)."""
    return np.array(values, dtype=float)


def map_in(text: Any, file: Path) -> Maze:
    """The map in a log or document, else cme. Raises MapError for a map with errors."""
    if not isinstance(text, str):
        return load_map("cme")
    maze = check_text(text, file=file).maze
    if maze is None:
        raise MapError("the map in it cannot be used", file=file, key="map")
    return maze


@contextmanager
def read_as_printed(given: Input) -> Iterator[None]:
    """Within this context, a document that differs from what the commands print raises InputError."""
    try:
        yield
    except InputError:
        raise
    except DAMAGE as problem:
        what = f"no {problem}" if isinstance(problem, KeyError) else str(problem)
        raise InputError(f"is not what the command printed: {what}", file=given.path) from None


def read_input(path: Path) -> list[Input]:
    """The inputs in a file or folder. A document of `improve` has several inputs. Raises InputError for other files."""
    if path.is_dir():
        from mazeplan.run.commands.evaluate import stored_documents  # slow to import

        if documents := stored_documents(path):
            names = [path.name, *(f"{path.name}, {i}" for i in range(2, len(documents) + 1))]
            return [Input("evaluation", path, name, one) for name, one in zip(names, documents, strict=True)]
        if not (path / "report.json").is_file():
            raise InputError(f"got a folder without report.json, expected {KINDS}", file=path)
        evidence = path / "evidence.json"
        shown = read_document(evidence) if evidence.is_file() else None
        return [Input("diagnosis", path, path.name, read_document(path / "report.json"), shown)]
    if path.suffix.lower() == ".mcap":
        return [Input("run", path, path.stem)]
    return of_document(read_document(path), path)


def read_document(path: Path, kinds: str = KINDS) -> dict[str, Any]:
    """The object in a JSON file, without its `format`. Raises InputError for other files. kinds: what is expected"""
    try:
        document = json.loads(path.read_bytes().decode("utf-8-sig"))
    except json.JSONDecodeError as problem:
        if file_kinds.got(path) != "JSON":
            raise InputError(file_kinds.refused(path, kinds), file=path) from None
        raise InputError(f"is no JSON: {problem.msg}; expected {kinds}", file=path, line=problem.lineno) from None
    except (OSError, ValueError, RecursionError):
        raise InputError(file_kinds.refused(path, kinds), file=path) from None
    if not isinstance(document, dict):
        raise InputError(f"got a {type(document).__name__}, expected {kinds}", file=path)
    given = document.pop("format", FORMAT)
    if problem := format_problem(given, FORMAT, document.get("version")):
        raise InputError(problem, file=path, key="format")
    return document


def of_document(document: dict[str, Any], path: Path) -> list[Input]:
    """The inputs in a document, whose keys tell its kind. Raises InputError for an unknown document."""
    if "diagnosis" in document and "navigation" in document:  # round.json of `improve`
        document = {"rounds": [document]}
    if "rounds" in document:
        with read_as_printed(Input("diagnosis", path, path.stem)):
            rounds = [{**entry["diagnosis"], "navigation": entry.get("navigation")} for entry in document["rounds"]]
        return [Input("diagnosis", path, f"{path.stem}, round {i}", entry) for i, entry in enumerate(rounds, start=1)]
    for key, kind in (("results", "evaluation"), ("verdict", "diagnosis")):
        if key in document:
            return [Input(kind, path, path.stem, document)]
    if document and all(key.startswith("ring") for key in document) and "rings" not in document:
        return [Input("comparison", path, path.stem, document)]
    names = ", ".join(repr(key[:20]) for key in list(document)[:4])
    raise InputError(f"got JSON with {f'the keys {names}' if names else 'nothing in it'}, expected {KINDS}", file=path)
