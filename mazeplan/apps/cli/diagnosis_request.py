"""What all kinds of `diagnose` share: their options, known parameters, and the output."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mazeplan.apps.cli.output import finite, print_json, write_text
from mazeplan.core.errors import InputError
from mazeplan.core.logs.column_units import ColumnSource
from mazeplan.core.name_hints import one_of

if TYPE_CHECKING:
    from mazeplan.diagnosis.coordinate.diagnosis import Diagnosis
    from mazeplan.diagnosis.engine.diagnosis import MotionDiagnosis
    from mazeplan.physics.effect import Effect

Values = dict[str, dict[str, float]]  # {effect: {parameter: value}}


@dataclass(frozen=True)
class DiagnosisRequest:
    """Options of `diagnose`. radius: of the track, m"""

    logs: list[Path]
    model: str | None
    radius: float | None
    declare: list[str]
    ring: int | None
    test: Path | None
    map: str | None
    effects: str | None
    output: Path | None
    references: list[Path]
    as_json: bool
    columns: Mapping[str, ColumnSource] = field(default_factory=dict)


def declare_known(known: Values, texts: Iterable[str], candidates: Iterable[Effect], partly: str = "") -> None:
    """Add the parameters of `--declare` to `known`. Raises InputError that names the allowed ones.

    texts: EFFECT.PARAM=VALUE
    candidates: the effects that may be declared
    partly: an effect whose other parameters stay undeclared; those of another declared effect get their defaults"""
    library, given = {effect.name: effect for effect in candidates}, set[str]()
    for text in texts:
        name, equals, value = text.partition("=")
        effect, _, parameter = name.partition(".")
        if not (equals and parameter):
            example = "such as dry_friction.coefficient=0.4"
            raise InputError(f"--declare: got {text!r}, expected EFFECT.PARAM=VALUE, {example}")
        if effect not in library:
            raise InputError(f"--declare: got effect {effect!r}, expected {one_of(library, effect)}")
        allowed = library[effect].parameters
        if parameter not in allowed:
            expected = f"expected {one_of(allowed, parameter)}"
            raise InputError(f"--declare: got parameter {parameter!r} of {effect}, {expected}")
        if name in given:
            raise InputError(f"--declare: got {name} twice, expected it once")
        given.add(name)
        try:
            number = float(value)
        except ValueError:
            hint = f", as {value.replace(',', '.', 1)}" if "," in value else ""
            raise InputError(f"--declare: got {text!r}, expected EFFECT.PARAM=VALUE with a number{hint}") from None
        spec = allowed[parameter]
        if not (math.isfinite(number) and spec.low <= number <= spec.high):
            expected = f"expected {spec.low:g} to {spec.high:g} {spec.unit}"
            raise InputError(f"--declare: got {effect}.{parameter} {number:g}, {expected}")
        defaults = {} if effect == partly else {key: p.default for key, p in allowed.items()}
        known.setdefault(effect, defaults)[parameter] = number


def write_reports(document: dict[str, Any], evidence: dict[str, Any], output: Path) -> None:
    """Write report.json, evidence.json and report.html. Sets `report` in the document."""
    from mazeplan.apps.report.diagnosis import write_diagnosis

    document["report"] = str(output / "report.html")
    write_text(output / "report.json", json.dumps(finite(document), indent=1) + "\n")
    write_text(output / "evidence.json", json.dumps(finite(evidence)) + "\n")
    write_diagnosis(document, evidence, output / "report.html")


def finish(done: Diagnosis | MotionDiagnosis, document: dict[str, Any], request: DiagnosisRequest, title: str) -> None:
    """Write the report of a diagnosis of one mechanism, and print the result."""

    if request.output is not None:
        further = [note for note in document["notes"] if note not in done.remarks]
        write_reports(document, done.evidence_document(title, further), request.output)
    if request.as_json:
        print_json(document)
    else:
        on_test = "" if done.test is None else done.test[0].both(done.test[1])  # pyright: ignore[reportArgumentType]
        print("\n".join(result_lines(done.sentence(), document, on_test)))


def lines_of_test(errors: str) -> list[str]:
    """A line with the errors before and after, on the record of --test; no line without such a record."""
    return [f"on the record of --test: {errors}"] if errors else []


def result_lines(sentence: str, document: dict[str, Any], on_test: str = "") -> list[str]:
    """The verdict, errors on a test record, ways to separate ambiguous effects, notes and written files."""
    ring = document.get("ring")
    lines = [f"Ring {ring}: {sentence}" if ring else sentence, *lines_of_test(on_test)]
    ways = (
        (way["first"] + ", then " if way["first"] else "", way["command"]) for way in document.get("separate_by", [])
    )
    lines += dict.fromkeys(f"to separate them: {first}{command}" for first, command in ways)
    lines += [f"note: {note}" for note in document["notes"]]
    return lines + [f"{key}: {document[key]}" for key in ("report", "model") if document.get(key) is not None]
