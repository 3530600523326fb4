"""What is to be seen is in the picture, whatever the window, until somebody moves the camera."""

from __future__ import annotations

import asyncio
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from mazeplan.apps.view.camera import FOV, SHARE, Framing, Layout, around, fitted
from mazeplan.apps.view.replay.tab import layouts
from mazeplan.maze.mapfile import load_map

MAZE = load_map("cme")
WIDE, NARROW = 1.6, 0.5
PLATE = Layout(around(1.0, low=-0.3, high=0.2))
SIDE_BY_SIDE, BELOW = layouts({"A": MAZE, "B": MAZE}, MAZE.walls[0].outer_radius)


def in_picture(layout, view, aspect):
    """(N, 2): right of and above the middle; at an edge 1."""
    eye, look_at = np.array(view.position), np.array(view.look_at)
    forth = (look_at - eye) / np.linalg.norm(look_at - eye)
    right = np.cross(forth, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    off, high = layout.points - eye, np.tan(0.5 * FOV)
    depth = off @ forth
    return np.column_stack([off @ right / (high * aspect), off @ np.cross(right, forth) / high]) / depth[:, None]


@pytest.mark.parametrize("aspect", [0.3, NARROW, 1.0, WIDE, 3.0])
@pytest.mark.parametrize("layout", [PLATE, SIDE_BY_SIDE, BELOW])
def test_all_of_it_is_seen_as_large_as_can_be_and_in_the_middle(layout, aspect):
    seen = in_picture(layout, fitted(layout, aspect), aspect)
    least, most = seen.min(axis=0), seen.max(axis=0)
    assert abs(seen).max() == pytest.approx(SHARE, abs=1e-6)
    np.testing.assert_allclose(0.5 * (least + most), 0.0, atol=0.02)


def test_two_mazes_do_not_overlap():
    for layout in (SIDE_BY_SIDE, BELOW):
        first, second = (np.array(place) for place in layout.frames.values())
        assert np.linalg.norm(first - second) > 20.0 * MAZE.walls[0].outer_radius


class Camera(SimpleNamespace):
    """Of a browser of viser: says how large its picture is."""

    image_width, image_height = 0, 0

    def on_update(self, call):
        self.told = call

    def of(self, width, height):
        self.image_width, self.image_height = width, height
        asyncio.run(self.told(self))
        return self.position


@pytest.fixture
def page():
    clients, calls = {}, SimpleNamespace()
    server = SimpleNamespace(
        initial_camera=SimpleNamespace(), get_clients=lambda: clients,
        on_client_connect=lambda call: setattr(calls, "joined", call),
        on_client_disconnect=lambda call: setattr(calls, "left", call),
    )  # fmt: skip
    framing = Framing(server)

    def join(width, height):
        client = SimpleNamespace(client_id=len(clients), atomic=nullcontext, frames={})
        client.scene = SimpleNamespace(add_frame=lambda name, position, **more: client.frames.update({name: position}))
        first = server.initial_camera
        client.camera = Camera(client=client, position=first.position, look_at=first.look_at)
        client.camera.image_width, client.camera.image_height = width, height
        clients[client.client_id] = client
        asyncio.run(calls.joined(client))
        return client

    return SimpleNamespace(framing=framing, join=join, initial=server.initial_camera)


def test_each_window_has_a_camera_of_its_own_that_follows_its_size(page):
    page.framing.show(PLATE)
    wide, narrow = page.join(1600, 1000).camera, page.join(300, 600).camera
    assert wide.position == fitted(PLATE, 1.6).position
    assert narrow.position == fitted(PLATE, 0.5).position
    assert narrow.of(900, 600) == fitted(PLATE, 1.5).position
    assert wide.position == fitted(PLATE, 1.6).position


def test_who_moves_the_camera_keeps_it_until_he_gives_the_view_back(page):
    page.framing.show(PLATE)
    camera = page.join(900, 600).camera
    camera.position = mine = (1.0, -1.0, 2.0)
    assert camera.of(300, 600) == mine
    camera.position, camera.look_at = page.initial.position, page.initial.look_at  # Reset View
    assert camera.of(300, 600) == fitted(PLATE, 0.5).position


def test_what_is_to_be_seen_may_become_another(page):
    page.framing.show(PLATE)
    camera, larger = page.join(900, 600).camera, Layout(around(2.0))
    page.framing.show(larger)
    assert camera.position == fitted(larger, 1.5).position


def test_a_narrow_window_has_one_maze_below_the_other(page):
    page.framing.show(SIDE_BY_SIDE, BELOW)
    assert page.join(1600, 800).frames == {}  # as the page has them
    narrow = page.join(400, 800)
    assert narrow.frames == BELOW.frames
    narrow.camera.of(1600, 800)
    assert narrow.frames == SIDE_BY_SIDE.frames
