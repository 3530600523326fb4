"""What a model learned over the runs of an evaluation, and how they went meanwhile: `evaluate --learn`."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.palette import COLOURS
from mazeplan.report.drawing import INK, line, points
from mazeplan.report.page import Note, Picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from mazeplan.report.evaluation import Runs


def learning_parts(runs: Runs) -> list[Any]:
    """The picture, and what was not learned from; nothing for an evaluation without learning."""
    if not runs.learning:
        return []
    title = "Run by run, while the model learned" + ("" if runs.name == "evaluation" else f": {runs.name}")
    alt = "time of each run, and how far the model was off, against the number of the run"
    found: list[Any] = [Picture("learning", title, alt, lambda figure: _runs(figure, runs), (9.0, 4.8))]
    skipped = [f"run {x['run']}: {x['why_not']}" for x in runs.learning if x.get("why_not")]
    if skipped:
        found.append(Note("Not learned from: " + "; ".join(skipped) + "."))
    return found


def _runs(figure: Figure, runs: Runs) -> None:
    upper, lower = figure.subplots(2, 1, sharex=True)
    number, arrived = np.arange(1, len(runs.time) + 1), runs.arrived
    upper.plot(number[arrived], runs.time[arrived], label="arrived", **points("real"))
    upper.plot(
        number[~arrived], runs.time[~arrived], "X", color=COLOURS["failure"], ms=8, mec="white", label="did not arrive"
    )
    upper.set_ylabel("time, s")
    upper.set_ylim(bottom=0.0)
    for key, name, label in (
        ("fixed_error_m_s2", "planned", "by the model of the beginning"),
        ("error_m_s2", "real", "by the model that learns"),
    ):
        values = [x.get(key) for x in runs.learning]
        known = [math.nan if v is None else float(v) for v in values]
        at = [x["run"] for x in runs.learning]
        lower.plot(at, known, label=label, **line(name, marker=points(name)["marker"], markersize=4.0))
    distrusted = [x["run"] for x in runs.learning if not x.get("trusted", True)]
    for run in distrusted:
        lower.axvspan(run + 0.5, run + 1.5, color=COLOURS["idle"], zorder=0, lw=0)
    if distrusted:
        lower.text(
            0.01, 0.04, "grey: driven with the model of the beginning", transform=lower.transAxes, fontsize=7, color=INK
        )
    lower.set_ylabel("expected before the run\nagainst measured, rms m/s²")
    lower.set_ylim(bottom=0.0)
    lower.set_xlabel("run")
    lower.xaxis.get_major_locator().set_params(integer=True)
    for axes in (upper, lower):
        axes.grid(axis="y")
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
