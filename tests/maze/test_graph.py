from __future__ import annotations

import dataclasses
import itertools
import math
import time

import numpy as np
import pytest

from mazeplan.core.maths.angles import difference
from mazeplan.maze.geometry import Maze
from mazeplan.maze.graph import DISC_S, SERVO_LAG_S, Route, RouteGraph
from mazeplan.maze.mapfile import load_map

CME, LOPSIDED = load_map("cme"), load_map("lopsided")
MAZES = pytest.mark.parametrize("maze", [CME, LOPSIDED], ids=lambda maze: maze.name)


def route(graph: RouteGraph, start: int, goal: int, theta: float, avoid: tuple[str, ...] = ()) -> Route:
    found = graph.route(start, goal, theta, avoid)
    assert found is not None
    return found


def brute_force(graph: RouteGraph, start: int, goal: int, theta: float) -> float:
    """Least expected time over all routes that go straight in or straight out: the independent way."""
    maze = graph.maze
    step = 1 if goal > start else -1
    stages = [maze.openings_between(ring, ring + step) for ring in range(start, goal, step)]
    best = math.inf
    for choice in itertools.product(*stages):
        angle, ring, total = theta, start, 0.0
        for opening in choice:
            total += graph.cost(opening.name, ring, angle)
            angle, ring = opening.angle, ring + step
        best = min(best, total)
    return best


@MAZES
def test_route_between_every_pair_is_connected_and_the_fastest(maze: Maze):
    rng = np.random.default_rng(3)
    graph = RouteGraph(maze)
    numbers = [ring.number for ring in maze.rings]
    for start, goal in itertools.product(numbers, numbers):
        theta = rng.uniform(-10, 10)
        found = route(graph, start, goal, theta)
        ring, angle = start, theta
        for leg in found.legs:
            assert leg.ring == ring
            assert ring in (leg.opening.outer, leg.opening.inner)
            assert difference(angle + leg.turn_rad, leg.opening.angle) == pytest.approx(0.0, abs=1e-9)
            assert abs(leg.turn_rad) <= math.pi
            ring, angle = leg.opening.leads_to(ring), leg.opening.angle
        assert ring == goal
        assert found.expected_s == pytest.approx(sum(leg.expected_s for leg in found.legs))
        assert found.expected_s == pytest.approx(brute_force(graph, start, goal, theta) if start != goal else 0.0)


def test_start_is_goal():
    assert RouteGraph(CME).route(3, 3, 1.0) == Route((), 0.0)


def test_turn_is_signed_and_the_short_way_round():
    graph = RouteGraph(LOPSIDED)
    leg = route(graph, 1, 2, math.radians(17 + 20)).legs[0]
    assert (leg.opening.name, math.degrees(leg.turn_rad)) == ("1-2@17", pytest.approx(-20))
    leg = route(graph, 1, 2, math.radians(17 - 30)).legs[0]
    assert (leg.opening.name, math.degrees(leg.turn_rad)) == ("1-2@17", pytest.approx(30))
    leg = route(graph, 1, 2, math.radians(-5 + 720), avoid=("1-2@17",)).legs[0]
    assert (leg.opening.name, math.degrees(leg.turn_rad)) == ("1-2@100.5", pytest.approx(105.5))


@pytest.mark.parametrize("degrees", [1.0, 20.0, 44.0, 80.0, 130.0, 179.0])
def test_mirrored_start_gives_mirrored_route(degrees):
    graph = RouteGraph(CME)  # the map is symmetric about the x axis
    up, down = (route(graph, 1, 5, math.radians(sign * degrees)) for sign in (1, -1))
    assert up.expected_s == pytest.approx(down.expected_s)
    assert up.legs[0].turn_rad == pytest.approx(-down.legs[0].turn_rad)
    assert up.legs[0].opening.angle == pytest.approx(2 * math.pi - down.legs[0].opening.angle)


def test_travel_time_is_half_accelerating_half_braking():
    graph = RouteGraph(CME)
    a = 5 / 9 * 9.81 * math.sin(CME.tilt_limit)
    half = (graph.travel_s(1, math.pi / 3) - SERVO_LAG_S) / 2
    assert 2 * (0.5 * a * half**2) == pytest.approx(CME.track_radius(1) * math.pi / 3)
    assert graph.travel_s(1, -1.0) == graph.travel_s(1, 1.0)
    assert graph.travel_s(1, 0.0) == 0.0
    assert graph.travel_s(5, 3.0) == DISC_S


@MAZES
def test_closing_what_a_route_uses_leads_elsewhere_and_reopening_back(maze: Maze):
    graph = RouteGraph(maze)
    before = route(graph, 1, 3, 0.3)
    name = before.openings[0]
    graph.close(name)
    after = route(graph, 1, 3, 0.3)
    assert name not in after.openings
    assert after.expected_s >= before.expected_s
    assert graph.closed == {name}
    graph.reopen(name)
    assert graph.route(1, 3, 0.3) == before


@MAZES
def test_avoiding_is_closing_for_one_call(maze: Maze):
    graph = RouteGraph(maze)
    before = route(graph, 1, 2, 0.3)
    assert before.openings[0] not in route(graph, 1, 2, 0.3, avoid=before.openings).openings
    assert graph.route(1, 2, 0.3) == before
    assert graph.closed == frozenset()


@MAZES
def test_no_route_when_a_wall_is_closed(maze: Maze):
    graph = RouteGraph(maze)
    last = len(maze.rings)
    for opening in maze.openings_between(last - 1, last):
        assert graph.route(1, last, 0.0) is not None
        graph.close(opening.name)
    assert graph.route(1, last, 0.0) is None
    assert graph.route(last, 1, 0.0) is None
    assert graph.route(1, last - 1, 0.0) is not None
    for opening in maze.openings:
        graph.close(opening.name)
    assert graph.route(1, 2, 0.0) is None
    assert graph.route(2, 2, 0.0) == Route((), 0.0)


def test_closed_in_the_map_starts_closed_and_can_be_opened():
    first = dataclasses.replace(CME.openings[0], closed=True)
    graph = RouteGraph(dataclasses.replace(CME, openings=(first, *CME.openings[1:])))
    assert graph.closed == {"1-2@45"}
    assert "1-2@45" not in route(graph, 1, 2, math.radians(45)).openings
    graph.reopen("1-2@45")
    assert route(graph, 1, 2, math.radians(45)).openings == ("1-2@45",)


def test_extra_cost_of_the_map_counts():
    first = dataclasses.replace(CME.openings[0], extra_cost=5.0)
    dear = RouteGraph(dataclasses.replace(CME, openings=(first, *CME.openings[1:])))
    assert dear.cost("1-2@45", 1, 0.2) == pytest.approx(RouteGraph(CME).cost("1-2@45", 1, 0.2) + 5.0)
    assert route(dear, 1, 2, math.radians(45)).openings != ("1-2@45",)


def test_failures_turn_the_route_away_and_successes_bring_it_back():
    graph = RouteGraph(CME)
    theta = math.radians(20)
    before = route(graph, 1, 2, theta)
    assert before.openings == ("1-2@45",)
    failures = 0
    while route(graph, 1, 2, theta).openings == before.openings:
        graph.record("1-2@45", success=False)
        failures += 1
        assert failures < 5
    assert graph.tries("1-2@45") == (0, failures)
    for _ in range(20):
        graph.record("1-2@45", success=True)
    assert route(graph, 1, 2, theta).openings == before.openings


def test_expected_attempts_is_the_mean_of_one_over_p():
    graph = RouteGraph(CME)
    for success in (True, True, False, False, False):
        graph.record("2-3@0", success)
    samples = np.random.default_rng(0).beta(5.0, 3.3, size=200_000)
    assert graph.expected_attempts("2-3@0") == pytest.approx(np.mean(1 / samples), rel=0.01)
    attempts = [graph.expected_attempts("2-3@0")]
    for _ in range(5):
        graph.record("2-3@0", success=True)
        attempts.append(graph.expected_attempts("2-3@0"))
    assert attempts == sorted(attempts, reverse=True)
    assert attempts[-1] >= 1.0


def test_graphs_of_two_runs_do_not_see_each_other():
    one, two = RouteGraph(CME), RouteGraph(CME)
    one.close("1-2@45")
    one.record("1-2@135", success=False)
    assert two.closed == frozenset()
    assert two.tries("1-2@135") == (0, 0)


def test_unknown_openings_and_rings():
    graph = RouteGraph(CME)
    for act in (graph.close, graph.reopen, graph.tries, lambda name: graph.record(name, True)):
        with pytest.raises(KeyError, match="no opening 'x'; there are 1-2@45"):
            act("x")
    for start, goal in ((0, 1), (1, 6), (6, 6)):
        with pytest.raises(IndexError, match="rings 1 to 5"):
            graph.route(start, goal, 0.0)
    with pytest.raises(ValueError, match="theta: got nan"):
        graph.route(1, 2, math.nan)


def test_fast_enough_for_a_control_tick():
    graph = RouteGraph(CME)
    times = []
    for theta in np.linspace(-3, 3, 50):
        begin = time.perf_counter()
        graph.route(1, 5, float(theta))
        times.append(time.perf_counter() - begin)
    assert np.median(times) < 2e-3


def test_choices_are_all_openings_that_lead_on_the_best_one_that_of_the_route():
    graph = RouteGraph(load_map("cme"))
    for ring, degrees in ((1, 10.0), (2, 100.0), (3, 200.0), (4, -80.0)):
        theta = math.radians(degrees)
        choices, route = graph.choices(ring, 5, theta), graph.route(ring, 5, theta)
        assert route is not None
        assert choices[0].opening == route.legs[0].opening
        assert choices[0].expected_s == pytest.approx(route.expected_s)
        assert [c.expected_s for c in choices] == sorted(c.expected_s for c in choices)
        for choice in choices:
            onward = graph.route(choice.opening.leads_to(ring), 5, choice.opening.angle)
            assert onward is not None
            passage = graph.passage_s(choice.opening.name)
            assert choice.onward_s >= passage + onward.expected_s - 1e-9  # without coming back through itself
            assert choice.travel_s == graph.travel_s(ring, difference(choice.opening.angle, theta))
    graph.close("1-2@45")
    assert "1-2@45" not in [c.opening.name for c in graph.choices(1, 5, 0.0)]
