"""The diagnosis of a whole rig: what is wrong with it, and what to do, in this order; then why we think so."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.maze.mapfile import check_text
from mazeplan.palette import COLOURS
from mazeplan.physics.registry import EFFECTS
from mazeplan.report import words
from mazeplan.report.drawing import beside, darker, line, nothing, plan_view
from mazeplan.report.inputs import Input
from mazeplan.report.page import Note, Picture, Section, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Document = dict[str, Any]
WHEN = {"before": ("bad", "with the model as it was"), "after": ("good", "with what was found")}
VERDICTS = {
    "nothing_missing": "the rig is as its model says",
    "effect_found": "the cause was found",
    "ambiguous": "a cause was found, but not told apart from another",
    "unknown_effect": "something has no name",
}
MOST_LEFT = 2.5  # standard deviations, the end of the colour scale


def is_rig(given: Input) -> bool:
    """Whether a diagnosis is one of a whole rig."""
    return "reference" in given.document and "advice" in given.document


def rig_section(given: Input) -> Section:
    """Everything about it."""
    document, evidence = given.document, given.evidence
    parts: list[Any] = [Note(text) for text in document["advice"]]
    if document.get("effects"):
        parts.append(_effects(document))
    parts.append(_errors(document))
    if evidence is not None:
        parts += _pictures(document, evidence)
    parts += [Note(words.sentence(note)) for note in document.get("notes", [])]
    title = evidence["title"] if evidence is not None else given.name
    return Section(f"Diagnosis of {title}", str(document["sentence"]), _facts(document), parts)


def _facts(document: Document) -> list[tuple[str, str]]:
    facts = [("verdict", VERDICTS.get(document["verdict"], str(document["verdict"])))]
    if isinstance(document.get("remaining"), int | float):
        facts.append(("what remains", f"{document['remaining']:.1f} times the noise of the camera"))
    facts.append(("compared with", str(document["reference"])))
    if isinstance(document.get("model"), str):
        facts.append(("new model", document["model"]))
    return facts


def _effects(document: Document) -> Table:
    """A row a number: what it was, and what it is."""
    rows = []
    for effect in document["effects"]:
        rings, before = ", ".join(sorted(effect.get("rings", {}))), effect.get("known_before", {})
        planned = "yes" if effect.get("planned", True) else f"no: {effect.get('why_not', '')}"
        for i, (name, p) in enumerate(effect["parameters"].items()):
            unit = str(p.get("unit", "1"))
            had = isinstance(before.get(name), int | float) and name not in _where(effect["name"])
            old = words.measured(before[name] + 0.0, None, unit) if had else ""
            told = [words.spoken(effect["name"]), rings, planned] if i == 0 else ["", "", ""]
            size = words.measured(p["value"], p.get("stderr"), unit)
            rows.append([told[0], words.parameter(effect["name"], name), old, size, told[1], told[2]])
    head = ("effect", "what of it", "before", "in this record ± standard error", "rings", "used by plans")
    return Table("What differs; sizes are those of the first ring, where rings differ", head, rows)


def _where(name: str) -> tuple[str, ...]:
    """Parameters of an effect that say where it is, which it was not before."""
    return EFFECTS[name].places if name in EFFECTS else ()


def _errors(document: Document) -> Table:
    test = document.get("test") or {}
    columns = [("with the model as it was", document["before"]), ("with what was found", document["after"])]
    columns += [(f"{WHEN[w][1]}, further record", test[w]) for w in ("before", "after") if w in test]
    rows = [
        [f"error of the angle {ahead} samples ahead, rad",
         *(words.number(float("nan") if (v := part.get(f"rollout{ahead}")) is None else v, 3) for _, part in columns)]
        for ahead in (20, 40)
    ]  # fmt: skip
    head = ("", *(name for name, _ in columns))
    return Table("How well the ball is predicted, on parts that took no part in the fit", head, rows)


def _pictures(document: Document, evidence: Document) -> list[Picture]:
    found = [
        Picture(
            "error", "The prediction: how far the angle is off, the further one looks ahead",
            "error of the angle against the time ahead, before and after",
            lambda figure: _ahead(figure, document, evidence), (9.0, 3.2),
        ),
        Picture(
            "places", "Where the ball did not do what was expected: dark is like noise",
            "map of the plate with the size of what was not expected, before and after",
            lambda figure: _places(figure, document, evidence), (9.4, 4.4),
        ),
        Picture(
            "remains", "Whether what remains is noise: noise has no memory from picture to picture",
            "correlation of what remains from picture to picture, before and after",
            lambda figure: _memory(figure, document, evidence), (9.0, 3.0),
        ),
    ]  # fmt: skip
    if evidence["gain"]:
        found.insert(1, Picture(
            "blocks", "Whether all of the record says so: bars upwards are blocks that the finding explains better",
            "gain of each block of time by what was found",
            lambda figure: _blocks(figure, evidence), (9.0, 2.8),
        ))  # fmt: skip
    return found


def _shown(document: Document) -> list[str]:
    """Before alone, where nothing was found."""
    found = document.get("effects") or document.get("unknown")
    return ["before", "after"] if found else ["before"]


def _ahead(figure: Figure, document: Document, evidence: Document) -> None:
    (axes,) = beside(figure, (1.0,))
    t = np.array(evidence["ahead_s"], dtype=float)
    for when in _shown(document):
        colour, told = WHEN[when]
        mean = np.array(evidence["error"][when], dtype=float)
        axes.plot(t, mean, **line(colour), label=f"{told}: mean")
        high = np.array(evidence["quartile"][when], dtype=float)
        axes.plot(t, high, color=COLOURS[colour], linewidth=0.7, alpha=0.6, label="three of four are below")
    axes.set_xlabel("time ahead, s")
    axes.set_ylabel("error of the angle, rad")
    axes.set_ylim(bottom=0.0)
    axes.legend(frameon=False)


def _blocks(figure: Figure, evidence: Document) -> None:
    (axes,) = beside(figure, (1.0,))
    gain = np.array(evidence["gain"], dtype=float)
    t = evidence["block_s"] * (np.arange(len(gain)) + 0.5)
    colours = [COLOURS["good" if g > 0.0 else "bad"] for g in gain]
    axes.bar(t, gain, width=0.85 * evidence["block_s"], color=colours)
    axes.axhline(0.0, color=COLOURS["neutral"], linewidth=0.8)
    axes.set_xlabel("time, s (pictures only)")
    axes.set_ylabel("gain in misfit")


def _places(figure: Figure, document: Document, evidence: Document) -> None:
    shown = _shown(document)
    panels = beside(figure, (1.0,) * len(shown))
    maze = check_text(evidence["map"]).maze
    if maze is None:
        for axes in panels:
            nothing(axes, "the map cannot be read")
        return
    reach, drawn = 1e3 * evidence["reach"], None
    for axes, when in zip(panels, shown, strict=True):
        left = np.array([[np.nan if v is None else v for v in row] for row in evidence["left"][when]])
        plan_view(axes, maze, np.zeros((0, 2)), labels=False)
        drawn = axes.imshow(
            left, origin="lower", extent=(-reach, reach, -reach, reach), vmin=0.7, vmax=MOST_LEFT, cmap=darker(),
            interpolation="nearest", zorder=20, alpha=0.85,
        )  # fmt: skip
        axes.set_title(WHEN[when][1], fontsize=9)
    if drawn is not None:
        bar = figure.colorbar(drawn, ax=panels, shrink=0.8)
        bar.set_label("unexpected, in standard deviations")


def _memory(figure: Figure, document: Document, evidence: Document) -> None:
    (axes,) = beside(figure, (1.0,))
    white = float(evidence["white"])
    axes.axhspan(-white, white, color=COLOURS["neutral"], alpha=0.25, label="noise alone, 95 %", linewidth=0.0)
    for when in _shown(document):
        colour, told = WHEN[when]
        values = np.array(evidence["correlation"][when], dtype=float)
        axes.plot(np.arange(1, len(values) + 1), values, marker="o", markersize=4, **line(colour), label=told)
    axes.set_xlabel("pictures later")
    axes.set_ylabel("correlation")
    axes.legend(frameon=False)
