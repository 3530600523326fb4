"""The report of a whole rig's diagnosis. First it says what is wrong, then what to do, then it shows the evidence."""

from __future__ import annotations

import math
import re
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.apps.report import words
from mazeplan.apps.report.drawing import INK, darker, empty_panel, line, panel_row, plan_view, sector_map
from mazeplan.apps.report.inputs import Input, number, row
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
COMMAND = re.compile(r":\s+(mazeplan .+?)\.?$")  # a command at the end of an advice
SMALL_UNITS = {"m": (1e3, "mm"), "s": (1e3, "ms")}  # {unit in the document: (factor, unit in the table)}
MOST = 0.98  # share of the sectors that the colour scale covers, with the model as it was
MM = 1e3


def rig_section(given: Input) -> PageSection:
    """The section of a page about the diagnosis of a whole rig."""
    document, evidence = given.document, given.evidence
    parts: list[Any] = []
    if document["advice"]:
        parts.append(Steps("What to do", [_step(text) for text in document["advice"]]))
    if document.get("effects"):
        parts.append(_effects(document["effects"]))
    parts.append(_errors(document))
    if document.get("navigation") is not None:
        parts.append(navigation_table(document["navigation"]))
    if evidence is not None:
        parts += _pictures(document, evidence)
    else:
        text = "This command writes a folder with the pictures behind this verdict:"
        parts.append(Note(text, "mazeplan diagnose LOG --reference LOG --model MODEL -o FOLDER"))
    parts.append(_remaining(document, evidence or {}))
    parts += [Note(words.sentence(note)) for note in document.get("notes") or ()]
    title = given.name if evidence is None else evidence["title"]
    facts = [("verdict", words.spoken(str(document["verdict"]))), ("compared with", str(document["reference"]))]
    facts += [("new model", document["model"])] if document.get("model") else []
    return PageSection(f"Diagnosis of {title}", str(document["sentence"]), facts, parts)


def _found(document: dict[str, Any]) -> bool:
    """Whether the diagnosis found an effect, so that the scores after differ from those before."""
    return bool(document.get("effects") or document.get("unknown"))


def score_columns(document: dict[str, Any], before: str, after: str) -> dict[str, dict[str, Any]]:
    """{heading of a column: scores}. Has more columns if the document has scores on a further record."""
    further = document.get("test") or {}
    found = {before: document.get("before") or {}, after: document.get("after") or {}}
    for heading, key in ((before, "before"), (after, "after")):
        if further.get(key):
            found[f"{heading}, further record"] = further[key]
    return found


def _step(advice: str) -> Note:
    """An advice as a step, with its command apart from the text."""
    found = COMMAND.search(advice)
    return Note(advice) if found is None else Note(f"{advice[: found.start()]}:", found[1])


# -- tables ------------------------------------------------------------------------------------------------------------


def navigation_table(navigation: dict[str, Any]) -> PageTable:
    """The table of the runs of `improve` with the old model and with the new model."""
    rows = []
    for when in ("before", "after"):
        runs = navigation[when]
        times = (words.seconds(number(runs["time_s"].get(name))) for name in ("mean", "best", "worst"))
        rows.append([when, f"{runs['success']} of {runs['runs']}", *times])
    return PageTable(
        "Navigations with the old model and with the new one", ("", "arrived", "mean", "best", "worst"), rows
    )


def _effects(effects: list[dict[str, Any]]) -> PageTable:
    """A table with a row for each parameter: its old size and its new size."""
    rows = []
    for effect in effects:
        name, planned = effect["name"], effect.get("planned", True)
        where = EFFECTS[name].places if name in EFFECTS else ()
        first = [
            words.spoken(name),
            ", ".join(effect.get("rings", ())),
            "yes" if planned else f"no: {effect['why_not']}",
        ]
        for key, p in effect["parameters"].items():
            factor, unit = SMALL_UNITS.get(p["unit"], (1.0, p["unit"]))
            old, error = number(effect.get("known_before", {}).get(key)), factor * number(p.get("stderr"))
            before = words.MISSING
            if math.isfinite(old) and key not in where:
                before = words.measured(factor * old + 0.0, error, unit, show_error=False)
            size = words.measured(factor * p["value"], error, unit)
            rows.append([first[0], words.parameter(name, key), before, size, *first[1:]])
            first = ["", "", ""]
    head = ("effect", "parameter", "before", "in this record ± standard error", "rings", "used by plans")
    return PageTable("What differs; sizes are those of the ring that is named first", head, rows)


def _errors(document: dict[str, Any]) -> PageTable:
    """The table of prediction errors. Without a finding it has only the column with the model as it was."""
    columns = score_columns(document, AS_WAS, AS_FOUND)
    if not _found(document):
        del columns[AS_FOUND]
    rows = [
        [f"error of the angle {seconds} s ahead, degrees",
         *(words.number(DEG * number(part.get(f"rollout{ahead}")), 1) for part in columns.values())]
        for ahead, seconds in ((20, 0.7), (40, 1.3))
    ]  # fmt: skip
    return PageTable("Mean error of the prediction, on parts that took no part in the fit", ("", *columns), rows)


def _remaining(document: dict[str, Any], evidence: dict[str, Any]) -> PageTable:
    """The table of the residual: in this record, and when the model was right."""
    then = (evidence.get("remaining") or {}).get("then")
    now = "in this record, with what was found" if _found(document) else "in this record"
    rows = [[now, words.number(number(document.get("remaining")), 2)]]
    rows.append(["when the model was right", words.number(number(then or None), 2)])
    return PageTable("What remains, in times the noise of the camera (1: noise alone)", ("", "times the noise"), rows)


# -- pictures; each title says what to look for ------------------------------------------------------------------------


def _pictures(document: dict[str, Any], evidence: dict[str, Any]) -> list[PagePicture]:
    """The pictures for which there is evidence."""
    shown = WHEN if _found(document) else HEALTHY
    error = "How far is the prediction off? The error grows with the time ahead"
    found = [
        PagePicture(
            "error", error, "error of the angle against the time ahead, before and after",
            partial(_ahead, evidence=evidence, shown=shown), (9.0, 3.2),
        )
    ]  # fmt: skip
    places = evidence["places"]
    if np.isfinite(row(places["before"])).any():
        title = f"Where is the prediction off, {evidence['ahead_s'][places['ahead'] - 1]:.1f} s ahead? "
        title += "Light: far off; white: too few samples."
        if evidence["marks"] and len(shown) > 1:
            title += " The black outline is the place that was found."
        found.append(
            PagePicture(
                "places", title, "map of the plate with the error of the prediction, before and after",
                partial(_places, evidence=evidence, shown=shown), (9.4 if len(shown) > 1 else 5.6, 4.4),
            )
        )  # fmt: skip
    return found


Shown = dict[str, tuple[str, str]]  # {before or after: (style, words)}


def _ahead(figure: Figure, evidence: dict[str, Any], shown: Shown) -> None:
    (axes,) = panel_row(figure, (1.0,))
    t = row(evidence["ahead_s"])
    for when, (style, text) in shown.items():
        low, mean, high = (DEG * row(evidence[part][when]) for part in ("low", "error", "high"))
        axes.fill_between(t, low, high, color=COLOURS[style], alpha=0.15, linewidth=0.0, label=f"{text}: four of five")
        axes.plot(t, mean, **line(style), label=f"{text}: mean")
    axes.set_xlabel("time ahead, s")
    axes.set_ylabel("error of the angle, degrees")
    axes.set_xlim(0.0, t[-1] if len(t) else 1.0)
    axes.set_ylim(bottom=0.0)
    axes.legend(frameon=False, loc="upper left")


def _places(figure: Figure, evidence: dict[str, Any], shown: Shown) -> None:
    panels, places = panel_row(figure, (1.0,) * len(shown)), evidence["places"]
    maze = check_text(evidence["map"]).maze
    if maze is None:
        for axes in panels:
            empty_panel(axes, "the map cannot be read")
        return
    before = row(places["before"])
    known = MM * before[np.isfinite(before)]
    most = max(float(np.quantile(known, MOST)) if known.size else 1.0, 0.1)
    drawn: Any = None
    for axes, (when, (_, text)) in zip(panels, shown.items(), strict=True):
        plan_view(axes, maze, np.zeros((0, 2)), labels=False)
        for angle in range(0, 360, 45):
            x, y = (1.09 * MM * maze.rings[0].outer_radius * f(math.radians(angle)) for f in (math.cos, math.sin))
            axes.text(x, y, f"{angle}°", ha="center", va="center", fontsize=7, color=INK)
        drawn = sector_map(axes, places["rings"], list(MM * row(places[when])), -180.0, most, darker())
        for mark in evidence["marks"]:
            _mark(axes, mark)
        axes.set_title(text, fontsize=9, pad=12.0)  # above the 90°
    bar = figure.colorbar(drawn, ax=panels, shrink=0.8, extend="max")
    bar.set_label("error along the ring, mm")


def _mark(axes: Axes, mark: dict[str, Any]) -> None:
    """Draw a circle around a spot, or a frame around a sector. For half = 0 the frame is a line across the ring."""
    if mark.get("x") is not None:
        turn = np.linspace(0.0, 2.0 * math.pi, 60)
        x, y = mark["x"] + mark["width"] * np.cos(turn), mark["y"] + mark["width"] * np.sin(turn)
    else:
        arc = mark["centre"] + (mark.get("half") or 0.0) * np.linspace(-1.0, 1.0, 40)
        angle = np.r_[arc, arc[::-1], arc[:1]]
        radius = np.r_[np.full(40, mark["inner"]), np.full(40, mark["outer"]), mark["inner"]]
        x, y = radius * np.cos(angle), radius * np.sin(angle)
    axes.plot(MM * x, MM * y, color=INK, linewidth=1.8, zorder=6, clip_on=False)
