"""The report of a diagnosis, from its document and, if there is one, the file with its evidence (`diagnose -o`).

First it says what is wrong, then what to do, then it shows the evidence: for a whole rig the error against the time
ahead; for one ring or another system the residual and the best candidates.
"""

from __future__ import annotations

import math
import re
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic_core import from_json, to_json

from mazeplan.apps.report import words
from mazeplan.apps.report.inputs import Input, number, read_as_printed, row
from mazeplan.apps.report.page import INK, Note, PagePicture, PageSection, PageTable, legend_beside, line, write_page
from mazeplan.apps.report.words import DEG
from mazeplan.core.errors import InputError
from mazeplan.core.palette import COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WHEN = {"before": ("bad", "with the model as it was"), "after": ("good", "with what was found")}  # style, words
COMMAND = re.compile(r":\s+(mazeplan .+?)\.?$")  # a command at the end of an advice
CANDIDATES = 8  # number of candidates in the table


def write_diagnosis(document: dict[str, Any], evidence: dict[str, Any], path: Path) -> None:
    """Write the page of one diagnosis, as one file that loads nothing."""
    plain, shown = (from_json(to_json(part, inf_nan_mode="null")) for part in (document, evidence))
    section = diagnosis_section(Input("diagnosis", path.parent, evidence["title"], plain, shown))
    write_page(path, section.title, [section])


def diagnosis_section(given: Input) -> PageSection:
    """The section of a page about a diagnosis. Raises InputError."""
    document, evidence = given.document, given.evidence or {}
    whole = "reference" in document and "advice" in document  # of a whole rig
    if evidence and (evidence.get("kind") == "rig") != whole:
        file = given.path / "evidence.json"
        raise InputError("belongs to another report.json than the one beside it", file=file, key="kind")
    with read_as_printed(given):
        parts: list[Any] = [_advice(text) for text in document.get("advice") or ()]
        if document.get("effects"):
            parts.append(_effects(document["effects"]))
        parts.append(_scores(document, evidence))
        groups = [", ".join(map(words.spoken, group)) for group in document.get("ambiguous_with") or ()]
        parts += [Note(f"Hard to tell apart in this record: {group}.") for group in groups]
        if document.get("navigation") is not None:
            parts.append(_navigation(document["navigation"]))
        if not evidence:
            parts.append(Note("This command writes a folder with the evidence:", "mazeplan diagnose LOG -o FOLDER"))
        elif whole:
            title = "How far is the prediction off? The error grows with the time ahead; band: four of five"
            alt = "error of the angle against the time ahead, before and after"
            parts.append(PagePicture("error", title, alt, partial(_ahead, evidence=evidence), (9.0, 3.2)))
        else:
            parts += _ring_evidence(evidence, document)
        parts += [Note(words.sentence(note)) for note in evidence.get("notes") or document.get("notes") or ()]
        lead = words.spoken(str(document["sentence"]))
        facts = _facts(document)
    return PageSection(f"Diagnosis of {evidence.get('title') or given.name}", lead, facts, parts)


def _facts(document: dict[str, Any]) -> list[tuple[str, str]]:
    radius, known = number(document.get("radius_m")), document.get("declared") or {}
    facts = {
        "verdict": words.spoken(str(document["verdict"])),
        "ring": str(document.get("ring") or ""),
        "compared with": str(document.get("reference") or ""),
        "track radius": f"{1e3 * radius:.2f} mm" if math.isfinite(radius) else "",
        "known before": ", ".join(words.spoken(name) for name in known),
        "new model": document.get("model") or "",
    }
    return [(key, value) for key, value in facts.items() if value]


def _advice(text: str) -> Note:
    """An advice, with its command apart from the text."""
    found = COMMAND.search(text)
    return Note(text) if found is None else Note(f"{text[: found.start()]}:", found[1])


def _effects(effects: list[dict[str, Any]]) -> PageTable:
    """A table with a row for each parameter: its old size and its new size, and the name that `--declare` takes."""
    rows = []
    for effect in effects:
        name, planned = effect["name"], effect.get("planned", True)
        first = [words.spoken(name), "yes" if planned else f"no: {effect['why_not']}"]
        for key, p in effect["parameters"].items():
            old = number(effect.get("known_before", {}).get(key))
            error = number(p.get("stderr"))
            before = words.measured(old + 0.0, None, p["unit"]) if math.isfinite(old) else words.MISSING
            known = p.get("determined", True)
            now = words.measured(p["value"], error, p["unit"]) if known else "not determined"
            rows.append([first[0], words.parameter(name, key), before, now, first[1], f"{name}.{key}"])
            first = ["", ""]
    head = ("effect", "parameter", "before", "in this record ± standard error", "used by plans", "name")
    return PageTable("What was found", head, rows, code=frozenset({5}))


def _scores(document: dict[str, Any], evidence: dict[str, Any]) -> PageTable:
    """Errors before and after, also on a further record if the document has them."""
    labels = dict(words.SCORES)
    if "rollout40" not in evidence.get("labels", {}):  # a system without a ball has its own scores
        labels |= evidence.get("labels", {})
    further, columns = document.get("test") or {}, {when: document.get(when) or {} for when in WHEN}
    columns |= {f"{when}, further record": further[when] for when in WHEN if further.get(when)}
    rows = []
    for name, label in labels.items():
        values = [words.labelled(number(scores.get(name)), label) for scores in columns.values()]
        if any(map(math.isfinite, values)):
            rows.append([words.relabelled(label), *(words.number(value, 3) for value in values)])
    rest = [""] * (len(columns) - 1)
    for key, label, factor in (
        ("noise_floor", "the same by noise alone", DEG if "ring" in document else 1.0),
        ("remaining", "what remains, in times the noise", 1.0),
    ):
        if math.isfinite(value := number(document.get(key))):
            rows.append([label, *rest, words.number(factor * value, 3)])
    return PageTable("On parts that took no part in the fit", ("", *columns), rows)


def _navigation(navigation: dict[str, Any]) -> PageTable:
    """The table of the runs of `improve` with the old model and with the new model."""
    rows = []
    for when in WHEN:
        runs = navigation[when]
        times = (words.number(number(runs["time_s"].get(name)), 2, "s") for name in ("mean", "best", "worst"))
        rows.append([when, f"{runs['success']} of {runs['runs']}", *times])
    title = "Navigations with the old model and with the new one"
    return PageTable(title, ("", "arrived", "mean", "best", "worst"), rows)


def _ring_evidence(evidence: dict[str, Any], document: dict[str, Any]) -> list[Any]:
    """The table of candidates, and the picture of the residual."""
    found = {effect["name"] for effect in document.get("effects", ())}
    ranked = sorted(evidence["candidates"], key=lambda candidate: -candidate["gain"])
    best = ranked[:CANDIDATES]
    best += [candidate for candidate in ranked[CANDIDATES:] if candidate.get("placebo")][:1]  # to compare with
    rows = [[words.spoken(c["name"]), f"{c['gain']:.0f}", "yes" if c["name"] in found else "no"] for c in best]
    title = "Fall of the misfit (-2 log L) with each candidate alone"
    parts: list[Any] = [PageTable(title, ("candidate", "fall", "found"), rows)]
    if evidence.get("before") is not None and evidence.get("after") is not None:
        title = "Residual against position, speed and time; band: two standard errors"
        alt = "mean residual against position, speed and time, before and after"
        parts.append(PagePicture("residual", title, alt, partial(_residuals, evidence=evidence), (9.0, 3.2)))
    return parts


def _residuals(figure: Figure, evidence: dict[str, Any]) -> None:
    panels: Any = figure.subplots(1, 3, sharey=True)
    labels = (*evidence["axes"][:2], "time, s")
    for axes, name, label in zip(panels, ("position", "speed", "time"), labels, strict=True):
        for when, (role, _) in WHEN.items():
            at, mean, error = (row(evidence[when][name][key]) for key in ("at", "mean", "stderr"))
            at = words.labelled(1.0, label) * at
            axes.plot(at, mean, **line(role), label=when)
            axes.fill_between(at, mean - 2 * error, mean + 2 * error, color=COLOURS[role], alpha=0.22, lw=0)
        axes.axhline(0.0, color=INK, lw=0.6)
        axes.set_xlabel(words.relabelled(label))
        axes.grid()
    panels[0].set_ylabel("mean residual,\nin standard deviations")
    legend_beside(panels[2])


def _ahead(figure: Figure, evidence: dict[str, Any]) -> None:
    axes, t = figure.add_subplot(), row(evidence["ahead_s"])
    for when, (style, text) in WHEN.items():
        low, mean, high = (DEG * row(evidence[part][when]) for part in ("low", "error", "high"))
        axes.fill_between(t, low, high, color=COLOURS[style], alpha=0.15, linewidth=0.0)
        axes.plot(t, mean, **line(style), label=text)
    axes.set_xlabel("time ahead, s")
    axes.set_ylabel("error of the angle, degrees")
    axes.set_ylim(bottom=0.0)
    axes.legend(frameon=False, loc="upper left")
