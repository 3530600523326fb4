"""Curves of the last seconds: tilt commanded and measured, theta planned and estimated, computing times."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mazeplan.apps.view.moment import Moment
from mazeplan.core.palette import COLOURS, FAINT, dashes
from mazeplan.core.records import Array

if TYPE_CHECKING:
    from viser import ViserServer

HZ = 10.0  # rate at which curves are sent
EVERY = 2  # every second sample is shown
HEIGHT = 190  # pixels
DEG = 180.0 / np.pi


class PlotLine(NamedTuple):
    """A curve: its label, its column of a moment, its style of the palette, whether it is dashed."""

    label: str
    column: str
    style: str
    dashed: bool = False


class Chart(NamedTuple):
    """A plot.

    factor: from the columns to the unit
    step: the ends of the axis are multiples of it
    turns: whether values are places on a ring, from 0 to below 360 degrees"""

    title: str
    unit: str
    factor: float
    curves: tuple[PlotLine, PlotLine]
    step: float
    turns: bool = False


CHARTS = (
    Chart("tilt beta about the y axis", "degrees", DEG, (
        PlotLine("commanded", "u_beta", "commanded", True), PlotLine("measured", "beta", "measured")), 2.0),
    Chart("tilt gamma about the x axis", "degrees", DEG, (
        PlotLine("commanded", "u_gamma", "commanded", True), PlotLine("measured", "gamma", "measured")), 2.0),
    Chart("angle of the ball, theta", "degrees", DEG, (
        PlotLine("planned", "planned_theta", "planned", True), PlotLine("estimated", "theta", "real")), 45.0, True),
    Chart("computing time in a tick", "ms", 1.0, (
        PlotLine("planner", "planner_ms", "planned", True), PlotLine("whole tick", "tick_ms", "neutral")), 10.0),
)  # fmt: skip


class Plots:
    """The curves, in viser's current container."""

    def __init__(self, server: ViserServer) -> None:
        common = {"grid": {"stroke": FAINT["grid"], "width": 1}, "font": "11px sans-serif", "labelSize": 18}
        self._plots = list[Any]()
        for chart in CHARTS:
            axes = {"label": "time, s", "size": 32, **common}, {"label": chart.unit, "size": 44, **common}
            series: Any = ({"label": "t (s)"}, *map(_line, chart.curves))
            more: Any = {"axes": axes, "scales": _scales((0.0, 1.0), (0.0, 1.0)), "title": chart.title}
            data = (np.zeros(1),) * 3
            self._plots.append(server.gui.add_uplot(data, series, padding=(9, 12, 0, 0), height=HEIGHT, **more))
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
            ranges = range_of([time], 1.0), range_of(curves, chart.step)
            if ranges != self._ranges[i]:
                self._ranges[i], plot.scales = ranges, _scales(*ranges)
            plot.data = (time, *curves)


def _line(curve: PlotLine) -> dict[str, Any]:
    """A series of uPlot in a colour of the palette."""
    series: dict[str, Any] = {"label": curve.label, "stroke": COLOURS[curve.style], "width": 2}
    dash = {"dash": tuple(2.0 * length for length in dashes(curve.style))} if curve.dashed else {}
    return {**series, "points": {"show": False}, **dash}


def _scales(time: tuple[float, float], values: tuple[float, float]) -> dict[str, Any]:
    """Ranges of both axes. Without a range viser keeps a share of the earlier time axis, which is wrong later."""
    return {"x": {"time": False, "range": time}, "y": {"range": values}}


def range_of(curves: Sequence[Array], step: float) -> tuple[float, float]:
    """Ends of an axis for all finite values: multiples of a step, because each change of the ends makes a new chart.

    uPlot itself finds no range for a curve that begins with NaN."""
    known = np.concatenate([curve[np.isfinite(curve)] for curve in curves])
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
    return step * float(np.floor(low / step)), step * float(np.floor(high / step) + 1.0)


def in_unit(chart: Chart, values: Array) -> Array:
    """Values (N,) of a column in the unit of a chart. NaN breaks the curve of an angle that passes 0 degrees."""
    shown = chart.factor * values
    if chart.turns:
        shown = shown % 360.0
        shown[1:][np.abs(np.diff(shown)) > 180.0] = np.nan
    return shown
