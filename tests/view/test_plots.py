"""The curves hold what is known, on axes that seldom change."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from mazeplan.apps.view.moment import COLUMN, COLUMNS, Moment
from mazeplan.apps.view.plots import CHARTS, Plots, in_unit, range_of

NAN = float("nan")


@pytest.mark.parametrize(
    ("curves", "axis"),
    [
        ([[], []], (0.0, 45.0)),
        ([[NAN, NAN], [NAN]], (0.0, 45.0)),
        ([[NAN, 10.0, 50.0], [20.0]], (0.0, 90.0)),
        ([[NAN, 100.0], [-100.0, 44.0]], (-135.0, 135.0)),  # the plan as well
    ],
)
def test_an_axis_holds_all_that_is_known(curves, axis):
    assert range_of([np.array(curve) for curve in curves], 45.0) == axis


class FakeGui:
    """Of viser what plots use; keeps what is set."""

    def __init__(self):
        self.plots = []

    def add_uplot(self, data, series, **more):
        self.plots.append(SimpleNamespace(data=data, series=series, **more))
        return self.plots[-1]


def moment(seconds, tick=1):
    rows = np.full((round(30 * seconds), len(COLUMNS)), NAN)
    rows[:, COLUMN["t"]] = np.arange(len(rows)) / 30.0
    for name in ("beta", "theta", "tick_ms"):
        rows[:, COLUMN[name]] = 1.0
    rows[-5:, COLUMN["planned_theta"]] = 2.0  # planned from later on
    return Moment(run=1, tick=tick, rows=rows)


@pytest.mark.parametrize("seconds", [1.43, 2.6, 3.5])
def test_all_plots_have_one_axis_of_time_that_holds_the_run(seconds):
    gui = FakeGui()
    shown = Plots(SimpleNamespace(gui=gui))
    for tick, part in enumerate((0.3, 0.5 * seconds, seconds)):
        shown.show(moment(part, tick + 1), float(tick + 1))
    assert len(gui.plots) == 4
    for plot in gui.plots:
        assert plot.scales["x"]["range"] == (0.0, np.floor(plot.data[0][-1]) + 1.0)
        low, high = plot.scales["y"]["range"]
        values = np.concatenate(plot.data[1:])
        values = values[np.isfinite(values)]
        assert ((values >= low) & (values <= high)).all()


def test_the_curve_of_an_angle_breaks_at_0_degrees():
    chart = next(chart for chart in CHARTS if "theta" in chart.title)
    shown = in_unit(chart, np.radians([-30.0, -10.0, 10.0, 20.0, 350.0 + 360.0]))
    assert shown == pytest.approx([330.0, 350.0, NAN, 20.0, NAN], nan_ok=True)
    assert in_unit(CHARTS[0], np.radians([-3.0, 4.0])) == pytest.approx([-3.0, 4.0])
