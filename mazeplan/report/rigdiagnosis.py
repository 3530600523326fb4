"""The diagnosis of a whole rig: what is wrong with it, and what to do, in this order; then why we think so."""

from __future__ import annotations

import math
import re
from typing import Any

from mazeplan.physics.registry import EFFECTS
from mazeplan.report import words
from mazeplan.report.diagnosis import navigation_table
from mazeplan.report.inputs import Input, is_rig_document
from mazeplan.report.page import Note, Section, Steps, Table

Document = dict[str, Any]
AS_WAS, AS_FOUND = "with the model as it was", "with what was found"
VERDICTS = {
    "nothing_missing": "the rig is as its model says",
    "effect_found": "the cause was found",
    "ambiguous": "a cause was found, but not told apart from another",
    "unknown_effect": "something has no name",
}
COMMAND = re.compile(r":\s+(mazeplan .+?)\.?$")  # at the end of an advice
SMALL_UNITS = {"m": (1e3, "mm"), "s": (1e3, "ms")}  # as people read them


def is_rig(given: Input) -> bool:
    """Whether a diagnosis is one of a whole rig."""
    return is_rig_document(given.document)


def rig_section(given: Input) -> Section:
    """Everything about it."""
    from mazeplan.report.rigdiagnosis_pictures import rig_pictures

    document, evidence = given.document, given.evidence
    parts: list[Any] = []
    if document["advice"]:
        parts.append(Steps("What to do", [_step(text) for text in document["advice"]]))
    if document.get("effects"):
        parts.append(_effects(document))
    parts.append(_errors(document))
    if document.get("navigation"):
        parts.append(navigation_table(document["navigation"]))
    if evidence is not None:
        parts += rig_pictures(document, evidence)
    else:
        told = "The pictures behind this verdict are in the folder that this command writes:"
        parts.append(Note(told, "mazeplan diagnose LOG --reference LOG --model MODEL -o FOLDER"))
    parts.append(_remaining(document, evidence))
    parts += [Note(words.sentence(note)) for note in document.get("notes", [])]
    title = evidence["title"] if evidence is not None else given.name
    return Section(f"Diagnosis of {title}", str(document["sentence"]), _facts(document), parts)


def _step(advice: str) -> Note:
    """An advice, its command set apart."""
    found = COMMAND.search(advice)
    return Note(advice) if found is None else Note(f"{advice[: found.start()]}:", found[1])


def _facts(document: Document) -> list[tuple[str, str]]:
    facts = [("verdict", VERDICTS.get(document["verdict"], str(document["verdict"])))]
    facts.append(("compared with", str(document["reference"])))
    facts.append(("held out", "each half of the record, predicted by a fit to the other"))
    if isinstance(document.get("model"), str):
        facts.append(("new model", document["model"]))
    return facts


def _effects(document: Document) -> Table:
    """A row a number: what it was, and what it is."""
    rows = []
    for effect in document["effects"]:
        rings, before = ", ".join(effect.get("rings", {})), effect.get("known_before", {})
        planned = "yes" if effect.get("planned", True) else f"no: {effect.get('why_not', '')}"
        for i, (name, p) in enumerate(effect["parameters"].items()):
            factor, unit = SMALL_UNITS.get(p.get("unit", "1"), (1.0, str(p.get("unit", "1"))))
            error = p.get("stderr")
            had = isinstance(before.get(name), int | float) and name not in _where(effect["name"])
            old = _as_precise(factor * before[name] + 0.0, unit, _scaled(error, factor)) if had else words.MISSING
            size = words.measured(factor * p["value"], _scaled(error, factor), unit)
            told = [words.spoken(effect["name"]), rings, planned] if i == 0 else ["", "", ""]
            rows.append([told[0], words.parameter(effect["name"], name), old, size, told[1], told[2]])
    head = ("effect", "what of it", "before", "in this record ± standard error", "rings", "used by plans")
    return Table("What differs; sizes are those of the ring that is named first", head, rows)


def _scaled(error: Any, factor: float) -> float | None:
    return factor * error if isinstance(error, int | float) and math.isfinite(error) else None


def _as_precise(value: float, unit: str, error: float | None) -> str:
    """A value alone, with the digits of the one that it is compared with."""
    told = words.measured(value, error, unit)
    return re.sub(rf"{words.HARD}±{words.HARD}[0-9.]+", "", told)


def _where(name: str) -> tuple[str, ...]:
    """Parameters of an effect that say where it is, which it was not before."""
    return EFFECTS[name].places if name in EFFECTS else ()


def _errors(document: Document) -> Table:
    """Before alone, where nothing was found."""
    test, columns = document.get("test") or {}, [(AS_WAS, document["before"])]
    if something_found(document):
        columns.append((AS_FOUND, document["after"]))
    columns += [(f"{told}, further record", test[w]) for told, w in ((AS_WAS, "before"), (AS_FOUND, "after"))
                if w in test]  # fmt: skip
    rows = []
    for ahead in (20, 40):
        values = [part.get(f"rollout{ahead}") for _, part in columns]
        shown = [words.number(math.nan if v is None else words.DEG * v, 1) for v in values]
        rows.append([f"error of the angle {ahead} samples ahead, deg", *shown])
    head = ("", *(name for name, _ in columns))
    return Table("How well the ball is predicted, on parts that took no part in the fit (mean error)", head, rows)


def something_found(document: Document) -> bool:
    """Whether there is an after beside the before."""
    return bool(document.get("effects") or document.get("unknown"))


def _remaining(document: Document, evidence: Document | None) -> Table:
    """How much is left, and how much there was when the model was right."""
    then = ((evidence or {}).get("remaining") or {}).get("then")
    rows = [["in this record, with what was found" if something_found(document) else "in this record",
             _times(document.get("remaining"))]]  # fmt: skip
    rows.append(["when the model was right", _times(then or None)])  # 0: nobody knows
    return Table("What remains, in times the noise of the camera (1: noise alone)", ("", "times the noise"), rows)


def _times(value: Any) -> str:
    return f"{value:.2f}" if isinstance(value, int | float) and math.isfinite(value) else words.MISSING
