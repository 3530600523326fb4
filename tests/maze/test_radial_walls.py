"""Radial walls: ways along a ring that has some, and routes over random mazes against a flood fill of their floor."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import label
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from mazeplan.core.maths.angles import difference
from mazeplan.maze.geometry import Ball, Maze, Opening, RadialWall, Ring, leading_to, regions
from mazeplan.maze.graph import RouteGraph
from mazeplan.maze.mapfile import check_text, dump_map, load_map

CME, DETOUR = load_map("cme"), load_map("detour")
R_STEP, TURNS = 1.5e-3, 720  # m, and cells of a turn, of the flood fill
RANDOM = 60  # mazes


def degrees(value: float | None) -> float | None:
    return None if value is None else math.degrees(value)


def walled(*walls: tuple[int, float]) -> Maze:
    """cme with radial walls 5 mm thick, by ring and degrees."""
    text = dump_map(CME) + "radial_walls:\n"
    text += "".join(f"  - {{ring: {ring}, angle_deg: {angle}, thickness_mm: 5}}\n" for ring, angle in walls)
    maze = check_text(text).maze
    assert maze is not None
    return maze


# -- along a ring --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("start", [-7.0, 0.0, 1.0, 3.0])
@pytest.mark.parametrize("end", [-2.0, 0.5, 6.0])
def test_without_walls_it_is_the_shorter_turn_to_the_last_bit(start, end):
    assert CME.turn(1, start, end) == difference(end, start)


@pytest.mark.parametrize(
    ("start", "end", "turn"),
    [(20, 40, 20), (350, 10, -340), (10, 350, 340), (5, 355, 350), (180, 10, -170), (370, 20, 10), (-20, 300, -40)],
)
def test_a_single_wall_leaves_one_way_even_if_it_is_the_long_one(start, end, turn):
    maze = walled((1, 0.0))
    assert degrees(maze.turn(1, math.radians(start), math.radians(end))) == pytest.approx(turn)
    assert degrees(maze.turn(2, math.radians(350), math.radians(10))) == pytest.approx(20)  # another ring is free


@pytest.mark.parametrize(
    ("start", "end", "turn"), [(100, 20, -80), (20, 100, 80), (200, 20, None), (350, 190, -160), (10, 350, None)]
)
def test_two_walls_keep_two_sectors_apart(start, end, turn):
    maze = walled((1, 180.0), (1, 0.0))
    found = degrees(maze.turn(1, math.radians(start), math.radians(end)))
    assert found is None if turn is None else found == pytest.approx(turn)
    assert (maze.sector(1, math.radians(start)) == maze.sector(1, math.radians(end))) == (turn is not None)


@pytest.mark.parametrize("theta", [-40.0, -3.0, 0.0, 2.0, 90.0, 361.0])
def test_a_ball_is_placed_beside_a_wall_at_the_nearest_place_with_room(theta):
    maze = walled((1, 0.0))
    r, need = maze.track_radius(1), 0.0025 + maze.ball.radius

    def room(angle: float) -> float:
        return r * abs(math.sin(angle)) if math.cos(angle) > 0.0 else math.inf

    placed, wished = maze.clear_angle(1, math.radians(theta)), math.radians(theta)
    assert room(placed) > need
    if room(wished) > need + 3e-4:
        assert placed == wished
    else:
        assert room(placed) < need + 3e-4  # no further than needed
        assert abs(placed - wished) <= math.asin((need + 3e-4) / r) + 1e-9


# -- whole mazes -----------------------------------------------------------------------------------------------------


def random_maze(rng: np.random.Generator) -> Maze:
    """Three to five rings with a few openings, some closed, and radial walls where they may stand."""
    count = int(rng.integers(3, 6))
    disc = rng.uniform(0.03, 0.06)
    rings = tuple(
        Ring(n, 0.0 if n == count else disc + (count - n) * 0.02 - 0.0154, disc + (count - n) * 0.02)
        for n in range(1, count + 1)
    )
    openings = [
        Opening(f"{n}{k}", n, n + 1, math.radians(round(float(angle))), 0.015, bool(rng.random() < 0.1))
        for n in range(1, count)
        for k, angle in enumerate(rng.uniform(0.0, 359.0, int(rng.integers(2, 6))))
    ]
    walls = [
        RadialWall(f"w{n}{k}", n, math.radians(round(float(angle))), 0.003)
        for n in range(1, count)
        for k, angle in enumerate(rng.uniform(0.0, 359.0, int(rng.integers(2, 12))))
    ]
    maze = Maze("random", Ball(0.00635, 0.0084), rings, tuple(openings), 0.087, 0.02)
    kept: list[RadialWall] = []
    for wall in walls:
        ok = all(abs(difference(wall.angle, w.angle)) > 0.25 for w in kept if w.ring == wall.ring)
        r = maze.ring(wall.ring).inner_radius
        needed = math.asin(0.0015 / r) + math.asin(0.0075 / r)
        ok = ok and all(abs(difference(wall.angle, o.angle)) > needed for o in maze.openings_of(wall.ring))
        kept += [wall] if ok else []
    return Maze("random", maze.ball, rings, maze.openings, 0.087, 0.02, radial_walls=tuple(kept))


class Floor:
    """The floor as cells of r and theta, those that openings and rings join labelled alike. It knows no sectors and no
    graph: a cell is free or it is wall."""

    def __init__(self, maze: Maze, closed: frozenset[str]) -> None:
        self.maze = maze
        r = (np.arange(math.ceil(maze.rings[0].outer_radius / R_STEP)) + 0.5) * R_STEP
        theta = (np.arange(TURNS) + 0.5) * math.tau / TURNS
        rr, tt = np.meshgrid(r, theta, indexing="ij")
        x, y = rr * np.cos(tt), rr * np.sin(tt)
        free = np.zeros(rr.shape, dtype=bool)
        for ring in maze.rings:
            free |= (rr >= ring.inner_radius) & (rr <= ring.outer_radius)
        for o in maze.openings:
            along, across = _frame(x, y, o.angle)
            inside = (rr >= maze.ring(o.inner).outer_radius - R_STEP) & (rr <= maze.ring(o.outer).inner_radius + R_STEP)
            free |= inside & (along > 0.0) & (np.abs(across) < 0.5 * o.width) & (o.name not in closed)
        for w in maze.radial_walls:
            along, across = _frame(x, y, w.angle)
            ring = maze.ring(w.ring)
            inside = (rr >= ring.inner_radius - R_STEP) & (rr <= ring.outer_radius + R_STEP)
            free &= ~(inside & (along > 0.0) & (np.abs(across) < 0.5 * w.thickness))
        found: Any = label(free)
        labels, count = found
        joined = coo_array((np.ones(len(r)), (labels[:, -1], labels[:, 0])), (count + 1, count + 1))  # the turn closes
        joined.data[(labels[:, -1] == 0) | (labels[:, 0] == 0)] = 0.0
        joined.eliminate_zeros()
        self.labels = np.where(free, 1 + connected_components(joined, directed=False)[1][labels], 0)

    def at(self, ring: int, theta: float) -> int:
        r = self.maze.track_radius(ring)
        return int(self.labels[int(r / R_STEP), int(theta % math.tau / math.tau * TURNS) % TURNS])

    def reaches(self, ring: int, theta: float, goal: int) -> bool:
        r, here = self.maze.track_radius(goal), self.at(ring, theta)
        return bool((self.labels[int(r / R_STEP)] == here).any())


def _frame(x: np.ndarray, y: np.ndarray, angle: float) -> tuple[np.ndarray, np.ndarray]:
    c, s = math.cos(angle), math.sin(angle)
    return c * x + s * y, -s * x + c * y


@lru_cache
def floors() -> list[tuple[Maze, Floor]]:
    rng = np.random.default_rng(20)
    mazes = [random_maze(rng) for _ in range(RANDOM)]
    return [(maze, Floor(maze, frozenset(o.name for o in maze.openings if o.closed))) for maze in mazes]


def clear_places(maze: Maze, rng: np.random.Generator) -> list[tuple[int, float]]:
    """A few (ring, theta) on tracks, not in walls."""
    places = [(int(rng.integers(1, len(maze.rings) + 1)), float(rng.uniform(-4.0, 7.0))) for _ in range(8)]
    return [(ring, maze.clear_angle(ring, theta)) for ring, theta in places]


def test_the_random_mazes_have_dead_ends_and_detours():
    cut_off = sum(len(leading_to(m, len(m.rings))) < len(regions(m)) for m, _ in floors())
    routes = []
    for maze, _ in floors():
        graph, last = RouteGraph(maze), len(maze.rings)
        routes += [graph.route(n, last, maze.clear_angle(n, theta)) for n in range(1, last) for theta in (0, 2, 4)]
    detours = [r for r in routes if r and len({leg.ring for leg in r.legs}) < len(r.legs)]
    assert cut_off > RANDOM / 4
    assert len(detours) >= 3  # some ring is left and entered again


def test_there_is_a_route_exactly_where_the_floor_is_joined():
    rng, found = np.random.default_rng(21), {True: 0, False: 0}
    for maze, floor in floors():
        graph = RouteGraph(maze)
        for ring, theta in clear_places(maze, rng):
            goal = int(rng.integers(1, len(maze.rings) + 1))
            joined = ring == goal or floor.reaches(ring, theta, goal)
            assert (graph.route(ring, goal, theta) is not None) == joined, (dump_map(maze), ring, theta, goal)
            assert bool(ring == goal or graph.choices(ring, goal, theta)) == joined
            found[joined] += 1
    assert min(found.values()) > 40


def test_regions_from_which_a_ring_is_reached_are_those_of_the_flood_fill():
    for maze, floor in floors():
        last, closed = len(maze.rings), [o.name for o in maze.openings if o.closed]
        leading = leading_to(maze, last, closed)
        for ring, n in regions(maze):
            walls = maze.radial_walls_of(ring)
            theta = 0.3 if not walls else walls[n].angle + 0.12  # just behind the wall that begins the sector
            assert ((ring, n) in leading) == floor.reaches(ring, theta, last)


def along(floor: Floor, ring: int, start: float, turn: float) -> bool:
    """Whether the ring is free all the way."""
    thetas = start + np.linspace(0.0, 1.0, 2 + math.ceil(abs(turn) / math.radians(0.2))) * turn
    return all(floor.at(ring, float(theta)) for theta in thetas)


def fastest(graph: RouteGraph, floor: Floor, ring: int, theta: float, goal: int, left: float, used: frozenset) -> float:
    """Least time of all ways that pass no opening twice in the same direction; inf beyond `left`."""
    if ring == goal:
        return 0.0
    best = left
    for o in graph.maze.openings_of(ring):
        if o.name in graph.closed or (o.name, ring) in used:
            continue
        short = difference(o.angle, theta)
        turns = [t for t in (short, short - math.copysign(math.tau, short)) if along(floor, ring, theta, t)]
        if turns:
            cost = graph.travel_s(ring, min(turns, key=abs)) + graph.passage_s(o.name)
            if cost < best:
                onward = used | {(o.name, ring)}
                there = o.leads_to(ring)
                best = min(best, cost + fastest(graph, floor, there, o.angle, goal, best - cost, onward))
    return best if best < left else math.inf


@pytest.mark.slow
def test_routes_are_free_all_the_way_and_the_fastest_of_all():
    rng, checked = np.random.default_rng(22), 0
    for maze, floor in floors()[:25]:
        graph, last = RouteGraph(maze), len(maze.rings)
        for ring, theta in clear_places(maze, rng)[:2]:
            found = graph.route(ring, last, theta)
            if found is None:
                continue
            angle = theta
            for leg in found.legs:
                assert leg.ring == last or along(floor, leg.ring, angle, leg.turn_rad)
                assert abs(difference(angle + leg.turn_rad, leg.opening.angle)) < 1e-9
                angle = leg.opening.angle
            best = fastest(graph, floor, ring, theta, last, found.expected_s + 0.1, frozenset())
            assert found.expected_s == pytest.approx(best, abs=1e-9)
            checked += len(found.legs) > 0
    assert checked > 10


# -- the packaged one --------------------------------------------------------------------------------------------------


def test_the_packaged_detour_leaves_a_ring_outwards_and_comes_back():
    found = RouteGraph(DETOUR).route(1, 4, math.radians(120.0))
    assert found is not None
    assert found.openings == ("1-2@60", "2-3@140", "2-3@215", "2-3@258", "3-4@20")
    assert [leg.ring for leg in found.legs] == [1, 2, 3, 2, 3]
    assert math.degrees(found.legs[0].turn_rad) == pytest.approx(300.0)  # 60 degrees the other way are walled off


def test_out_of_a_dead_end_the_way_is_back():
    found = RouteGraph(DETOUR).route(2, 4, math.radians(325.0))
    assert found is not None
    assert found.openings[:2] == ("1-2@325", "1-2@60")


def test_a_map_with_radial_walls_is_read_as_it_was_written():
    assert check_text(dump_map(DETOUR)).maze == DETOUR
    assert "radial_walls" not in dump_map(CME)
