"""Of a run with two balls page, film, report and drawing show both."""

from __future__ import annotations

import math

import numpy as np
import pytest
from fake_scene import FakeServer
from matplotlib.colors import to_hex
from report_documents import drawn

import mazeplan
from mazeplan.apps.report.runs import run_section, second_trail
from mazeplan.apps.view.scene import UNIT, Scene
from mazeplan.apps.view.story import BallShown, Moment, moments
from mazeplan.core.logs.run_log_reader import read_log
from mazeplan.core.palette import COLOURS, rgb
from mazeplan.maze.mapfile import load_map

MAZE = load_map("cme")


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """Messages of a run with two balls, and its log."""
    messages, path = [], tmp_path_factory.mktemp("log") / "two.mcap"
    mazeplan.navigate(
        rig="ideal", balls=2, seed=1, time_limit=1.0, log=path, feed=lambda topic, t, d: messages.append((topic, d))
    )
    return messages, read_log(path)


def test_a_moment_has_the_second_ball_where_it_was_estimated(told):
    messages, log = told
    shown, places = moments(messages), second_trail(log)
    assert len(shown) == len(places) >= 30
    for moment, place in zip(shown, places, strict=True):
        assert (moment.second.x, moment.second.y) == pytest.approx(tuple(place))
        assert math.dist((moment.second.x, moment.second.y), (moment.ball.x, moment.ball.y)) > 0.05
        assert moment.second.seen


def test_the_scene_shows_it_beside_the_first():
    server = FakeServer()
    scene = Scene(server, MAZE)
    scene.show(Moment(run=1, tick=1, ball=BallShown(0.09, 0.0, True), second=BallShown(0.0, -0.07, True)))
    first, second = (server.nodes[f"/plate/{name}"] for name in ("ball", "ball2"))
    assert second.visible
    assert second.position == pytest.approx((0.0, -0.07 * UNIT, UNIT * MAZE.ball.radius))
    assert (first.color, second.color) == (rgb("real"), rgb("second"))
    scene.show(Moment(run=1, tick=2, ball=BallShown(0.09, 0.0, True)))
    assert (first.visible, second.visible) == (True, False)


def test_the_report_draws_its_path(told):
    _, log = told
    figure = drawn(run_section(log).parts, "path")
    (line,) = [line for axes in figure.axes for line in axes.lines if line.get_label() == "second ball"]
    assert to_hex(line.get_color()).upper() == COLOURS["second"]
    np.testing.assert_allclose(np.array(line.get_data()).T, 1e3 * second_trail(log))
