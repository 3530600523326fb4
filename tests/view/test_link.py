"""The page's process and its line: a run never waits for it, whatever the page does."""

from __future__ import annotations

import os
import signal
from time import perf_counter, sleep

import pytest
from soon import soon

from mazeplan.apps.view.link import MOST, WAITING, Offer, PageLink
from mazeplan.apps.view.server import listen, port_of
from mazeplan.maze.mapfile import dump_map, load_map

pytest.importorskip("viser")
from page_client import Viewer

MAZE = load_map("cme")
HEADER = {"map": dump_map(MAZE), "goal_ring": 5, "replay": {"rate_hz": 30.0}}
TREE = {"t": 0.0, "paths": ["a"], "kinds": ["Sequence"], "names": ["a first node"], "parents": [-1]}
BALL = "/plate/ball"


def tick(k):
    return {"t": k / 30, "x": 0.08, "y": 1e-4 * k, "beta": 1e-4 * k, "gamma": 0.0, "u_beta": 0.0, "u_gamma": 0.0}


@pytest.fixture(scope="module")
def page():
    """A page of its own process; orders are kept."""
    listening = listen(0)
    port = port_of(listening)
    orders = []
    with PageLink(Offer(MAZE, "toy", {"frames_lost": "no picture"}), listening, orders.append) as link:
        listening.close()
        link.take("/header", 0.0, HEADER)
        link.take("/tree", 0.0, TREE)
        link.take("/tick", 0.0, tick(0))
        yield link, port, orders


def shown(viewer, text):
    return soon(lambda: any(text in html for html in viewer.html.values()))


def moves(viewer):
    return len(viewer.moved.get(BALL, []))


def test_what_a_run_tells_is_shown_and_what_is_pressed_arrives(page):
    link, port, orders = page
    viewer = Viewer(port)
    assert shown(viewer, "a first node")
    assert soon(lambda: link.viewers == 1)
    assert link.opened.is_set()
    before = moves(viewer)
    link.take("/tick", 0.1, tick(1))
    assert soon(lambda: moves(viewer) > before)
    viewer.trigger("Emergency stop")
    for label in ("Start", "Stop", "Inject"):
        viewer.press(label)
    viewer.choose("Go to ring", "3")
    viewer.choose("Use", "close")
    assert soon(lambda: len(orders) == 6)
    assert sorted(orders, key=str) == sorted(
        [
            {"do": "level"}, {"do": "start"}, {"do": "stop"}, {"do": "fault", "kind": "frames_lost"},
            {"do": "goal", "ring": 3}, {"do": "close", "opening": MAZE.openings[0].name},
        ],
        key=str,
    )  # fmt: skip
    viewer.close()
    assert soon(lambda: link.viewers == 0)


def test_a_page_that_hangs_costs_the_run_no_time_and_no_memory(page):
    """It is stopped as a whole: the pipe fills, then the queue, and the rest is left out, but not what is rare."""
    link, port, _ = page
    os.kill(link._process.pid, signal.SIGSTOP)
    try:
        longest, padding = 0.0, "x" * 2000
        for k in range(3 * MOST):
            began = perf_counter()
            link.take("/tick", k / 30, {**tick(k), "padding": padding})
            longest = max(longest, perf_counter() - began)

        def full():  # the thread that sends may have emptied the queue once more, if it only now had its turn
            for k in range(WAITING):
                link.take("/tick", 0.0, {**tick(k), "padding": padding})
            sleep(0.1)
            return len(link._queue) >= WAITING

        assert soon(full)
        link.take("/tree", 0.3, {**TREE, "names": ["after the rest"]})
        assert len(link._queue) <= WAITING + 1
        assert longest < 0.25  # the machine is shared; a wait would be for good
    finally:
        os.kill(link._process.pid, signal.SIGCONT)
    viewer = Viewer(port)
    assert shown(viewer, "after the rest")
    viewer.close()


def test_a_page_that_dies_is_told_and_the_run_goes_on(capsys):
    listening = listen(0)
    port = port_of(listening)
    with PageLink(Offer(MAZE, "toy"), listening, lambda order: None) as link:
        listening.close()
        viewer = Viewer(port)
        assert soon(lambda: link.viewers)
        os.kill(link._process.pid, signal.SIGKILL)
        assert link.ended.wait(20.0)
        assert soon(lambda: "the run goes on without it" in capsys.readouterr().err)
        for k in range(10):
            link.take("/tick", 0.0, tick(k))
        viewer.close()
