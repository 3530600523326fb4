"""A diagnosis, by its document and, where there is one, the evidence that `diagnose -o` wrote beside it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from mazeplan.report.inputs import Input
from mazeplan.report.models import known
from mazeplan.report.page import Note, Section, Table, write_page

VERDICTS = {
    "nothing_missing": "nothing is missing",
    "effect_found": "an effect was found",
    "ambiguous": "found, but it cannot be told apart from another",
    "unknown_effect": "something is there that has no name",
}
LABELS = {
    "nrmse": "nRMSE of theta_dd", "rollout20": "theta error after 20 samples, rad",
    "rollout40": "theta error after 40 samples, rad", "free_run": "position error of a free run, m",
}  # fmt: skip
Document = dict[str, Any]


def explained_by(evidence: Document) -> str:
    """Of position, speed and time, that of which the residual lost most: by how much the sum of its squared means over
    their standard errors fell. Empty where nothing fell."""
    falls = {name: _misfit(evidence["before"][name]) - _misfit(evidence["after"][name])
             for name in ("position", "speed", "time")}  # fmt: skip
    best = max(falls, key=lambda name: falls[name])
    return best if falls[best] > 0.0 else ""


def _misfit(curve: Document) -> float:
    """Sum over bins of (mean / standard error)^2."""
    total = 0.0
    for mean, stderr in zip(curve["mean"], curve["stderr"], strict=True):
        if mean is not None and stderr:
            total += (mean / stderr) ** 2
    return total


def write_diagnosis(document: Document, evidence: Document, path: Path) -> None:
    """The page of one diagnosis: one file, nothing loaded from elsewhere."""
    given = Input("diagnosis", path.parent, evidence["title"], document, evidence)
    write_page(path, f"What the model lacks: {evidence['title']}", [diagnosis_section(given)])


def diagnosis_section(given: Input) -> Section:
    """Everything about a diagnosis."""
    from mazeplan.report.diagnosis_pictures import diagnosis_pictures

    document, evidence = given.document, given.evidence
    parts: list[Any] = [_scores(document, evidence)]
    if document.get("effects"):
        parts.append(_effects(document))
    parts += _apart(document)
    if document.get("navigation"):
        parts.append(_navigation(document["navigation"]))
    if evidence is not None:
        parts += diagnosis_pictures(document, evidence)
    else:
        parts.append(
            Note("The evidence behind it is in the folder that this writes:", "mazeplan diagnose LOG -o FOLDER")
        )
    notes = evidence["notes"] if evidence is not None and evidence.get("notes") else document.get("notes", [])
    parts += [Note(str(note)) for note in notes]
    verdict = VERDICTS.get(document["verdict"], str(document["verdict"]))
    sentence = document.get("sentence")
    name = evidence.get("title", given.name) if evidence is not None else given.name
    return Section(f"Diagnosis of {name}", str(sentence or verdict), _facts(document, verdict), parts)


def _facts(document: Document, verdict: str) -> list[tuple[str, str]]:
    facts = [("verdict", verdict)]
    if document.get("ring"):
        facts.append(("ring", str(document["ring"])))
    if isinstance(document.get("radius_m"), float):
        facts.append(("track radius", f"{1e3 * document['radius_m']:.2f} mm"))
    if isinstance(document.get("held_out"), int | float):
        facts.append(("held out", f"{100.0 * document['held_out']:.0f} % of the samples"))
    declared = document.get("declared")
    if isinstance(declared, dict) and declared:
        facts.append(("known before", ", ".join(str(name).replace("_", " ") for name in declared)))
    if isinstance(document.get("model"), str):
        facts.append(("new model", document["model"]))
    return facts


def _scores(document: Document, evidence: Document | None) -> Table:
    labels = {**LABELS, **(evidence or {}).get("labels", {})}
    test = document.get("test") or {}
    columns = [("before", document.get("before", {})), ("after", document.get("after", {}))]
    if isinstance(test, dict):
        columns += [(f"{w}, further record", test[w]) for w in ("before", "after") if isinstance(test.get(w), dict)]
    rows = []
    for name, label in labels.items():
        if any(name in part for _, part in columns):
            rows.append([label, *(_number(known(part.get(name))) for _, part in columns)])
    floor = document.get("noise_floor")
    if isinstance(floor, int | float):
        drawn = labels.get((evidence or {}).get("drawn", "rollout40"), "")
        rows.append([f"{drawn}, by noise alone", *[""] * (len(columns) - 1), _number(floor)])
    return Table("On what was held out", ("", *(name for name, _ in columns)), rows)


def _effects(document: Document) -> Table:
    rows = []
    for effect in document["effects"]:
        for i, (name, p) in enumerate(effect["parameters"].items()):
            first = [effect["name"].replace("_", " "), _worth(effect)] if i == 0 else ["", ""]
            unit = str(p.get("unit", "1"))
            value = f"{p['value']:.5g}" + ("" if unit == "1" else f" {unit}")
            error = p.get("stderr")
            rows.append([first[0], name, value, "-" if error is None else f"{error:.2g}", first[1]])
    head = ("effect", "parameter", "value", "standard error", "-2 log L grows without it by")
    return Table("What was found", head, rows)


def _worth(effect: Document) -> str:
    evidence = effect.get("evidence")
    return f"{evidence:.1f}" if isinstance(evidence, int | float) else "-"


def _navigation(navigation: Document) -> Table:
    """Of `improve`: runs with the old model and with the new one."""
    rows = []
    for when in ("before", "after"):
        part = navigation[when]
        times = [known(part["time_s"].get(name)) for name in ("mean", "best", "worst")]
        told = [f"{value:.2f} s" if math.isfinite(value) else "-" for value in times]
        rows.append([when, f"{part['success']} of {part['runs']}", *told])
    return Table("Navigations with the old model and with the new one", ("", "arrived", "mean", "best", "worst"), rows)


def _apart(document: Document) -> list[Note]:
    """For each group that cannot be told apart, what would."""
    found = []
    ways = document.get("separate_by") or []
    for i, group in enumerate(document.get("ambiguous_with") or []):
        names = ", ".join(str(name).replace("_", " ") for name in group)
        text = f"Hard to tell apart in this record: {names}."
        way = ways[i] if i < len(ways) else {}
        if way.get("why"):
            text += f" {_sentence(way['why'])}"
        if way.get("first"):
            text += f" What to do: {way['first']}, then"
        found.append(Note(text, str(way.get("command") or "")))
    return found


def _sentence(text: Any) -> str:
    words = str(text)
    return words[:1].upper() + words[1:] + "."


def _number(value: float) -> str:
    return f"{value:.4f}" if math.isfinite(value) else "-"
