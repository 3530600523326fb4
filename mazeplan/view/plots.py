"""Curves of the last seconds: tilt commanded and measured, theta planned and measured, what planner and tick took."""

from __future__ import annotations

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
STEP_DEG = 45.0


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


def turn_of(theta: Array) -> tuple[float, float]:
    """Least and largest angle of the axis, deg, in steps that seldom change. Told, and not found by uPlot: it finds
    none where a curve begins with what is not known, as a plan does."""
    known = theta[np.isfinite(theta)]
    if not len(known):
        return 0.0, STEP_DEG
    return STEP_DEG * float(np.floor(known.min() / STEP_DEG)), STEP_DEG * float(np.floor(known.max() / STEP_DEG) + 1.0)


class Plots:
    """Curves in the container that is current when it is made."""

    def __init__(self, server: ViserServer) -> None:
        add, none = server.gui.add_uplot, np.zeros(1)
        scales = {"x": {"time": False}}
        more: dict[str, Any] = {"scales": scales, "height": HEIGHT, "padding": (4, 12, 0, 0)}
        time = {"label": "t (s)"}
        self._tilts = [
            add(
                (none, none, none),
                (time, line("commanded", "commanded", dashed=True), line("measured", "measured")),  # pyright: ignore
                title=f"tilt {name} about the {axis} axis", axes=axes("deg"), **more,  # pyright: ignore
            )
            for name, axis in (("beta", "y"), ("gamma", "x"))
        ]  # fmt: skip
        self._theta = add(
            (none, none, none),
            (time, line("planned", "planned", dashed=True), line("estimated", "real")),  # pyright: ignore
            title="angle of the ball, theta", axes=axes("deg"), **more,  # pyright: ignore
        )  # fmt: skip
        self._ms = add(
            (none, none, none),
            (time, line("planner", "planned", dashed=True), line("whole tick", "neutral")),  # pyright: ignore
            title="computing time in a tick", axes=axes("ms"), **more,  # pyright: ignore
        )  # fmt: skip
        self._at, self._before = 0.0, (-1, -1)
        self._turn = (0.0, 0.0)  # deg, of the axis of theta

    def show(self, moment: Moment, now: float) -> None:
        """Draw a moment; now: s of any clock, by which it is not done too often."""
        key = (moment.run, moment.tick)
        if key == self._before or (now - self._at < 1.0 / HZ and moment.result is None):
            return
        self._before, self._at = key, now
        if not len(moment.rows):
            return
        picked = slice((len(moment.rows) - 1) % EVERY, None, EVERY)

        def columns(scale: float, *names: str) -> tuple[Array, ...]:
            time, *values = (np.ascontiguousarray(moment.column(name)[picked]) for name in ("t", *names))
            return (time, *(scale * value for value in values))

        self._tilts[0].data = columns(DEG, "u_beta", "beta")
        self._tilts[1].data = columns(DEG, "u_gamma", "gamma")
        theta = columns(DEG, "planned_theta", "theta")
        if (turn := turn_of(theta[2])) != self._turn:
            self._turn = turn
            self._theta.scales = {"x": {"time": False}, "y": {"range": turn}}  # pyright: ignore
        self._theta.data = theta
        self._ms.data = columns(1.0, "planner_ms", "tick_ms")
