"""Curves of the last seconds: tilt commanded and measured, theta planned and measured, what planner and tick took."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.palette import COLOURS, dashes
from mazeplan.records import Array
from mazeplan.view.moment import Moment

if TYPE_CHECKING:
    from viser import ViserServer

HZ = 10.0  # so often curves are sent
EVERY = 2  # samples: at 30 Hz every second one is as good to the eye
HEIGHT = 190  # pixels
DEG = 180.0 / np.pi
STEP_DEG = 45.0  # of the axis of theta
NOTE = "font-size:13px;color:#666;padding:2px 12px"


def line(label: str, colour: str, *, dashed: bool = False, fill: str = "") -> dict[str, Any]:
    """A series of uPlot in a colour of the palette."""
    style: dict[str, Any] = {"label": label, "stroke": COLOURS[colour], "width": 2, "points": {"show": False}}
    if dashed:
        style["dash"] = tuple(2.0 * length for length in dashes(colour))
    if fill:
        style["fill"] = fill
    return style


def axes(unit: str) -> tuple[dict[str, Any], ...]:
    """Time below, the quantity at the left."""
    grid = {"stroke": "#e4e6ea", "width": 1}
    return (
        {"label": "time (s)", "labelSize": 18, "size": 32, "grid": grid, "font": "11px sans-serif"},
        {"label": unit, "labelSize": 18, "size": 44, "grid": grid, "font": "11px sans-serif"},
    )


def span_of(times: Array) -> tuple[float, float]:
    """Ends of the axis of time, s, of plots that are drawn beside each other: whole seconds, so that it seldom
    changes; a chart is made anew when it does."""
    return (float(np.floor(times[0])), float(np.floor(times[-1]) + 1.0)) if len(times) else (0.0, 1.0)


def range_of(curves: Sequence[Array], step: float | None = None) -> tuple[float, float]:
    """Ends of an axis between which all that is known lies, in steps that seldom change: 1, 2 or 5 times a power of
    ten unless told. Found here and not by uPlot: it finds none where a curve begins with what is not known, as a plan
    does."""
    known = np.concatenate([curve[np.isfinite(curve)] for curve in curves])
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
    if step is None:
        least = max(high - low, 1.0) / 4.0
        power = 10.0 ** np.floor(np.log10(least))
        step = float(next(power * digit for digit in (1.0, 2.0, 5.0, 10.0) if power * digit >= least * (1.0 - 1e-9)))
    return step * float(np.floor(low / step)), step * float(np.floor(high / step) + 1.0)


class Plots:
    """Curves in the container that is current when it is made; before the first run only that there was none."""

    def __init__(self, server: ViserServer) -> None:
        self._none = server.gui.add_html(f'<div style="{NOTE}" data-curves="none">no run yet</div>')
        time = {"label": "t (s)"}

        def add(title: str, unit: str, *curves: dict[str, Any]) -> Any:
            more: dict[str, Any] = {"scales": scales((0.0, 1.0), (0.0, 1.0)), "axes": axes(unit), "height": HEIGHT}
            nothing = (np.zeros(1),) * (1 + len(curves))
            return server.gui.add_uplot(
                nothing, (time, *curves), title=title, padding=(4, 12, 0, 0), visible=False, **more  # pyright: ignore
            )  # fmt: skip

        planned = line("planned", "planned", dashed=True)
        tilt = line("commanded", "commanded", dashed=True), line("measured", "measured")
        self._charts = [
            _Chart(add("tilt beta about the y axis", "deg", *tilt), DEG, ("u_beta", "beta")),
            _Chart(add("tilt gamma about the x axis", "deg", *tilt), DEG, ("u_gamma", "gamma")),
            _Chart(
                add("angle of the ball, theta", "deg", planned, line("estimated", "real")),
                DEG, ("planned_theta", "theta"), STEP_DEG,
            ),
            _Chart(
                add("computing time in a tick", "ms", {**planned, "label": "planner"}, line("whole tick", "neutral")),
                1.0, ("planner_ms", "tick_ms"),
            ),
        ]  # fmt: skip
        self._at, self._before = 0.0, (-1, -1)

    def show(self, moment: Moment, now: float) -> None:
        """Draw a moment; now: s of any clock, by which it is not done too often."""
        key = (moment.run, moment.tick)
        if key == self._before or (now - self._at < 1.0 / HZ and moment.result is None):
            return
        self._before, self._at = key, now
        if not len(moment.rows):
            return
        for chart in self._charts:
            chart.show(moment)
        self._none.visible = False


class _Chart:
    """One plot: columns of a moment, times a factor; step: of its axis, None where it is found."""

    def __init__(self, plot: Any, factor: float, names: tuple[str, ...], step: float | None = None) -> None:
        self._plot, self._factor, self._names, self._step = plot, factor, names, step
        self._ranges: tuple[Any, ...] = ()

    def show(self, moment: Moment) -> None:
        picked = slice((len(moment.rows) - 1) % EVERY, None, EVERY)
        time = np.ascontiguousarray(moment.column("t")[picked])
        curves = [np.ascontiguousarray(self._factor * moment.column(name)[picked]) for name in self._names]
        ranges = span_of(time), range_of(curves, self._step)
        if ranges != self._ranges:
            self._ranges = ranges
            self._plot.scales = scales(*ranges)
        self._plot.data = (time, *curves)
        self._plot.visible = True


def scales(time: tuple[float, float], values: tuple[float, float]) -> dict[str, Any]:
    """Both axes of a plot, told: viser keeps the part of the time that it shows, as a share of what there was, when a
    chart is made anew, and is off by what has come since."""
    return {"x": {"time": False, "range": time}, "y": {"range": values}}
