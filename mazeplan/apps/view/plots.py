"""Curves: tilt commanded and measured, theta planned and measured, computing times of planner and tick.

A live page shows the last seconds. A replay shows the whole run, with a line at the current time; of a long run it
shows the part around this time. A replay of two runs shows the last curve of each plot for both runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mazeplan.apps.view.moment import Moment
from mazeplan.core.palette import COLOURS, FAINT, INKS, dashes
from mazeplan.core.records import Array

if TYPE_CHECKING:
    from viser import ViserServer

    from mazeplan.apps.view.replay.recorded import RecordedRun

HZ = 10.0  # rate at which curves are sent
EVERY = 2  # a live page shows every second sample
HEIGHT = 190  # pixels
SHOWN_S = 30.0  # s of a long recorded run
DEG = 180.0 / np.pi
STEP_DEG = 45.0  # step of the ends of the axis of theta
NOTE = f"font-size:13px;color:{INKS['quiet']};padding:2px 12px"


class PlotLine(NamedTuple):
    """A curve: its label, its column of a moment, its style of the palette, whether it is dashed."""

    label: str
    column: str
    style: str
    dashed: bool = False


class Chart(NamedTuple):
    """A plot.

    factor: from the columns to the unit
    step: the ends of the axis are multiples of it; None: `range_of` finds a step"""

    title: str
    unit: str
    factor: float
    curves: tuple[PlotLine, PlotLine]
    step: float | None = None


CHARTS = (
    Chart("tilt beta about the y axis", "degrees", DEG, (
        PlotLine("commanded", "u_beta", "commanded", True), PlotLine("measured", "beta", "measured"))),
    Chart("tilt gamma about the x axis", "degrees", DEG, (
        PlotLine("commanded", "u_gamma", "commanded", True), PlotLine("measured", "gamma", "measured"))),
    Chart("angle of the ball, theta", "degrees", DEG, (
        PlotLine("planned", "planned_theta", "planned", True), PlotLine("estimated", "theta", "real")), STEP_DEG),
    Chart("computing time in a tick", "ms", 1.0, (
        PlotLine("planner", "planner_ms", "planned", True), PlotLine("whole tick", "tick_ms", "neutral"))),
)  # fmt: skip


def line(label: str, style: str, dashed: bool = False) -> dict[str, Any]:
    """A series of uPlot in a colour of the palette."""
    series: dict[str, Any] = {"label": label, "stroke": COLOURS[style], "width": 2, "points": {"show": False}}
    if dashed:
        series["dash"] = tuple(2.0 * length for length in dashes(style))
    return series


def _add_plot(server: ViserServer, chart: Chart, series: Sequence[Any], data: tuple[Array, ...], **more: Any) -> Any:
    common = {"grid": {"stroke": FAINT["grid"], "width": 1}, "font": "11px sans-serif", "labelSize": 18}
    axes = {"label": "time, s", "size": 32, **common}, {"label": chart.unit, "size": 44, **common}
    every: Any = ({"label": "t (s)"}, *series)
    more |= {"axes": axes, "height": HEIGHT, "title": chart.title}
    return server.gui.add_uplot(data, every, padding=(9, 12, 0, 0), **more)  # pyright: ignore


def scales(time: tuple[float, float], values: tuple[float, float]) -> dict[str, Any]:
    """Ranges of both axes. Without a range viser keeps a share of the earlier time axis, which is wrong later."""
    return {"x": {"time": False, "range": time}, "y": {"range": values}}


def span_of(times: Array) -> tuple[float, float]:
    """Ends of the time axis, s. They are whole seconds, because each change of the ends makes a new chart."""
    return (float(np.floor(times[0])), float(np.floor(times[-1]) + 1.0)) if len(times) else (0.0, 1.0)


def range_of(curves: Sequence[Array], step: float | None = None) -> tuple[float, float]:
    """Ends of an axis for all finite values. They are multiples of a step, so that they seldom change.

    step: by default 1, 2 or 5 times a power of ten

    uPlot itself finds no range for a curve that begins with NaN."""
    known = np.concatenate([curve[np.isfinite(curve)] for curve in curves])
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
    if step is None:
        least = max(high - low, 1.0) / 4.0
        power = 10.0 ** np.floor(np.log10(least))
        step = float(next(power * digit for digit in (1.0, 2.0, 5.0, 10.0) if power * digit >= least * (1.0 - 1e-9)))
    return step * float(np.floor(low / step)), step * float(np.floor(high / step) + 1.0)


class LivePlots:
    """Curves of the last seconds, in viser's current container. Before the first run there is a note instead."""

    def __init__(self, server: ViserServer) -> None:
        self._none = server.gui.add_html(f'<div style="{NOTE}" data-curves="none">no run yet</div>')
        empty = {"scales": scales((0.0, 1.0), (0.0, 1.0)), "visible": False}
        self._plots = []
        for chart in CHARTS:
            series = [line(curve.label, curve.style, curve.dashed) for curve in chart.curves]
            self._plots.append(_add_plot(server, chart, series, (np.zeros(1),) * 3, **empty))
        self._ranges: list[Any] = [None] * len(CHARTS)
        self._at, self._before = 0.0, (-1, -1)

    def show(self, moment: Moment, now: float) -> None:
        """Draw a moment, at most HZ times a second; now: s of any clock."""
        key = (moment.run, moment.tick)
        if key == self._before or (now - self._at < 1.0 / HZ and moment.result is None):
            return
        self._before, self._at = key, now
        if not len(moment.rows):
            return
        picked = slice((len(moment.rows) - 1) % EVERY, None, EVERY)
        time = np.ascontiguousarray(moment.column("t")[picked])
        for i, (chart, plot) in enumerate(zip(CHARTS, self._plots, strict=True)):
            curves = [np.ascontiguousarray(in_unit(chart, moment.column(c.column)[picked])) for c in chart.curves]
            ranges = span_of(time), range_of(curves, chart.step)
            if ranges != self._ranges[i]:
                self._ranges[i], plot.scales = ranges, scales(*ranges)
            plot.data = (time, *curves)
            plot.visible = True
        self._none.visible = False


class ReplayPlots:
    """Curves of one or two recorded runs, in viser's current container. Axes of long runs fit the part shown."""

    def __init__(self, server: ViserServer, runs: Sequence[RecordedRun]) -> None:
        self._at, self._shown, self._runs = -1.0, None, runs
        self._ends = min(run.times[0] for run in runs), max(run.times[-1] for run in runs)
        self._plots, self._ranges = [], list[tuple[float, float]]()
        whole = all(run.moments.whole for run in runs)
        self._tables = [table(runs, chart) if whole else None for chart in CHARTS]
        for chart, columns in zip(CHARTS, self._tables, strict=True):
            shown = columns or self._around(chart, self._ends[0])
            ends = spread(shown[1:]) if columns else range_of(shown[1:], chart.step)
            series = [line(curve.label, curve.style, curve.dashed) for curve in chart.curves]
            if len(runs) > 1:
                series = [
                    line(f"A {chart.curves[1].label}", "real"),
                    line(f"B {chart.curves[1].label}", "planned", True),
                ]
            here = {"label": "now", "stroke": COLOURS["neutral"], "width": 1, "points": {"show": False}}
            data = with_line(shown, shown[0][0], *ends)
            self._plots.append(_add_plot(server, chart, [*series, here], data, scales=_up(ends)))
            self._ranges.append(ends)

    def _around(self, chart: Chart, t: float) -> tuple[Array, ...]:
        """The part of long runs around t, read from their logs."""
        return table(self._runs, chart, window(*self._ends, t))

    def show(self, t: float, now: float) -> None:
        """Put the line at t, at most HZ times a second; now: s of any clock."""
        if t == self._shown or now - self._at < 1.0 / HZ:
            return
        self._shown, self._at = t, now
        for i, (chart, plot, columns) in enumerate(zip(CHARTS, self._plots, self._tables, strict=True)):
            shown = around(columns, t) if columns else self._around(chart, t)
            if columns is None and (ends := range_of(shown[1:], chart.step)) != self._ranges[i]:
                self._ranges[i], plot.scales = ends, _up(ends)
            plot.data = with_line(shown, t, *self._ranges[i])


def _up(ends: tuple[float, float]) -> dict[str, Any]:
    return {"x": {"time": False}, "y": {"range": ends}}


def table(runs: Sequence[RecordedRun], chart: Chart, span: tuple[float, float] | None = None) -> tuple[Array, ...]:
    """Times of all runs, then each curve at these times, NaN where its run has no value; (N,) each.

    span: from and to, s; by default the whole runs"""
    parts = [np.searchsorted(run.times, span).tolist() if span else (0, len(run.times)) for run in runs]
    known = [run.times[first:end] for run, (first, end) in zip(runs, parts, strict=True)]
    if len(runs) == 1:
        return known[0], *(in_unit(chart, runs[0].column(curve.column, *parts[0])) for curve in chart.curves)
    times, name = np.unique(np.concatenate(known)), chart.curves[1].column
    curves = [run.column(name, *part) for run, part in zip(runs, parts, strict=True)]
    return times, *(in_unit(chart, at_times(times, *pair)) for pair in zip(known, curves, strict=True))


def in_unit(chart: Chart, values: Array) -> Array:
    """Values (N,) of a column in the unit of a chart.

    A place on a ring is from 0 to below 360 degrees, as in the names of openings. NaN breaks its curve where the ball
    passes 0 degrees."""
    shown = chart.factor * values
    if chart.step != STEP_DEG:
        return shown
    shown = shown % 360.0
    shown[1:][np.abs(np.diff(shown)) > 180.0] = np.nan
    return shown


def at_times(times: Array, known: Array, values: Array) -> Array:
    """Values at other times, interpolated linearly; NaN outside the known times and beside NaN."""
    if not len(known):
        return np.full(len(times), np.nan)
    return np.interp(times, known, values, left=np.nan, right=np.nan)


def around(columns: tuple[Array, ...], t: float) -> tuple[Array, ...]:
    """The part of a long run around t."""
    times = columns[0]
    if times[-1] - times[0] <= SHOWN_S:
        return columns
    start, end = np.searchsorted(times, window(times[0], times[-1], t))
    return tuple(column[start:end] for column in columns)


def window(begin: float, end: float, t: float) -> tuple[float, float]:
    """Ends of a window of SHOWN_S around t, within a run from `begin` to `end`, s."""
    first = max(begin, min(t - 0.5 * SHOWN_S, end - SHOWN_S))
    return first, first + SHOWN_S


def spread(curves: Sequence[Array]) -> tuple[float, float]:
    """Ends of an axis a little below and a little above all curves."""
    known = np.concatenate(curves)
    known = known[np.isfinite(known)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    room = 0.05 * (high - low) or 1.0
    return low - room, high + room


def with_line(columns: tuple[Array, ...], t: float, low: float, high: float) -> tuple[Array, ...]:
    """The columns, and one more for a vertical line: from `low` to `high` at t, NaN elsewhere."""
    times, *curves = columns
    at, both = int(np.searchsorted(times, t)), np.array([t, t])
    here = np.insert(np.full(len(times), np.nan), at, [low, high])
    more = [np.insert(curve, at, at_times(both, times, curve)) for curve in curves]
    return tuple(np.ascontiguousarray(column) for column in (np.insert(times, at, both), *more, here))
