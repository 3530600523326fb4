"""What is drawn lies where the maze has it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from fake_scene import FakeServer

from mazeplan.apps.view.page import facts_html, tree_html
from mazeplan.apps.view.scene import UNIT, Scene, attitude, wall_mesh
from mazeplan.apps.view.story import BallShown, Moment
from mazeplan.core.palette import rgb
from mazeplan.maze.mapfile import load_map

MAZE = load_map("cme")


def moment(**more):
    trail = np.array([[0.08, 0.0], [0.085, 0.0], [0.09, 0.0]])
    given = {"run": 1, "tick": 3, "t": 0.2, "ball": BallShown(0.09, 0.0, True), "trail": trail, "tilt": (0.05, 0.0)}
    return Moment(**{**given, **more})


@pytest.fixture
def drawn():
    server = FakeServer()
    return Scene(server, MAZE), server.nodes


def node(nodes, name):
    return nodes[f"/plate/{name}"]


def test_the_plate_tilts_as_the_rig_means_it():
    """Positive beta lowers the +x side, positive gamma lifts the +y side."""

    def turned(q, v):
        w, u = q[0], np.array(q[1:])
        return v + 2.0 * np.cross(u, np.cross(u, v) + w * v)

    assert turned(attitude(0.1, 0.0), np.array([1.0, 0.0, 0.0]))[2] == pytest.approx(-math.sin(0.1))
    assert turned(attitude(0.0, 0.1), np.array([0.0, 1.0, 0.0]))[2] == pytest.approx(math.sin(0.1))
    both = turned(attitude(0.1, 0.2), np.array([0.0, 0.0, 1.0]))
    cb, sb, cg, sg = math.cos(0.1), math.sin(0.1), math.cos(0.2), math.sin(0.2)
    np.testing.assert_allclose(both, [sb * cg, -sg, cb * cg])


def test_ball_trail_and_plan_lie_where_they_are(drawn):
    scene, nodes = drawn
    places = np.array([[0.09, 0.0], [0.0, 0.09]])
    scene.show(moment(plan=places))
    ball = node(nodes, "ball")
    assert ball.visible
    assert ball.position == pytest.approx((UNIT * 0.09, 0.0, UNIT * MAZE.ball.radius))
    assert ball.color == rgb("real")
    trail = node(nodes, "trail").points
    np.testing.assert_allclose(trail[-1, 1, :2], (UNIT * 0.09, 0.0), atol=1e-6)
    np.testing.assert_allclose(trail[0, 0, :2], (UNIT * 0.08, 0.0), atol=1e-6)
    line = node(nodes, "plan").points
    np.testing.assert_allclose((line[0, 0, :2], line[-1, 1, :2]), UNIT * places, atol=1e-6)
    scene.show(moment(tick=4, ball=None))
    assert not node(nodes, "ball").visible
    assert not node(nodes, "plan").visible


def test_openings_show_what_is_known_of_them(drawn):
    scene, nodes = drawn
    name = MAZE.openings[0].name
    scene.show(moment())
    assert node(nodes, f"opening/{name}/floor").color == rgb("skipped")
    scene.show(moment(tick=5, opening=name, closed=frozenset({name})))
    assert node(nodes, f"opening/{name}/plug").visible
    assert node(nodes, f"opening/{name}/floor").color == rgb("planned")


@pytest.mark.parametrize("wall", MAZE.walls, ids=lambda wall: f"wall{wall.outer_ring}")
def test_walls_are_where_the_map_has_them(wall):
    vertices, faces = wall_mesh(wall, 0.02)
    radii = np.hypot(vertices[:, 0], vertices[:, 1])
    assert radii.min() == pytest.approx(wall.inner_radius)
    assert radii.max() == pytest.approx(wall.outer_radius)
    assert (vertices[:, 2].min(), vertices[:, 2].max()) == (0.0, 0.02)
    assert faces.max() == len(vertices) - 1
    angles = np.arctan2(vertices[:, 1], vertices[:, 0])
    for opening in wall.openings:  # no corner of a wall stands in an opening
        turned = np.angle(np.exp(1j * (angles - opening.angle)))
        near = np.abs(turned) < 0.5
        assert np.abs(radii * np.sin(turned))[near].min() == pytest.approx(0.5 * opening.width, abs=1e-9)


def test_names_out_of_files_are_no_html():
    text = facts_html(moment(leaf="<script>")) + facts_html(moment(result={"reason": "<i>", "success": False}))
    assert "<script>" not in text
    assert "<i>" not in text
    assert "no tree yet" in tree_html(Moment())
