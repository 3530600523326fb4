"""What all kinds of `diagnose` share: their options, known parameters, and the result."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar

from mazeplan.core.errors import InputError, one_of
from mazeplan.core.logs.columns import ColumnSource
from mazeplan.core.progress import Words, no_words
from mazeplan.core.results import PAGES, DocumentResult, finite
from mazeplan.core.whole_file import write_text
from mazeplan.diagnosis.engine.diagnosis import MotionDiagnosis
from mazeplan.diagnosis.ring.result import RingDiagnosis
from mazeplan.learning.modelfile import RigModel, load_model
from mazeplan.maze.geometry import Maze
from mazeplan.physics.effect import Effect

Values = dict[str, dict[str, float]]  # {effect: {parameter: value}}


@dataclass(frozen=True)
class DiagnosisRequest:
    """Options of `diagnose`.

    logs, test, references: paths, or tables in memory"""

    logs: list[Any]
    model: str | Path | RigModel | None
    radius: float | None  # of the track, m
    declare: list[str]
    ring: int | None
    test: Any
    map: str | Path | Maze | None
    effects: str | None
    output: Path | None
    references: list[Any]
    columns: Mapping[str, ColumnSource] = field(default_factory=dict)
    progress: Words = no_words  # gets the step under way

    @property
    def known(self) -> RigModel | None:
        """The model, read; None without one. Raises ModelError."""
        return self.model if isinstance(self.model, RigModel | None) else load_model(self.model)


@dataclass(frozen=True)
class DiagnosisResult(DocumentResult):
    """A diagnosis: its document, what its pictures show, and the result in words."""

    kind: ClassVar[str] = "diagnosis"

    evidence: dict[str, Any] = field(repr=False)
    lines: tuple[str, ...]

    @property
    def verdict(self) -> str:
        """nothing_missing, effect_found, ambiguous or unknown_effect."""
        return self.document["verdict"]


def declare_known(known: Values, texts: Iterable[str], candidates: Iterable[Effect], partly: str = "") -> None:
    """Add the parameters of `--declare` to `known`. Raises InputError that names the allowed ones.

    texts: EFFECT.PARAM=VALUE
    candidates: the effects that may be declared
    partly: an effect whose other parameters stay undeclared; those of another declared effect get their defaults"""
    library = {effect.name: effect for effect in candidates}
    for text in texts:
        name, _, value = text.partition("=")
        effect, _, parameter = name.partition(".")
        if effect not in library:
            raise InputError(f"--declare: got effect {effect!r}, expected {one_of(library, effect)}")
        allowed = library[effect].parameters
        if parameter not in allowed:
            expected = f"expected {one_of(allowed, parameter)}"
            raise InputError(f"--declare: got parameter {parameter!r} of {effect}, {expected}")
        spec = allowed[parameter]
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not (math.isfinite(number) and spec.low <= number <= spec.high):
            expected = f"expected EFFECT.PARAM=VALUE with a value from {spec.low:g} to {spec.high:g} {spec.unit}"
            raise InputError(f"--declare: got {text!r}, {expected}")
        defaults = {} if effect == partly else {key: p.default for key, p in allowed.items()}
        known.setdefault(effect, defaults)[parameter] = number


def write_reports(document: dict[str, Any], evidence: dict[str, Any], output: Path) -> None:
    """Write report.json, evidence.json and report.html. Sets `report` in the document."""
    document["report"] = str(output / "report.html")
    write_text(output / "report.json", json.dumps(finite(document), indent=1) + "\n")
    write_text(output / "evidence.json", json.dumps(finite(evidence)) + "\n")
    import_module(PAGES).write_diagnosis(document, evidence, output / "report.html")


def finish(
    done: RingDiagnosis | MotionDiagnosis, document: dict[str, Any], request: DiagnosisRequest, title: str
) -> DiagnosisResult:
    """The result of a diagnosis of one mechanism. Writes its report, if one was asked for."""
    further = [note for note in document["notes"] if note not in done.remarks]
    evidence = done.evidence_document(title, further)
    if request.output is not None:
        write_reports(document, evidence, request.output)
    on_test = "" if done.test is None else done.test[0].both(done.test[1])  # pyright: ignore[reportArgumentType]
    ring, sentence = document.get("ring"), done.sentence()
    lines = [f"Ring {ring}: {sentence}" if ring else sentence, *lines_of_test(on_test)]
    return DiagnosisResult(document, evidence, (*lines, *lines_of_files(document)))


def lines_of_test(errors: str) -> list[str]:
    """A line with the errors before and after, on the record of --test; no line without such a record."""
    return [f"on the record of --test: {errors}"] if errors else []


def lines_of_files(document: dict[str, Any]) -> list[str]:
    """The notes, and the files that were written."""
    files = [f"{key}: {document[key]}" for key in ("report", "model") if document.get(key) is not None]
    return [*(f"note: {note}" for note in document["notes"]), *files]
