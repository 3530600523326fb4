"""The report of a diagnosis, from its document and, if there is one, the file with its evidence (`diagnose -o`).

A diagnosis of a whole rig has another report (`rigdiagnosis`).
"""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic_core import from_json, to_json

from mazeplan.apps.report import words
from mazeplan.apps.report.diagnosis_documents import (
    CandidateEntry,
    EffectEntry,
    EvidenceDocument,
    RigDocument,
    RingDocument,
)  # fmt: skip
from mazeplan.apps.report.drawing import INK, empty_panel, legend_beside, line, panel_row
from mazeplan.apps.report.inputs import Input
from mazeplan.apps.report.page import Note, PagePicture, PageSection, PageTable, write_page
from mazeplan.apps.report.rigdiagnosis import navigation_table, rig_section
from mazeplan.core.palette import COLOURS
from mazeplan.core.records import Array
from mazeplan.diagnosis.excess import TOO_SELDOM, more_than_noise

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

VERDICTS = {
    "nothing_missing": "nothing is missing",
    "effect_found": "an effect was found",
    "ambiguous": "an effect was found, but this record fits another one, too",
    "unknown_effect": "something is there that has no name",
}
ANGLE = "theta, rad"  # label of an axis that shows the angle on the ring
SMALL = 0.05  # an effect with less than this share of the largest evidence is called small
WHEN = {"before": "bad", "after": "good"}  # styles
CANDIDATES = 10  # number of candidates in the picture
LONG = 34  # characters; a longer label of the y axis gets two lines
LEAST = 1.0  # gain at which a bar begins; a smaller gain has no bar


def write_diagnosis(document: dict[str, Any], evidence: dict[str, Any], path: Path) -> None:
    """Write the page of one diagnosis, as one file that loads nothing."""
    plain, shown = (from_json(to_json(part, inf_nan_mode="null")) for part in (document, evidence))
    section = diagnosis_section(Input("diagnosis", path.parent, evidence["title"], plain, shown))
    write_page(path, section.title, [section])


def diagnosis_section(given: Input) -> PageSection:
    """The section of a page about a diagnosis."""
    document, evidence = given.document, given.evidence
    if isinstance(document, RigDocument):
        return rig_section(given)
    parts: list[Any] = [_scores(document, evidence)]
    if document.effects:
        parts.append(_effects(document))
    parts += _experiments(document)
    if document.navigation is not None:
        parts.append(navigation_table(document.navigation))
    if evidence is not None:
        parts += diagnosis_pictures(document, evidence)
    else:
        text = "This command writes a folder with the evidence, which the page can show:"
        parts.append(Note(text, "mazeplan diagnose LOG -o FOLDER"))
    notes = (evidence.notes if evidence is not None else []) or document.notes
    name = given.name + (f", ring {document.ring}" if document.ring else "")
    title = (evidence.title if evidence is not None else "") or name
    facts = _facts(document)
    parts += [Note(words.sentence(note)) for note in notes]
    return PageSection(f"Diagnosis of {title}", lead(document, evidence), facts, parts)


def _label(evidence: EvidenceDocument | None, name: str) -> str:
    return labels(evidence).get(name, name)


def labels(evidence: EvidenceDocument | None) -> dict[str, str]:
    """{score: its words and its unit}. The evidence of a system without a ball has its own labels."""
    own = {} if evidence is None or "rollout40" in evidence.labels else evidence.labels
    return {**words.SCORES, **own}


def drawn(evidence: EvidenceDocument | None) -> str:
    """The score that the report shows."""
    return "rollout40" if evidence is None else evidence.drawn


def lead(document: RingDocument, evidence: EvidenceDocument | None) -> str:
    """The finding in words, without sizes, which are in the table below."""
    names = [_missing(document, effect) for effect in document.effects]
    found = " and ".join(part for part in (", ".join(names[:-1]), *names[-1:]) if part)
    change = _change(document, evidence)
    if document.verdict == "nothing_missing":
        if more_than_noise(document.before.get("rollout40", math.nan), document.noise_floor):
            text = f"Nothing that is missing was found, but more is left than noise would leave; {TOO_SELDOM}."
        else:
            text = "Nothing is missing: what is left is what noise alone would leave."
    elif document.verdict == "unknown_effect":
        also = f", besides {found}" if found else ""
        unknown = words.spoken(str((document.unknown or {}).get("description") or "its cause is not known"))
        text = f"Something is there that has no name{also}: {unknown}."
    else:
        text = f"The model lacks {found or 'nothing that has a name'}."
        for group in document.ambiguous_with if document.verdict == "ambiguous" else ():
            text += f" This record cannot tell {' from '.join(map(words.spoken, group))}."
    return f"{text} {change}".strip()


def _missing(document: RingDocument, effect: EffectEntry) -> str:
    """The name of an effect. Remarks say whether the old model had it with another size, and whether it is small."""
    had, remarks = document.declared.get(effect.name), []
    if isinstance(had, dict):
        remarks.append("known before, with " + ("another size" if any(had.values()) else "the size 0"))
    if effect.evidence < SMALL * max((e.evidence for e in document.effects if math.isfinite(e.evidence)), default=0.0):
        remarks.append("small")
    return words.spoken(effect.name) + (f" ({'; '.join(remarks)})" if remarks else "")


def _known_before(name: str, values: Any) -> str:
    """A declared effect with its sizes in SI units, as in files."""
    sizes = [f"{v:.3g}" for v in values.values() if isinstance(v, int | float)] if isinstance(values, dict) else []
    if set(sizes) == {"0"}:
        sizes = ["0"]
    return words.spoken(name) + (f" ({', '.join(sizes)})" if sizes else "")


def _change(document: RingDocument, evidence: EvidenceDocument | None) -> str:
    """The score that the report shows (`drawn`), before and after; empty if it is unknown."""
    name = drawn(evidence)
    label = _label(evidence, name)
    before, after = (words.labelled(scores.get(name, math.nan), label) for scores in (document.before, document.after))
    if not (math.isfinite(before) and math.isfinite(after)):
        return ""
    text, unit = words.split_unit(label)
    first = f"{text[:1].upper()}{text[1:]}: {before:.3g}{unit}"
    return f"{first}." if before == after else f"{first} before, {after:.3g}{unit} after."


def _facts(document: RingDocument) -> list[tuple[str, str]]:
    known = ", ".join(_known_before(*pair) for pair in document.declared.items())
    facts = {
        "verdict": VERDICTS.get(document.verdict, document.verdict),
        "ring": str(document.ring or ""),
        "track radius": f"{1e3 * document.radius_m:.2f} mm" if math.isfinite(document.radius_m) else "",
        "held out": f"{100.0 * document.held_out:.0f} % of the samples" if math.isfinite(document.held_out) else "",
        "known before (SI units)": known,
        "new model": document.model or "",
    }
    return [(name, value) for name, value in facts.items() if value]


# -- tables ------------------------------------------------------------------------------------------------------------


def _scores(document: RingDocument, evidence: EvidenceDocument | None) -> PageTable:
    columns = document.columns("before", "after")
    rows = [
        [words.relabelled(label), *(_cell(part.get(name, math.nan), label) for part in columns.values())]
        for name, label in labels(evidence).items() if any(name in part for part in columns.values())
    ]  # fmt: skip
    if math.isfinite(document.noise_floor):
        label = labels(evidence).get(drawn(evidence), "")
        text, unit = words.split_unit(label)
        name = f"{text} by noise alone{',' if unit else ''}{unit}"
        rows.append([name, *[""] * (len(columns) - 1), _cell(document.noise_floor, label)])
    return PageTable("On held-out samples", ("", *columns), rows)


def _cell(value: float, label: str) -> str:
    return words.number(words.labelled(value, label), 2 if label.endswith(", rad") else 4)


def _effects(document: RingDocument) -> PageTable:
    """A table with a row for each parameter, with the name that `--declare` takes."""
    rows = []
    for effect in document.effects:
        first = [words.spoken(effect.name), words.number(effect.evidence, 1)]
        for name, p in effect.parameters.items():
            size = words.measured(p.value, p.stderr, p.unit)
            rows.append([first[0], words.parameter(effect.name, name), size, first[1], f"{effect.name}.{name}"])
            first = ["", ""]
    head = ("effect", "parameter", "value ± standard error", "evidence", "name")
    title = "What was found; evidence: growth of -2 log L (misfit) without it"
    return PageTable(title, head, rows, code=frozenset({4}))


def _experiments(document: RingDocument) -> list[Note]:
    """A paragraph for each group of effects that the record cannot tell apart, with an experiment that can."""
    found = []
    for i, group in enumerate(document.ambiguous_with):
        text, command = f"Hard to tell apart in this record: {', '.join(map(words.spoken, group))}.", ""
        if i < len(document.separate_by):
            way = document.separate_by[i]
            text += f" {words.sentence(way['why'])}" if way.get("why") else ""
            text += f" What to do: {words.spoken(str(way['first']))}, then" if way.get("first") else ""
            text += f" ({words.spoken(str(way['note']))})" if way.get("note") else ""
            command = str(way.get("command") or "")
        found.append(Note(text, command))
    return found


# -- pictures ----------------------------------------------------------------------------------------------------------


def diagnosis_pictures(document: RingDocument, evidence: EvidenceDocument) -> list[PagePicture]:
    """The pictures for which there is evidence."""
    count = len(shown_candidates(evidence))
    found = [
        PagePicture(
            "candidates", "Candidates, each added by itself; and the error before and after",
            "by how much each candidate lowers the misfit; the error before and after",
            partial(_first, document=document, evidence=evidence), (9.4, 1.5 + 0.27 * max(count, 6)),
        )
    ]  # fmt: skip
    if evidence.before is not None and evidence.after is not None:
        found += [
            PagePicture(
                "residual", "Residual against position, speed and time; band: two standard errors",
                "mean residual against position, speed and time, before and after",
                partial(_residuals, evidence=evidence), (9.0, 3.2),
            ),
        ]  # fmt: skip
    return found


def shown_candidates(evidence: EvidenceDocument) -> list[CandidateEntry]:
    """The best candidates; the best placebo is always among them."""
    ranked = sorted(evidence.candidates, key=lambda c: -c.gain)
    best = ranked[:CANDIDATES]
    placebo = next((c for c in ranked if c.placebo), None)
    return best if placebo is None or placebo in best else [*best, placebo]


def explained_by(evidence: EvidenceDocument) -> str:
    """The axis (position, speed or time) against which the misfit fell most; empty if it fell against none."""
    names = ("position", "speed", "time")
    before, after = ({n: _misfit(getattr(part, n)) for n in names} for part in (evidence.before, evidence.after))
    falls = {name: before[name] - after[name] for name in names}
    best = max(falls, key=lambda name: falls[name])
    return best if falls[best] > 0.0 else ""


def _misfit(curve: dict[str, Array]) -> float:
    """Sum over bins of (mean / standard error)^2."""
    mean, stderr = curve["mean"], curve["stderr"]
    known = np.isfinite(mean) & (stderr > 0.0)
    return float(np.sum((mean[known] / stderr[known]) ** 2))


def _first(figure: Figure, document: RingDocument, evidence: EvidenceDocument) -> None:
    ranks, bars = panel_row(figure, (1.9, 1.0))
    shown, accept = shown_candidates(evidence)[::-1], evidence.accept
    if not shown:
        empty_panel(ranks, "nothing was tried")
    found = {effect.name: effect.evidence for effect in document.effects}
    for i, c in enumerate(shown):
        gain = max(c.gain, 0.0)
        name = "good" if c.name in found else "real" if c.named else "neutral"
        hatch = "" if name == "good" else "...." if c.placebo else "///" if name == "neutral" else ""
        style = {"color": COLOURS[name], "hatch": hatch, "edgecolor": "white", "linewidth": 0}
        ranks.barh(i, max(gain - LEAST, 0.0), left=LEAST, **style)
        text = f" {gain:.0f}"
        if name == "good":
            others = f" beside the others: {found[c.name]:.0f}" if gain < accept <= found[c.name] else ""
            text += f", found{others}"
        ranks.text(max(gain, LEAST), i, text, va="center", fontsize=7.5)
    ranks.set_yticks(range(len(shown)), [words.candidate(c.name) for c in shown], fontsize=8)
    ranks.set_ylim(-0.7, len(shown) - 0.4)
    _readable_log(ranks, LEAST, 2.5 * max([accept, *(c.gain for c in shown)]))
    ranks.axvline(accept, **line("bad", linewidth=1.0))
    ranks.text(accept, len(shown) - 0.4, f" {accept:g}: counts from here", fontsize=7.5, va="bottom")
    ranks.set_xlabel(
        "fall of the misfit (-2 log L) with it alone, penalty taken off; log scale\n"
        "hatched: has no name; dotted: placebo"
    )
    _bars(bars, document, evidence)


def _readable_log(axes: Axes, least: float, most: float) -> None:
    """A logarithmic axis with a line and a plain number at 1, 3, 10, 30 ..."""
    axes.set_xscale("log")
    axes.set_xlim(least, most)
    ticks = [m * 10.0**n for n in range(-3, 9) for m in (1.0, 3.0) if least <= m * 10.0**n <= most]
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.grid(axis="x")


def _bars(axes: Axes, document: RingDocument, evidence: EvidenceDocument) -> None:
    label, name = _label(evidence, evidence.drawn), evidence.drawn
    values = {"before": document.before.get(name, math.nan), "after": document.after.get(name, math.nan),
              "noise alone": document.noise_floor}  # fmt: skip
    shown = {when: words.labelled(value, label) for when, value in values.items() if math.isfinite(value)}
    if not shown:
        return empty_panel(axes, "no stretch is long enough")
    for i, (when, value) in enumerate(shown.items()):
        role = WHEN.get(when, "neutral")
        hatch = {"bad": "xxx", "neutral": "...."}.get(role, "")
        axes.bar(i, value, 0.65, color=COLOURS[role], hatch=hatch, edgecolor="white", linewidth=0)
        axes.text(i, value, f"{value:.3g}", ha="center", va="bottom", fontsize=8)
    axes.set_xticks(range(len(shown)), list(shown))
    text = words.relabelled(label)
    cut = text.rfind(" ", 0, LONG) if len(text) > LONG else -1
    axes.set_ylabel(text if cut < 0 else f"{text[:cut]}\n{text[cut + 1 :]}")
    axes.set_title("on held-out samples")
    axes.margins(y=0.12)
    return None


def _residuals(figure: Figure, evidence: EvidenceDocument) -> None:
    from matplotlib.ticker import MultipleLocator

    panels: Any = figure.subplots(1, 3, sharey=True)
    most = explained_by(evidence)
    for axes, name, label in zip(panels, ("position", "speed", "time"), (*evidence.axes[:2], "time, s"), strict=True):
        for when, role in WHEN.items():
            curve = getattr(getattr(evidence, when), name)
            at, mean, error = words.labelled(1.0, label) * np.asarray(curve["at"]), curve["mean"], curve["stderr"]
            if label == ANGLE:  # angles on the ring go from 0 to 360
                order = np.argsort(at % 360.0)
                at, mean, error = at[order] % 360.0, np.asarray(mean)[order], np.asarray(error)[order]
            axes.plot(at, mean, **line(role), label=when)
            axes.fill_between(at, mean - 2 * error, mean + 2 * error, color=COLOURS[role], alpha=0.22, lw=0)
        axes.axhline(0.0, color=INK, lw=0.6)
        axes.set_xlabel(words.relabelled(label) + ("\n(counted against the motion)" if name == "time" else ""))
        if label == ANGLE:
            axes.xaxis.set_major_locator(MultipleLocator(90))
        axes.grid()
        if name == most:
            axes.set_title("what was found explains most here")
            for side in axes.spines.values():
                side.set(visible=True, linewidth=1.4)
    panels[0].set_ylabel("mean residual,\nin standard deviations")
    legend_beside(panels[2])
