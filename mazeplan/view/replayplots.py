"""Curves of recorded runs over all of their time, one run or two laid over each other, with a line where one looks.

Longer runs are shown by the part around that line.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.palette import COLOURS
from mazeplan.records import Array
from mazeplan.view.plots import DEG, HEIGHT, axes, line
from mazeplan.view.replaying import Recording

if TYPE_CHECKING:
    from viser import ViserServer

SHOWN_S = 30.0  # s of a longer run, half of them before the line
HZ = 10.0  # so often curves are sent
Curve = tuple[str, str, str, bool]  # label, column, name in the palette, dashed
PICTURES: tuple[tuple[str, str, float, tuple[Curve, ...]], ...] = (  # title, unit, factor, curves of one run
    ("tilt beta about the y axis", "deg", DEG, (
        ("commanded", "u_beta", "commanded", True), ("measured", "beta", "measured", False))),
    ("tilt gamma about the x axis", "deg", DEG, (
        ("commanded", "u_gamma", "commanded", True), ("measured", "gamma", "measured", False))),
    ("angle of the ball, theta", "deg", DEG, (
        ("planned", "planned_theta", "planned", True), ("estimated", "theta", "real", False))),
    ("computing time in a tick", "ms", 1.0, (
        ("planner", "planner_ms", "planned", True), ("whole tick", "tick_ms", "neutral", False))),
)  # fmt: skip


class ReplayPlots:
    """Curves in the container that is current when it is made."""

    def __init__(self, server: ViserServer, recordings: Sequence[Recording]) -> None:
        self._tables = [table(recordings, curves, factor) for _, _, factor, curves in PICTURES]
        self._at = -1.0
        self._shown: float | None = None
        self._ranges = [spread(columns[1:]) for columns in self._tables]
        self._plots = []
        for (title, unit, _, curves), columns, (low, high) in zip(PICTURES, self._tables, self._ranges, strict=True):
            # told, not found by uPlot: it finds none where a curve begins with what is not known
            scales = {"x": {"time": False}, "y": {"range": (low, high)}}
            series = ({"label": "t (s)"}, *lines(curves, len(recordings)), _here())
            data = with_line(columns, columns[0][0], low, high)
            more: dict[str, Any] = {"title": title, "scales": scales, "axes": axes(unit), "height": HEIGHT}
            self._plots.append(server.gui.add_uplot(data, series, padding=(4, 12, 0, 0), **more))  # pyright: ignore

    def show(self, t: float, now: float) -> None:
        """Put the line at t; now: s of any clock, by which it is not done too often."""
        if t == self._shown or now - self._at < 1.0 / HZ:
            return
        self._shown, self._at = t, now
        for plot, columns, (low, high) in zip(self._plots, self._tables, self._ranges, strict=True):
            plot.data = with_line(around(columns, t), t, low, high)


def lines(curves: Sequence[Curve], runs: int) -> list[dict[str, Any]]:
    """How curves are drawn: of one run all of them, of two the last of each (what was, not what was wanted)."""
    if runs == 1:
        return [line(label, colour, dashed=dashed) for label, _, colour, dashed in curves]
    label = curves[-1][0]
    return [line(f"A {label}", "real"), line(f"B {label}", "planned", dashed=True)]


def _here() -> dict[str, Any]:
    return {"label": "now", "stroke": COLOURS["neutral"], "width": 1, "points": {"show": False}}


def table(recordings: Sequence[Recording], curves: Sequence[Curve], factor: float) -> tuple[Array, ...]:
    """Times of all runs, and each curve at them, NaN where its run has nothing: (N,) each."""
    if len(recordings) == 1:
        return recordings[0].times, *(factor * recordings[0].column(name) for _, name, _, _ in curves)
    times = np.unique(np.concatenate([recording.times for recording in recordings]))
    name = curves[-1][1]
    return times, *(factor * at_times(times, r.times, r.column(name)) for r in recordings)


def at_times(times: Array, known: Array, values: Array) -> Array:
    """Values at other times, linearly between those that are known; NaN outside and beside what is NaN."""
    return np.interp(times, known, values, left=np.nan, right=np.nan)


def around(columns: tuple[Array, ...], t: float) -> tuple[Array, ...]:
    """The part of a longer run around t."""
    times = columns[0]
    if times[-1] - times[0] <= SHOWN_S:
        return columns
    first = min(max(t - 0.5 * SHOWN_S, times[0]), times[-1] - SHOWN_S)
    start, end = np.searchsorted(times, [first, first + SHOWN_S])
    return tuple(column[start:end] for column in columns)


def spread(curves: Sequence[Array]) -> tuple[float, float]:
    """From a little below all curves to a little above."""
    known = np.concatenate(curves)
    known = known[np.isfinite(known)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    room = 0.05 * (high - low) or 1.0
    return low - room, high + room


def with_line(columns: tuple[Array, ...], t: float, low: float, high: float) -> tuple[Array, ...]:
    """The curves, with one more column that goes from `low` to `high` at t and is nowhere else."""
    times, *curves = columns
    at, both = int(np.searchsorted(times, t)), np.array([t, t])
    here = np.insert(np.full(len(times), np.nan), at, [low, high])
    more = [np.insert(curve, at, at_times(both, times, curve)) for curve in curves]
    return tuple(np.ascontiguousarray(column) for column in (np.insert(times, at, both), *more, here))
