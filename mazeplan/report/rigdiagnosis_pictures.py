"""Pictures of the diagnosis of a whole rig. Each title says what one should see."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.maze.mapfile import check_text
from mazeplan.palette import COLOURS
from mazeplan.report import words
from mazeplan.report.drawing import INK, beside, darker, line, nothing, plan_view
from mazeplan.report.page import Picture
from mazeplan.report.rigdiagnosis import AS_FOUND, AS_WAS, Document, something_found

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WHEN = {"before": ("bad", AS_WAS), "after": ("good", AS_FOUND)}
LEAST_LEFT, MOST_LEFT = 0.5, 2.5  # standard deviations, the ends of the colour scale
MM = 1e3
PEAK = 12.0  # of a spectrum; noise alone is higher once in some dozen records


def rig_pictures(document: Document, evidence: Document) -> list[Picture]:
    """Those for which there is evidence."""
    found = [
        Picture(
            "error", _error_title(document, evidence), "error of the angle against the time ahead, before and after",
            lambda figure: _ahead(figure, document, evidence), (9.0, 3.2),
        ),
        Picture(
            "places", _places_title(document, evidence),
            "map of the plate with the size of what was not expected, before and after",
            lambda figure: _places(figure, document, evidence), (9.4, 4.4),
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


def _shown(document: Document) -> list[str]:
    """Before alone, where nothing was found."""
    return ["before", "after"] if something_found(document) else ["before"]


def _error_title(document: Document, evidence: Document) -> str:
    ends = [evidence["error"][when][-1] for when in _shown(document)]
    if len(ends) < 2 or None in ends:
        return "How far is the prediction off? The error grows with the time ahead"
    return f"How far is the prediction off? At the right end {words.DEG * ends[0]:.1f} degrees before, " \
           f"{words.DEG * ends[1]:.1f} after"  # fmt: skip


def _ahead(figure: Figure, document: Document, evidence: Document) -> None:
    (axes,) = beside(figure, (1.0,))
    t = np.array(evidence["ahead_s"], dtype=float)
    for when in _shown(document):
        colour, told = WHEN[when]
        low, mean, high = (words.DEG * np.array(evidence[k][when], dtype=float) for k in ("low", "error", "quartile"))
        axes.fill_between(t, low, high, color=COLOURS[colour], alpha=0.15, linewidth=0.0, label="middle half of them")
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
    if not something_found(document):
        return "Where did the ball surprise the model? Dark is as noise"
    mark = " A circle or frame marks the place that was found." if evidence["marks"] else ""
    return f"Where did the ball surprise the model? Light on the left should be dark on the right.{mark}"


def _places(figure: Figure, document: Document, evidence: Document) -> None:
    shown = _shown(document)
    panels = beside(figure, (1.0,) * len(shown))
    maze = check_text(evidence["map"]).maze
    if maze is None:
        for axes in panels:
            nothing(axes, "the map cannot be read")
        return
    reach, drawn = MM * evidence["reach"], None
    for axes, when in zip(panels, shown, strict=True):
        left = np.array([[np.nan if v is None else v for v in row] for row in evidence["left"][when]], dtype=float)
        plan_view(axes, maze, np.zeros((0, 2)), labels=False)
        drawn = axes.imshow(
            left, origin="lower", extent=(-reach, reach, -reach, reach), vmin=LEAST_LEFT, vmax=MOST_LEFT,
            cmap=darker(), interpolation="nearest", zorder=1.5,
        )  # fmt: skip
        for mark in evidence["marks"]:
            _mark(axes, mark)
        axes.set_title(WHEN[when][1], fontsize=9)
    if drawn is not None:
        bar = figure.colorbar(drawn, ax=panels, shrink=0.8, extend="both")
        bar.set_label("surprise, standard deviations\n(1: noise alone)")


def _mark(axes: Axes, mark: Document) -> None:
    """A circle around a spot; a frame around a sector; a line across a ring at a threshold."""
    style: dict[str, Any] = {"color": INK, "linewidth": 1.8, "zorder": 6}
    if "x" in mark:
        turn = np.linspace(0.0, 2.0 * math.pi, 60)
        size = 2.0 * MM * mark["width"]
        axes.plot(MM * mark["x"] + size * np.cos(turn), MM * mark["y"] + size * np.sin(turn), **style)
        return
    inner, outer, half = MM * mark["inner"], MM * mark["outer"], mark.get("half", 0.0)
    arc = np.linspace(mark["centre"] - half, mark["centre"] + half, 40)
    angle, radius = np.r_[arc, arc[::-1], arc[:1]], np.r_[np.full(40, inner), np.full(40, outer), inner]
    axes.plot(radius * np.cos(angle), radius * np.sin(angle), **style)


def _memory_title(document: Document, evidence: Document) -> str:
    when = _shown(document)[-1]
    most = max((abs(v) for v in evidence["correlation"][when][:3] if v is not None), default=0.0)
    limit = evidence["alike_from"]
    if most < limit:
        return f"Is what remains like noise? Yes: no correlation reaches {limit:.2g}"
    return f"Is what remains like noise? No: pictures that follow one another are alike by {most:.2f}"


def _memory(figure: Figure, document: Document, evidence: Document) -> None:
    (axes,) = beside(figure, (1.0,))
    white, limit, top = float(evidence["white"]), float(evidence["alike_from"]), 0.0
    axes.axhspan(-white, white, color=COLOURS["neutral"], alpha=0.25, label="noise alone, 95 %", linewidth=0.0)
    for when in _shown(document):
        colour, told = WHEN[when]
        values = np.array(evidence["correlation"][when], dtype=float)
        axes.plot(np.arange(1, len(values) + 1), values, marker="o", markersize=4, **line(colour), label=told)
        top = max(top, float(np.nanmax(np.abs(values), initial=0.0)))
    for side in (-limit, limit):
        axes.axhline(side, color=COLOURS["neutral"], linewidth=0.8, linestyle=":")
    axes.set_ylim(-1.4 * max(limit, top), 1.4 * max(limit, top))
    axes.set_xlabel("pictures later")
    axes.set_ylabel("correlation")
    axes.legend(frameon=False, loc="upper right", ncols=3)


def _spectrum(figure: Figure, document: Document, evidence: Document) -> None:
    (axes,) = beside(figure, (1.0,))
    spectrum = evidence["spectrum"]
    hz = np.array(spectrum["hz"], dtype=float)
    for when in _shown(document):
        colour, told = WHEN[when]
        axes.plot(hz, np.array(spectrum[when], dtype=float), **line(colour, linewidth=1.1), label=told)
    axes.axhline(PEAK, color=COLOURS["neutral"], linewidth=0.8, linestyle=":", label="noise alone is seldom higher")
    axes.set_yscale("log")
    axes.set_xlabel("frequency, Hz")
    axes.set_ylabel("power, times that of noise")
    axes.legend(frameon=False, loc="upper right")
