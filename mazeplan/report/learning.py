"""What a model learned over the runs of an evaluation, and how they went meanwhile: `evaluate --learn`.

Beside it stand the runs of evaluations that did the same with a model that did not learn, if the page has such.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from mazeplan.palette import COLOURS
from mazeplan.report.drawing import INK, line, points
from mazeplan.report.page import Note, Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from mazeplan.report.evaluation import Runs

SAME = ("rig", "map", "start_ring", "goal_ring", "seed")  # in the setup of evaluations that can be laid beside another
FIXED = ("planned", "ring4", "ring5", "ring1")  # how those that did not learn are drawn
APART = 0.24  # runs, between the points of the same run


def learning_parts(runs: Runs, several: Sequence[Runs] = ()) -> list[Any]:
    """The picture, and what was not learned from; nothing for an evaluation without learning. several: all evaluations
    of the page."""
    if not runs.learning:
        return []
    fixed = [other for other in several if beside(runs, other)]
    title = "Run by run, while the model learned" + ("" if runs.name == "evaluation" else f": {runs.name}")
    alt = "time of each run, and how far the model was off, against the number of the run"
    if fixed:
        title += ", beside " + ", ".join(other.name for other in fixed)
        alt += f"; {_which(runs, fixed)}"
    found: list[Any] = [Picture("learning", title, alt, lambda figure: _runs(figure, runs, fixed), (9.0, 4.8))]
    if fixed:
        found.append(Note(f"Run by run: {_which(runs, fixed)}. Crosses are runs that did not arrive."))
    skipped = [f"run {x['run']}: {x['why_not']}" for x in runs.learning if x.get("why_not")]
    if skipped:
        found.append(Note("Not learned from: " + "; ".join(skipped) + "."))
    return found


def beside(runs: Runs, other: Runs) -> bool:
    """Whether another evaluation did the same without learning, as far as both tell."""
    told = all(name in runs.setup and name in other.setup for name in SAME)
    return told and not other.learning and all(runs.setup[name] == other.setup[name] for name in SAME)


def _which(runs: Runs, fixed: Sequence[Runs]) -> str:
    return f"in {runs.name} the model learned, in {', '.join(other.name for other in fixed)} it stayed as it was"


def _runs(figure: Figure, runs: Runs, fixed: Sequence[Runs] = ()) -> None:
    upper, lower = figure.subplots(2, 1, sharex=True)
    shown = [(runs, "real", f"{runs.name}: " if fixed else "")]  # which of them learned is said below the picture
    shown += [(other, FIXED[k % len(FIXED)], f"{other.name}: ") for k, other in enumerate(fixed)]
    for k, (one, name, label) in enumerate(shown):
        _times(upper, one, name, label, (k - 0.5 * len(fixed)) * APART, alone=not fixed)
    upper.set_ylabel("time, s")
    upper.margins(y=0.1)  # crosses are large
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
    first, last = min(one.number.min() for one, *_ in shown), max(one.number.max() for one, *_ in shown)
    _changes((upper, lower), [run for run in runs.setup.get("changes", ()) if first < run <= last])
    for axes in (upper, lower):
        axes.grid(axis="y")
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))


def _times(axes: Axes, runs: Runs, name: str, label: str, aside: float, *, alone: bool) -> None:
    """Points of those that arrived, crosses of the others. aside: in runs; alone: nothing else is shown."""
    number, arrived, colour = runs.number + aside, runs.arrived, COLOURS["failure" if alone else name]
    axes.plot(number[arrived], runs.time[arrived], label=f"{label}arrived", **points(name))
    cross = {"color": colour, "ms": 8, "mec": "white"}
    if not arrived.all():
        axes.plot(number[~arrived], runs.time[~arrived], "X", label=f"{label}did not arrive", **cross)


def _changes(panels: Sequence[Axes], changes: Sequence[int]) -> None:
    """A line before each run from which on the rig is otherwise."""
    for k, run in enumerate(changes):
        for axes in panels:
            label = "the rig changes" if k == 0 else None
            axes.axvline(run - 0.5, label=label, zorder=0, **line("neutral"))
