"""The report of a whole rig's diagnosis. First it says what is wrong, then what to do, then it shows the evidence."""

from __future__ import annotations

import math
import re
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.apps.report import words
from mazeplan.apps.report.diagnosis_documents import NavigationChange, PlaceMark, RigDocument, RigEvidenceDocument
from mazeplan.apps.report.drawing import INK, darker, empty_panel, line, panel_row, plan_view, sector_map
from mazeplan.apps.report.inputs import Input
from mazeplan.apps.report.page import Note, PagePicture, PageSection, PageTable, Steps
from mazeplan.apps.report.words import DEG
from mazeplan.core.palette import COLOURS
from mazeplan.maze.mapfile import check_text
from mazeplan.physics.registry import EFFECTS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

AS_WAS, AS_FOUND = "with the model as it was", "with what was found"
WHEN = {"before": ("bad", AS_WAS), "after": ("good", AS_FOUND)}
HEALTHY = {"before": ("real", AS_WAS)}  # style if the diagnosis found nothing
VERDICTS = {
    "nothing_missing": "the rig is as its model says",
    "effect_found": "a cause was found",
    "ambiguous": "a cause was found, but this record fits another one, too",
    "unknown_effect": "something is there that has no name",
}
COMMAND = re.compile(r":\s+(mazeplan .+?)\.?$")  # a command at the end of an advice
SMALL_UNITS = {"m": (1e3, "mm"), "s": (1e3, "ms")}  # {unit in the document: (factor, unit in the table)}
MOST = 0.98  # share of the sectors that the colour scale covers, with the model as it was
MM = 1e3


def rig_section(given: Input) -> PageSection:
    """The section of a page about the diagnosis of a whole rig."""
    document, evidence = given.document, given.evidence
    parts: list[Any] = []
    if document.advice:
        parts.append(Steps("What to do", [_step(text) for text in document.advice]))
    if document.effects:
        parts.append(_effects(document))
    parts.append(_errors(document))
    if document.navigation is not None:
        parts.append(navigation_table(document.navigation))
    if evidence is not None:
        parts += rig_pictures(document, evidence)
    else:
        text = "This command writes a folder with the pictures behind this verdict:"
        parts.append(Note(text, "mazeplan diagnose LOG --reference LOG --model MODEL -o FOLDER"))
    parts.append(_remaining(document, evidence))
    parts += [Note(words.sentence(note)) for note in document.notes]
    title = evidence.title if evidence is not None else given.name
    facts = [
        ("verdict", VERDICTS.get(document.verdict, document.verdict)), ("compared with", document.reference),
        ("tested on", "each half of the record, predicted by a fit to the other"),
        *([("new model", document.model)] if document.model else []),
    ]  # fmt: skip
    return PageSection(f"Diagnosis of {title}", document.sentence, facts, parts)


def _step(advice: str) -> Note:
    """An advice as a step, with its command apart from the text."""
    found = COMMAND.search(advice)
    return Note(advice) if found is None else Note(f"{advice[: found.start()]}:", found[1])


# -- tables ------------------------------------------------------------------------------------------------------------


def navigation_table(navigation: NavigationChange) -> PageTable:
    """The table of the runs of `improve` with the old model and with the new model."""
    rows = []
    for when in ("before", "after"):
        runs = getattr(navigation, when)
        times = (words.seconds(runs.time_s.get(name, math.nan)) for name in ("mean", "best", "worst"))
        rows.append([when, f"{runs.success} of {runs.runs}", *times])
    return PageTable(
        "Navigations with the old model and with the new one", ("", "arrived", "mean", "best", "worst"), rows
    )


def _effects(document: RigDocument) -> PageTable:
    """A table with a row for each parameter: its old size and its new size."""
    rows = []
    for effect in document.effects:
        where = EFFECTS[effect.name].places if effect.name in EFFECTS else ()
        first = [
            words.spoken(effect.name),
            ", ".join(effect.rings),
            "yes" if effect.planned else f"no: {effect.why_not}",
        ]
        for name, p in effect.parameters.items():
            factor, unit = SMALL_UNITS.get(p.unit, (1.0, p.unit))
            old = effect.known_before.get(name, math.nan)
            before = words.MISSING
            if math.isfinite(old) and name not in where:
                before = words.measured(factor * old + 0.0, factor * p.stderr, unit, show_error=False)
            size = words.measured(factor * p.value, factor * p.stderr, unit)
            rows.append([first[0], words.parameter(effect.name, name), before, size, *first[1:]])
            first = ["", "", ""]
    head = ("effect", "parameter", "before", "in this record ± standard error", "rings", "used by plans")
    return PageTable("What differs; sizes are those of the ring that is named first", head, rows)


def _errors(document: RigDocument) -> PageTable:
    """The table of prediction errors. Without a finding it has only the column with the model as it was."""
    columns = document.columns(AS_WAS, AS_FOUND)
    if not document.something_found:
        del columns[AS_FOUND]
    rows = [
        [f"error of the angle {seconds} s ahead, degrees",
         *(words.number(DEG * part.get(f"rollout{ahead}", math.nan), 1) for part in columns.values())]
        for ahead, seconds in ((20, 0.7), (40, 1.3))
    ]  # fmt: skip
    return PageTable("Mean error of the prediction, on parts that took no part in the fit", ("", *columns), rows)


def _remaining(document: RigDocument, evidence: RigEvidenceDocument | None) -> PageTable:
    """The table of the residual: in this record, and when the model was right."""
    then = evidence.remaining.get("then") if evidence is not None else None
    now = "in this record, with what was found" if document.something_found else "in this record"
    rows = [[now, words.number(document.remaining, 2)], ["when the model was right", words.number(then or math.nan, 2)]]
    return PageTable("What remains, in times the noise of the camera (1: noise alone)", ("", "times the noise"), rows)


# -- pictures; each title says what to look for ------------------------------------------------------------------------


def rig_pictures(document: RigDocument, evidence: RigEvidenceDocument) -> list[PagePicture]:
    """The pictures for which there is evidence."""
    shown = WHEN if document.something_found else HEALTHY
    found = [
        PagePicture(
            "error", _error_title(evidence, shown), "error of the angle against the time ahead, before and after",
            partial(_ahead, evidence=evidence, shown=shown), (9.0, 3.2),
        )
    ]  # fmt: skip
    if np.isfinite(evidence.places.before).any():
        found.append(
            PagePicture(
                "places", _places_title(evidence, shown),
                "map of the plate with the error of the prediction, before and after",
                partial(_places, evidence=evidence, shown=shown), (9.4 if len(shown) > 1 else 5.6, 4.4),
            )
        )  # fmt: skip
    return found


Shown = dict[str, tuple[str, str]]  # {before or after: (style, words)}


def _error_title(evidence: RigEvidenceDocument, shown: Shown) -> str:
    before, after = (
        DEG * part[-1] if len(part) else math.nan for part in (evidence.error["before"], evidence.error["after"])
    )
    if len(shown) < 2 or not math.isfinite(before + after):
        return "How far is the prediction off? The error grows with the time ahead"
    return f"How far is the prediction off? At the right end {before:.1f} degrees before, {after:.1f} after"


def _ahead(figure: Figure, evidence: RigEvidenceDocument, shown: Shown) -> None:
    (axes,) = panel_row(figure, (1.0,))
    t = evidence.ahead_s
    for when, (style, text) in shown.items():
        low, mean, high = (DEG * part[when] for part in (evidence.low, evidence.error, evidence.high))
        axes.fill_between(t, low, high, color=COLOURS[style], alpha=0.15, linewidth=0.0, label=f"{text}: four of five")
        axes.plot(t, mean, **line(style), label=f"{text}: mean")
    axes.set_xlabel("time ahead, s")
    axes.set_ylabel("error of the angle, degrees")
    axes.set_xlim(0.0, t[-1] if len(t) else 1.0)
    axes.set_ylim(bottom=0.0)
    axes.legend(frameon=False, loc="upper left")


def _places_title(evidence: RigEvidenceDocument, shown: Shown) -> str:
    asked = f"Where is the prediction off, {evidence.ahead_s[evidence.places.ahead - 1]:.1f} s ahead? "
    if len(shown) < 2:
        return f"{asked}Light: far off; white: too few samples"
    mark = " The black outline is the place that was found." if evidence.marks else ""
    return f"{asked}Dark is good; white has too few samples.{mark}"


def _places(figure: Figure, evidence: RigEvidenceDocument, shown: Shown) -> None:
    panels, places = panel_row(figure, (1.0,) * len(shown)), evidence.places
    maze = check_text(evidence.map).maze
    if maze is None:
        for axes in panels:
            empty_panel(axes, "the map cannot be read")
        return
    known = MM * places.before[np.isfinite(places.before)]
    most = max(float(np.quantile(known, MOST)) if known.size else 1.0, 0.1)
    rings = [(inner, outer) for inner, outer in places.rings]
    drawn: Any = None
    for axes, (when, (_, text)) in zip(panels, shown.items(), strict=True):
        plan_view(axes, maze, np.zeros((0, 2)), labels=False)
        for angle in range(0, 360, 45):
            x, y = (1.09 * MM * maze.rings[0].outer_radius * f(math.radians(angle)) for f in (math.cos, math.sin))
            axes.text(x, y, f"{angle}°", ha="center", va="center", fontsize=7, color=INK)
        drawn = sector_map(axes, rings, list(MM * getattr(places, when)), -180.0, most, darker())
        for mark in evidence.marks:
            _mark(axes, mark)
        axes.set_title(text, fontsize=9, pad=12.0)  # above the 90°
    bar = figure.colorbar(drawn, ax=panels, shrink=0.8, extend="max")
    bar.set_label("error along the ring, mm")


def _mark(axes: Axes, mark: PlaceMark) -> None:
    """Draw a circle around a spot, or a frame around a sector. For half = 0 the frame is a line across the ring."""
    if math.isfinite(mark.x):
        turn = np.linspace(0.0, 2.0 * math.pi, 60)
        x, y = mark.x + mark.width * np.cos(turn), mark.y + mark.width * np.sin(turn)
    else:
        arc = mark.centre + mark.half * np.linspace(-1.0, 1.0, 40)
        angle = np.r_[arc, arc[::-1], arc[:1]]
        radius = np.r_[np.full(40, mark.inner), np.full(40, mark.outer), mark.inner]
        x, y = radius * np.cos(angle), radius * np.sin(angle)
    axes.plot(MM * x, MM * y, color=INK, linewidth=1.8, zorder=6, clip_on=False)
