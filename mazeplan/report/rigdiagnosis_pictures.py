"""Pictures of the diagnosis of a whole rig. Each title says what one should see."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.maze.mapfile import check_text
from mazeplan.palette import COLOURS
from mazeplan.records import Array
from mazeplan.report import words
from mazeplan.report.drawing import INK, beside, darker, line, nothing, plan_view
from mazeplan.report.page import Picture
from mazeplan.report.rigdiagnosis import AS_FOUND, AS_WAS, Document, something_found

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WHEN = {"before": ("bad", AS_WAS), "after": ("good", AS_FOUND)}
HEALTHY = {"before": ("real", AS_WAS)}  # where nothing was found, nothing is bad
MOST = 0.98  # share of the sectors before that are within the colour scale
MM = 1e3
# of a spectrum: the mean of two axes exceeds p by noise alone with exp(-2 p) (1 + 2 p); of some 4000 frequencies one
# does so once in a hundred records
PEAK = 8.0


def rig_pictures(document: Document, evidence: Document) -> list[Picture]:
    """Those for which there is evidence."""
    found = [
        Picture(
            "error", _error_title(document, evidence), "error of the angle against the time ahead, before and after",
            lambda figure: _ahead(figure, document, evidence), (9.0, 3.2),
        ),
        Picture(
            "places", _places_title(document, evidence),
            "map of the plate with the error of the prediction, before and after",
            lambda figure: _places(figure, document, evidence), (9.4 if something_found(document) else 5.6, 4.4),
        ),
        Picture(
            "remains", _memory_title(document, evidence),
            "correlation of what remains from picture to picture, before and after",
            lambda figure: _memory(figure, document, evidence), (9.0, 3.0),
        ),
    ]  # fmt: skip
    if evidence["gain"]:
        better = sum(g > 0.0 for g in evidence["gain"])
        title = f"Does all of the record say so? {better} of {len(evidence['gain'])} blocks of " \
                f"{evidence['block_s']:g} s are likelier with the finding"  # fmt: skip
        found.insert(2, Picture("blocks", title, "gain of each block of time by what was found",
                                lambda figure: _blocks(figure, evidence), (9.0, 2.8)))  # fmt: skip
    if evidence.get("spectrum"):
        title = "What swings? A peak is a motion that the model does not know"
        found.append(Picture("spectrum", title, "spectrum of what was not expected, before and after",
                             lambda figure: _spectrum(figure, document, evidence), (9.0, 3.0)))  # fmt: skip
    return found


def _shown(document: Document) -> dict[str, tuple[str, str]]:
    """Before and after, each with colour and words; before alone, where nothing was found."""
    return WHEN if something_found(document) else HEALTHY


def _error_title(document: Document, evidence: Document) -> str:
    ends = [evidence["error"][when][-1] for when in _shown(document)]
    if len(ends) < 2 or None in ends:
        return "How far is the prediction off? The error grows with the time ahead"
    return f"How far is the prediction off? At the right end {words.DEG * ends[0]:.1f} degrees before, " \
           f"{words.DEG * ends[1]:.1f} after"  # fmt: skip


def _ahead(figure: Figure, document: Document, evidence: Document) -> None:
    (axes,) = beside(figure, (1.0,))
    t = np.array(evidence["ahead_s"], dtype=float)
    for when, (colour, told) in _shown(document).items():
        low, mean, high = (words.DEG * np.array(evidence[k][when], dtype=float) for k in ("low", "error", "quartile"))
        axes.fill_between(t, low, high, color=COLOURS[colour], alpha=0.15, linewidth=0.0, label=f"{told}: middle half")
        axes.plot(t, mean, **line(colour), label=f"{told}: mean")
    axes.set_xlabel("time ahead, s")
    axes.set_ylabel("error of the angle, deg")
    axes.set_xlim(0.0, t[-1] if len(t) else 1.0)
    axes.set_ylim(bottom=0.0)
    axes.legend(frameon=False, loc="upper left")


def _blocks(figure: Figure, evidence: Document) -> None:
    """-2 log L of a block falls by g: it is exp(g / 2) times likelier."""
    (axes,) = beside(figure, (1.0,))
    gain = np.array(evidence["gain"], dtype=float) / (2.0 * math.log(10.0))
    for good in (True, False):
        rows = (gain > 0.0) == good
        axes.bar(
            np.array(evidence["gain_t"], dtype=float)[rows], gain[rows], width=0.85 * evidence["block_s"],
            color=COLOURS["good" if good else "bad"], hatch="" if good else "xxx", edgecolor="white", linewidth=0.0,
        )  # fmt: skip
    axes.axhline(0.0, color=COLOURS["neutral"], linewidth=0.8)
    axes.set_xlabel("time, s")
    axes.set_ylabel("times likelier,\npowers of ten")


def _places_title(document: Document, evidence: Document) -> str:
    ahead = evidence["ahead_s"][evidence["places"]["ahead"] - 1]
    asked = f"Where is the prediction off, {ahead:.1f} s ahead? "
    if not something_found(document):
        return f"{asked}Light: far off; white: too few samples"
    mark = " The black outline is the place that was found." if evidence["marks"] else ""
    return f"{asked}Dark is good; white has too few samples.{mark}"


def _places(figure: Figure, document: Document, evidence: Document) -> None:
    shown, places = _shown(document), evidence["places"]
    panels = beside(figure, (1.0,) * len(shown))
    maze = check_text(evidence["map"]).maze
    if maze is None:
        for axes in panels:
            nothing(axes, "the map cannot be read")
        return
    values = {when: MM * np.array(places[when], dtype=float) for when in shown}
    known = values["before"][np.isfinite(values["before"])]
    most = float(np.quantile(known, MOST)) if known.size else 1.0
    drawn = None
    for axes, (when, (_, told)) in zip(panels, shown.items(), strict=True):
        plan_view(axes, maze, np.zeros((0, 2)), labels=False)
        drawn = _sectors(axes, places["rings"], values[when], max(most, 0.1))
        for mark in evidence["marks"]:
            _mark(axes, mark)
        axes.set_title(told, fontsize=9)
    if drawn is not None:
        bar = figure.colorbar(drawn, ax=panels, shrink=0.8, extend="max")
        bar.set_label("error along the ring, mm")


def _sectors(axes: Axes, rings: list[list[float]], values: Array, most: float) -> Any:
    """Sectors of the rings, each in the colour of its value, mm; behind the walls."""
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Wedge

    patches, each = [], 360.0 / values.shape[1]
    for inner, outer in rings:
        for i in range(values.shape[1]):
            start = -180.0 + i * each
            patches.append(Wedge((0.0, 0.0), MM * outer, start, start + each, width=MM * (outer - inner)))
    good = np.isfinite(values.ravel())
    drawn = PatchCollection([p for p, keep in zip(patches, good, strict=True) if keep], cmap=darker(), zorder=1.5)
    drawn.set_array(values.ravel()[good])
    drawn.set_clim(0.0, most)
    return axes.add_collection(drawn)


def _mark(axes: Axes, mark: Document) -> None:
    """A circle around a spot; a frame around a sector; a line across a ring at a threshold."""
    style: dict[str, Any] = {"color": INK, "linewidth": 1.8, "zorder": 6, "clip_on": False}
    if "x" in mark:
        turn = np.linspace(0.0, 2.0 * math.pi, 60)
        size = MM * mark["width"]
        axes.plot(MM * mark["x"] + size * np.cos(turn), MM * mark["y"] + size * np.sin(turn), **style)
        return
    inner, outer, half = MM * mark["inner"], MM * mark["outer"], mark.get("half", 0.0)
    arc = np.linspace(mark["centre"] - half, mark["centre"] + half, 40)
    angle, radius = np.r_[arc, arc[::-1], arc[:1]], np.r_[np.full(40, inner), np.full(40, outer), inner]
    axes.plot(radius * np.cos(angle), radius * np.sin(angle), **style)


def _memory_title(document: Document, evidence: Document) -> str:
    when = "after" if something_found(document) else "before"
    most = max((abs(v) for v in evidence["correlation"][when][:3] if v is not None), default=0.0)
    limit = evidence["alike_from"]
    if most < limit:
        return f"Is what remains like noise? Yes: pictures that follow one another are alike by less than {limit:.2g}"
    return f"Is what remains like noise? No: pictures that follow one another are alike by {most:.2f}"


def _memory(figure: Figure, document: Document, evidence: Document) -> None:
    (axes,) = beside(figure, (1.0,))
    white, limit, top = float(evidence["white"]), float(evidence["alike_from"]), 0.0
    axes.axhspan(-white, white, color=COLOURS["neutral"], alpha=0.25, label="noise alone, 95 %", linewidth=0.0)
    for when, (colour, told) in _shown(document).items():
        values = np.array(evidence["correlation"][when], dtype=float)
        axes.plot(np.arange(1, len(values) + 1), values, marker="o", markersize=4, **line(colour), label=told)
        top = max(top, float(np.nanmax(np.abs(values), initial=0.0)))
    for side, told in ((-limit, None), (limit, "counts from here on")):
        axes.axhline(side, color=COLOURS["neutral"], linewidth=0.8, linestyle=":", label=told)
    axes.set_ylim(-1.3 * max(limit, top), 1.7 * max(limit, top))
    axes.set_xlabel("pictures later")
    axes.set_ylabel("correlation")
    axes.legend(frameon=False, loc="upper right", ncols=4)


def _spectrum(figure: Figure, document: Document, evidence: Document) -> None:
    (axes,) = beside(figure, (1.0,))
    spectrum = evidence["spectrum"]
    hz = np.array(spectrum["hz"], dtype=float)
    for when, (colour, told) in _shown(document).items():
        axes.plot(hz, np.array(spectrum[when], dtype=float), **line(colour, linewidth=1.1), label=told)
    axes.axhline(PEAK, color=COLOURS["neutral"], linewidth=0.8, linestyle=":", label="noise alone is seldom higher")
    axes.set_yscale("log")
    axes.set_xlabel("frequency, Hz")
    axes.set_ylabel("power, times that of noise")
    axes.legend(frameon=False, loc="upper right")
