"""A diagnosis, by its document and, where there is one, the evidence that `diagnose -o` wrote beside it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from mazeplan.diagnosis.excess import TOO_SELDOM, more_than_noise
from mazeplan.report import words
from mazeplan.report.inputs import Input
from mazeplan.report.models import known
from mazeplan.report.page import Note, Section, Table, write_page

VERDICTS = {
    "nothing_missing": "nothing is missing",
    "effect_found": "an effect was found",
    "ambiguous": "found, but it cannot be told apart from another",
    "unknown_effect": "something is there that has no name",
}
Document = dict[str, Any]
SMALL = 0.05  # of the largest evidence; an effect with less is called small


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
    section = diagnosis_section(given)
    write_page(path, section.title, [section])


def diagnosis_section(given: Input) -> Section:
    """Everything about a diagnosis."""
    from mazeplan.report.rigdiagnosis import is_rig, rig_section

    if is_rig(given):
        return rig_section(given)
    from mazeplan.report.diagnosis_pictures import diagnosis_pictures

    document, evidence = given.document, given.evidence
    parts: list[Any] = [_scores(document, evidence)]
    if document.get("effects"):
        parts.append(_effects(document))
    parts += _apart(document)
    if document.get("navigation"):
        parts.append(navigation_table(document["navigation"]))
    if evidence is not None:
        parts += diagnosis_pictures(document, evidence)
    else:
        parts.append(
            Note("The evidence behind it is in the folder that this writes:", "mazeplan diagnose LOG -o FOLDER")
        )
    notes = evidence["notes"] if evidence is not None and evidence.get("notes") else document.get("notes", [])
    parts += [Note(words.sentence(note)) for note in notes]
    verdict = VERDICTS.get(document["verdict"], str(document["verdict"]))
    return Section(f"Diagnosis of {_name(given)}", lead(document, evidence), _facts(document, verdict), parts)


def _name(given: Input) -> str:
    """Of what it is."""
    if given.evidence is not None and given.evidence.get("title"):
        return str(given.evidence["title"])
    ring = given.document.get("ring")
    return f"{given.name}, ring {ring}" if ring else given.name


def labels(evidence: Document | None) -> dict[str, str]:
    """Score -> words with the unit that its number has; a system that is no ball has words of its own."""
    told = (evidence or {}).get("labels", {})
    own = {} if "rollout40" in told else told
    return {**words.SCORES, **own}


def drawn(evidence: Document | None) -> str:
    """The score that is looked at."""
    return str((evidence or {}).get("drawn", "rollout40"))


def lead(document: Document, evidence: Document | None) -> str:
    """What came out, in words; sizes are in the table below."""
    found = _listed([_missing(document, effect) for effect in document.get("effects") or []])
    unknown = words.spoken(str((document.get("unknown") or {}).get("description") or "nobody can say what"))
    change = _change(document, evidence)
    verdict = document["verdict"]
    if verdict == "nothing_missing":
        error, floor = known((document.get("before") or {}).get("rollout40")), known(document.get("noise_floor"))
        if more_than_noise(error, floor):
            told = f"Nothing that is missing was found, but more is left than noise would leave; {TOO_SELDOM}."
            return f"{told} {change}".strip()
        return f"Nothing is missing: what is left is what noise alone would leave. {change}".strip()
    if verdict == "unknown_effect":
        also = f", besides {found}" if found else ""
        return f"Something is there that has no name{also}: {unknown}. {change}".strip()
    tail = "".join(
        f" This record cannot tell {' from '.join(words.spoken(str(name)) for name in group)}."
        for group in document.get("ambiguous_with") or [] if verdict == "ambiguous"
    )  # fmt: skip
    return f"The model lacks {found or 'nothing that has a name'}.{tail} {change}".strip()


def _missing(document: Document, effect: Document) -> str:
    """The name of an effect, with a word where the model had it already, in another size, or where it is small."""
    worths = [known(e.get("evidence")) for e in document["effects"]]
    had, told = (document.get("declared") or {}).get(effect["name"]), []
    if isinstance(had, dict):
        told.append("known before, with " + ("the size 0" if not any(had.values()) else "another size"))
    if known(effect.get("evidence")) < SMALL * max(worths, key=lambda worth: -math.inf if math.isnan(worth) else worth):
        told.append("small")
    return words.spoken(effect["name"]) + (f" ({'; '.join(told)})" if told else "")


def _known_before(name: str, values: Any) -> str:
    """An effect that was declared, with its sizes as they are in files: SI units."""
    sizes = [f"{v:.3g}" for v in values.values() if isinstance(v, int | float)] if isinstance(values, dict) else []
    if sizes and set(sizes) == {"0"}:
        sizes = ["0"]
    return words.spoken(name) + (f" ({', '.join(sizes)})" if sizes else "")


def _listed(names: list[str]) -> str:
    return " and ".join(part for part in (", ".join(names[:-1]), *names[-1:]) if part)


def _change(document: Document, evidence: Document | None) -> str:
    """Of the score that is looked at, before and after; nothing where it is not known."""
    name = drawn(evidence)
    label = labels(evidence).get(name, name)
    before, after = (words.labelled(known((document.get(w) or {}).get(name)), label) for w in ("before", "after"))
    if not (math.isfinite(before) and math.isfinite(after)):
        return ""
    text, _, unit = words.relabelled(label).rpartition(", ")
    text, unit = (text, f" {unit}") if text else (unit, "")
    first = f"{text[:1].upper()}{text[1:]}: {before:.3g}{unit}"
    return f"{first}." if before == after else f"{first} before, {after:.3g}{unit} after."


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
        facts.append(("known before (SI units)", ", ".join(_known_before(*pair) for pair in declared.items())))
    if isinstance(document.get("model"), str):
        facts.append(("new model", document["model"]))
    return facts


def _scores(document: Document, evidence: Document | None) -> Table:
    test = document.get("test") or {}
    columns = [("before", document.get("before", {})), ("after", document.get("after", {}))]
    if isinstance(test, dict):
        columns += [(f"{w}, further record", test[w]) for w in ("before", "after") if isinstance(test.get(w), dict)]
    rows = []
    names = labels(evidence)
    for name, label in names.items():
        if any(name in part for _, part in columns):
            rows.append([words.relabelled(label), *(_cell(known(part.get(name)), label) for _, part in columns)])
    floor = document.get("noise_floor")
    if isinstance(floor, int | float):
        label = names.get(drawn(evidence), "")
        text, comma, unit = words.relabelled(label).rpartition(", ")
        told = f"{text or unit} by noise alone" + (f", {unit}" if comma else "")
        rows.append([told, *[""] * (len(columns) - 1), _cell(floor, label)])
    return Table("On what was held out", ("", *(name for name, _ in columns)), rows)


def _effects(document: Document) -> Table:
    """A row a parameter, with the name by which `--declare` knows it."""
    rows = []
    for effect in document["effects"]:
        for i, (name, p) in enumerate(effect["parameters"].items()):
            size = words.measured(p["value"], p.get("stderr"), str(p.get("unit", "1")))
            told = [words.spoken(effect["name"]), _worth(effect)] if i == 0 else ["", ""]
            rows.append([told[0], words.parameter(effect["name"], name), size, told[1], f"{effect['name']}.{name}"])
    head = ("effect", "what of it", "value ± standard error", "evidence", "name")
    return Table(
        "What was found; evidence: growth of -2 log L (misfit) without it",
        head,
        rows,
        code=frozenset({4}),
    )


def _worth(effect: Document) -> str:
    evidence = effect.get("evidence")
    return f"{evidence:.1f}" if isinstance(evidence, int | float) else words.MISSING


def navigation_table(navigation: Document) -> Table:
    """Of `improve`: runs with the old model and with the new one."""
    rows = []
    for when in ("before", "after"):
        part = navigation[when]
        times = [known(part["time_s"].get(name)) for name in ("mean", "best", "worst")]
        rows.append([when, f"{part['success']} of {part['runs']}", *(words.seconds(value) for value in times)])
    return Table("Navigations with the old model and with the new one", ("", "arrived", "mean", "best", "worst"), rows)


def _apart(document: Document) -> list[Note]:
    """For each group that cannot be told apart, what would."""
    found = []
    ways = document.get("separate_by") or []
    for i, group in enumerate(document.get("ambiguous_with") or []):
        names = ", ".join(words.spoken(str(name)) for name in group)
        text = f"Hard to tell apart in this record: {names}."
        way = ways[i] if i < len(ways) else {}
        if way.get("why"):
            text += f" {words.sentence(way['why'])}"
        if way.get("first"):
            text += f" What to do: {words.spoken(str(way['first']))}, then"
        if way.get("note"):
            text += f" ({words.spoken(str(way['note']))})"
        found.append(Note(text, str(way.get("command") or "")))
    return found


def _cell(value: float, label: str) -> str:
    return words.number(words.labelled(value, label), 2 if label.endswith(", rad") else 4)
