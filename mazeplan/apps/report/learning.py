"""Shows, run by run, how a model learned (`evaluate --learn`): times of the runs, and errors of the model.

Evaluations of the page that did the same without learning are drawn beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from mazeplan.apps.report.drawing import INK, legend_beside, line, points
from mazeplan.apps.report.evaluation_runs import EvaluatedRuns
from mazeplan.apps.report.page import Note, PagePicture
from mazeplan.core.palette import COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SAME = ("rig", "map", "start_ring", "goal_ring", "seed")  # keys of the setup that must agree
FIXED = ("planned", "ring4", "ring5", "ring1")  # styles of evaluations without learning
APART = 0.24  # runs; distance between the points of several evaluations for the same run


def learning_parts(runs: EvaluatedRuns, several: Sequence[EvaluatedRuns] = ()) -> list[Any]:
    """The picture, and a note of the runs from which the model did not learn; empty without learning.

    several: all evaluations of the page."""
    if not runs.learning:
        return []
    fixed = [other for other in several if is_baseline(runs, other)]
    title = "Run by run, while the model learned" + ("" if runs.name == "evaluation" else f": {runs.name}")
    alt = "time of each run, and how far the model was off, against the number of the run"
    notes = []
    if fixed:
        names = ", ".join(other.name for other in fixed)
        which = f"in {runs.name} the model learned, in {names} it stayed as it was"
        title, alt = f"{title}, beside {names}", f"{alt}; {which}"
        notes.append(Note(f"Run by run: {which}. Crosses are runs that did not arrive."))
    skipped = [f"run {lesson.run}: {lesson.why_not}" for lesson in runs.learning if lesson.why_not]
    if skipped:
        notes.append(Note("Not learned from: " + "; ".join(skipped) + "."))
    return [PagePicture("learning", title, alt, lambda figure: _draw(figure, runs, fixed), (9.0, 4.8)), *notes]


def is_baseline(runs: EvaluatedRuns, other: EvaluatedRuns) -> bool:
    """Whether another evaluation did the same without learning. False if a document lacks a key of SAME."""
    one, two = dict(runs.setup), dict(other.setup)
    return not other.learning and all(one.get(name) == two.get(name) is not None for name in SAME)


def _draw(figure: Figure, runs: EvaluatedRuns, fixed: Sequence[EvaluatedRuns]) -> None:
    upper, lower = figure.subplots(2, 1, sharex=True)
    shown = [(runs, "real", f"{runs.name}: " if fixed else "")]
    shown += [(other, FIXED[k % len(FIXED)], f"{other.name}: ") for k, other in enumerate(fixed)]
    for k, (one, name, label) in enumerate(shown):
        number, arrived = one.number + (k - 0.5 * len(fixed)) * APART, one.arrived
        upper.plot(number[arrived], one.time[arrived], label=f"{label}arrived", **points(name))
        if not arrived.all():
            colour = COLOURS[name if fixed else "failure"]
            upper.plot(number[~arrived], one.time[~arrived], "X", label=f"{label}did not arrive", color=colour, ms=8,
                       mec="white")  # fmt: skip
    upper.set_ylabel("time, s")
    upper.margins(y=0.1)  # crosses are large
    upper.set_ylim(bottom=0.0)
    at = [lesson.run for lesson in runs.learning]
    for key, name, label in (
        ("fixed_error_m_s2", "planned", "by the model of the beginning"),
        ("error_m_s2", "real", "by the model that learns"),
    ):
        errors = [getattr(lesson, key) for lesson in runs.learning]
        lower.plot(at, errors, label=label, **line(name, marker=points(name)["marker"], markersize=4.0))
    distrusted = [lesson.run for lesson in runs.learning if not lesson.trusted]
    for run in distrusted:
        lower.axvspan(run + 0.5, run + 1.5, color=COLOURS["idle"], zorder=0, lw=0)
    if distrusted:
        lower.text(0.01, 0.04, "grey: driven with the model of the beginning", transform=lower.transAxes, fontsize=7,
                   color=INK)  # fmt: skip
    lower.set_ylabel("expected before the run\nagainst measured, rms m/s²")
    lower.set_ylim(bottom=0.0)
    lower.set_xlabel("run")
    lower.xaxis.get_major_locator().set_params(integer=True)
    first, last = min(one.number.min() for one, *_ in shown), max(one.number.max() for one, *_ in shown)
    for axes in (upper, lower):
        _mark_changes(axes, [run for run in runs.setup.changes if first < run <= last])
        axes.grid(axis="y")
        legend_beside(axes)


def _mark_changes(axes: Axes, changes: Sequence[int]) -> None:
    """A line before each run that begins with a changed rig."""
    for k, run in enumerate(changes):
        axes.axvline(run - 0.5, label=None if k else "the rig changes", zorder=0, **line("neutral"))
