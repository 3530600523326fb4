"""What happened at openings: it fades, and weighs in routes."""

from __future__ import annotations

import math

import pytest

from mazeplan.maze.graph import OpeningMemory, RouteGraph
from mazeplan.maze.mapfile import load_map

CME = load_map("cme")


def test_counts_fade_by_the_time_that_passes():
    memory = OpeningMemory(fading_s=50.0)
    memory.record("a", success=False, now=10.0)
    memory.record("a", success=True, now=60.0)
    assert memory.tries("a", 60.0) == pytest.approx((1.0, math.exp(-1.0)))
    assert memory.tries("a", 110.0) == pytest.approx((math.exp(-1.0), math.exp(-2.0)))
    assert memory.tries("b", 110.0) == (0.0, 0.0)


def test_an_opening_that_failed_is_as_good_as_new_after_a_while():
    graph, theta = RouteGraph(CME), math.radians(20.0)
    for _ in range(5):
        graph.record("1-2@45", success=False)

    def chosen():
        found = graph.route(1, 2, theta)
        return found is not None and found.openings

    assert chosen() != ("1-2@45",)
    graph.now = 10.0 * graph.memory.fading_s
    assert chosen() == ("1-2@45",)
