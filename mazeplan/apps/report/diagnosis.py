"""The report of a diagnosis, from its document and, if there is one, the file with its evidence (`diagnose -o`).

A diagnosis of a whole rig has another report (`rig_diagnosis`).
"""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic_core import from_json, to_json

from mazeplan.apps.report import words
from mazeplan.apps.report.drawing import INK, legend_beside, line
from mazeplan.apps.report.inputs import Input, number, read_as_printed, row
from mazeplan.apps.report.page import Note, PagePicture, PageSection, PageTable, write_page
from mazeplan.apps.report.rig_diagnosis import navigation_table, rig_section, score_columns
from mazeplan.core.errors import InputError
from mazeplan.core.palette import COLOURS
from mazeplan.diagnosis.excess import TOO_SELDOM, more_than_noise

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ANGLE = "theta, rad"  # label of an axis that shows the angle on the ring
WHEN = {"before": "bad", "after": "good"}  # styles
CANDIDATES = 8  # number of candidates in the table


def write_diagnosis(document: dict[str, Any], evidence: dict[str, Any], path: Path) -> None:
    """Write the page of one diagnosis, as one file that loads nothing."""
    plain, shown = (from_json(to_json(part, inf_nan_mode="null")) for part in (document, evidence))
    section = diagnosis_section(Input("diagnosis", path.parent, evidence["title"], plain, shown))
    write_page(path, section.title, [section])


def diagnosis_section(given: Input) -> PageSection:
    """The section of a page about a diagnosis. Raises InputError."""
    document, evidence = given.document, given.evidence
    whole = "reference" in document and "advice" in document
    if evidence is not None and (evidence.get("kind") == "rig") != whole:
        file = given.path / "evidence.json"
        raise InputError("belongs to another report.json than the one beside it", file=file, key="kind")
    with read_as_printed(given):
        return rig_section(given) if whole else _ring_section(given.name, document, evidence or {})
    raise InputError("no diagnosis", file=given.path)


def _ring_section(name: str, document: dict[str, Any], evidence: dict[str, Any]) -> PageSection:
    """The section about one ring of a maze, or another system. evidence: empty for a document alone"""
    labels = dict(words.SCORES)
    if evidence and "rollout40" not in evidence.get("labels", {}):  # a system without a ball has its own scores
        labels |= evidence.get("labels", {})
    drawn = evidence.get("drawn", "rollout40")
    parts: list[Any] = [_scores(document, labels, drawn)]
    if document.get("effects"):
        parts.append(_effects(document["effects"]))
    parts += _experiments(document)
    if document.get("navigation") is not None:
        parts.append(navigation_table(document["navigation"]))
    if evidence:
        parts += _evidence(evidence, {effect["name"] for effect in document.get("effects", ())})
    else:
        text = "This command writes a folder with the evidence, which the page can show:"
        parts.append(Note(text, "mazeplan diagnose LOG -o FOLDER"))
    notes = evidence.get("notes") or document.get("notes") or ()
    parts += [Note(words.sentence(note)) for note in notes]
    ring, radius = document.get("ring"), number(document.get("radius_m"))
    facts = {
        "verdict": words.spoken(str(document["verdict"])),
        "ring": str(ring or ""),
        "track radius": f"{1e3 * radius:.2f} mm" if math.isfinite(radius) else "",
        "known before (SI units)": ", ".join(_known_before(*pair) for pair in (document.get("declared") or {}).items()),
        "new model": document.get("model") or "",
    }
    title = evidence.get("title") or name + (f", ring {ring}" if ring else "")
    shown = [(key, value) for key, value in facts.items() if value]
    return PageSection(f"Diagnosis of {title}", _lead(document, labels, drawn), shown, parts)


def _lead(document: dict[str, Any], labels: dict[str, str], drawn: str) -> str:
    """The finding in words, without sizes, which are in the table below."""
    names = [words.spoken(effect["name"]) for effect in document.get("effects", ())]
    found = " and ".join(part for part in (", ".join(names[:-1]), *names[-1:]) if part)
    verdict = document["verdict"]
    if verdict == "nothing_missing":
        if more_than_noise(number(document["before"].get("rollout40")), number(document.get("noise_floor"))):
            text = f"Nothing that is missing was found, but more is left than noise would leave; {TOO_SELDOM}."
        else:
            text = "Nothing is missing: what is left is what noise alone would leave."
    elif verdict == "unknown_effect":
        also = f", besides {found}" if found else ""
        unknown = words.spoken(str((document.get("unknown") or {}).get("description") or "its cause is not known"))
        text = f"Something is there that has no name{also}: {unknown}."
    else:
        text = f"The model lacks {found or 'nothing that has a name'}."
        for group in document["ambiguous_with"] if verdict == "ambiguous" else ():
            text += f" This record cannot tell {' from '.join(map(words.spoken, group))}."
    label = labels.get(drawn, drawn)
    before, after = (words.labelled(number(document[when].get(drawn)), label) for when in WHEN)
    if not (math.isfinite(before) and math.isfinite(after)):
        return text
    score, unit = words.split_unit(label)
    return f"{text} {score[:1].upper()}{score[1:]}: {before:.3g}{unit} before, {after:.3g}{unit} after."


def _known_before(name: str, values: Any) -> str:
    """A declared effect with its sizes in SI units, as in files."""
    sizes = [f"{v:.3g}" for v in values.values() if isinstance(v, int | float)] if isinstance(values, dict) else []
    return words.spoken(name) + (f" ({', '.join(sizes)})" if sizes else "")


def _scores(document: dict[str, Any], labels: dict[str, str], drawn: str) -> PageTable:
    columns = score_columns(document, "before", "after")
    rows = [
        [words.relabelled(label), *(_cell(number(part.get(name)), label) for part in columns.values())]
        for name, label in labels.items() if any(name in part for part in columns.values())
    ]  # fmt: skip
    floor = number(document.get("noise_floor"))
    if math.isfinite(floor):
        label = labels.get(drawn, "")
        text, unit = words.split_unit(label)
        name = f"{text} by noise alone{',' if unit else ''}{unit}"
        rows.append([name, *[""] * (len(columns) - 1), _cell(floor, label)])
    return PageTable("On held-out samples", ("", *columns), rows)


def _cell(value: float, label: str) -> str:
    return words.number(words.labelled(value, label), 2 if label.endswith(", rad") else 4)


def _effects(effects: list[dict[str, Any]]) -> PageTable:
    """A table with a row for each parameter, with the name that `--declare` takes."""
    rows = []
    for effect in effects:
        first = [words.spoken(effect["name"]), words.number(number(effect.get("evidence")), 1)]
        for name, p in effect["parameters"].items():
            size = words.measured(p["value"], p.get("stderr"), p["unit"])
            label = words.parameter(effect["name"], name)
            rows.append([first[0], label, size, first[1], f"{effect['name']}.{name}"])
            first = ["", ""]
    head = ("effect", "parameter", "value ± standard error", "evidence", "name")
    title = "What was found; evidence: growth of -2 log L (misfit) without it"
    return PageTable(title, head, rows, code=frozenset({4}))


def _experiments(document: dict[str, Any]) -> list[Note]:
    """A paragraph for each group of effects that the record cannot tell apart, with an experiment that can."""
    found, ways = [], document.get("separate_by") or []
    for i, group in enumerate(document.get("ambiguous_with") or ()):
        text, command = f"Hard to tell apart in this record: {', '.join(map(words.spoken, group))}.", ""
        if i < len(ways):
            way = ways[i]
            text += f" {words.sentence(way['why'])}" if way.get("why") else ""
            text += f" What to do: {words.spoken(str(way['first']))}, then" if way.get("first") else ""
            command = str(way.get("command") or "")
        found.append(Note(text, command))
    return found


def _evidence(evidence: dict[str, Any], found: set[str]) -> list[Any]:
    """The table of candidates, and the picture of the residual. found: names of the found effects"""
    ranked = sorted(evidence["candidates"], key=lambda candidate: -candidate["gain"])
    best = ranked[:CANDIDATES]
    best += [candidate for candidate in ranked[CANDIDATES:] if candidate.get("placebo")][:1]  # to compare with
    rows = [[words.candidate(c["name"]), f"{c['gain']:.0f}", "yes" if c["name"] in found else "no"] for c in best]
    title = "Fall of the misfit (-2 log L) with each candidate alone"
    if "accept" in evidence:
        title += f"; it counts from {evidence['accept']:g}"
    parts: list[Any] = [PageTable(title, ("candidate", "fall", "found"), rows)]
    if evidence.get("before") is not None and evidence.get("after") is not None:
        parts.append(
            PagePicture(
                "residual", "Residual against position, speed and time; band: two standard errors",
                "mean residual against position, speed and time, before and after",
                partial(_residuals, evidence=evidence), (9.0, 3.2),
            )
        )  # fmt: skip
    return parts


def _residuals(figure: Figure, evidence: dict[str, Any]) -> None:
    panels: Any = figure.subplots(1, 3, sharey=True)
    labels = (*evidence["axes"][:2], "time, s")
    for axes, name, label in zip(panels, ("position", "speed", "time"), labels, strict=True):
        for when, role in WHEN.items():
            at, mean, error = (row(evidence[when][name][key]) for key in ("at", "mean", "stderr"))
            at = words.labelled(1.0, label) * at
            order = np.argsort(at % 360.0) if label == ANGLE else np.arange(len(at))  # on the ring from 0 to 360
            at, mean, error = at[order] % 360.0 if label == ANGLE else at, mean[order], error[order]
            axes.plot(at, mean, **line(role), label=when)
            axes.fill_between(at, mean - 2 * error, mean + 2 * error, color=COLOURS[role], alpha=0.22, lw=0)
        axes.axhline(0.0, color=INK, lw=0.6)
        axes.set_xlabel(words.relabelled(label) + ("\n(counted against the motion)" if name == "time" else ""))
        if label == ANGLE:
            axes.set_xticks(range(0, 361, 90))
        axes.grid()
    panels[0].set_ylabel("mean residual,\nin standard deviations")
    legend_beside(panels[2])
