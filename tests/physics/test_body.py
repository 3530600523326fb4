"""A ball with a body against closed forms: rolling, impacts, spin, stiction, openings; Newton and Euler in space."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numba import njit
from test_packed_walls import overlaps

from mazeplan.core.constants import GRAVITY
from mazeplan.core.maths.compiled import pointer_to
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.dynamics.plate import FELT_AT, ROW, PlateMotion, Tilting, plate_rows
from mazeplan.physics.dynamics.rigid_body import Ball, accelerated, advance, body_core, effects_of
from mazeplan.physics.dynamics.walls import SLAB, Walls, pack_walls

MAZE = load_map("cme")
R = MAZE.ball.radius
H = 1.0 / 300.0
SMOOTH = Ball(rolling=0.0, spin=0.0, wall=0.0, restitution=0.0, hold=1e9)


def open_floor(*slabs):
    """No walls but flat ones (cos, sin, half thickness) through the middle."""
    rows = np.array([[*slab, 0.0, 50.0] for slab in slabs], dtype=float).reshape(-1, SLAB)
    return Walls(np.zeros((0, 4)), np.zeros((0, 5)), rows, 100.0, R, 1e-3)


def still_rows(beta, gamma, count, start=0.0):
    """Rows under a tilt that stays."""
    plate = PlateMotion(0.0, 1.0, np.tile([beta, 0.0, 0.0, gamma, 0.0, 0.0], (3, 1)))
    out = np.zeros((count, ROW))
    plate_rows(plate, Tilting(), start + H * np.arange(count), H, 1, out)
    return out


def moved(ball, walls, rows, state, effects=None):
    """States (M, 5) behind each of the rows."""
    out = np.empty((len(rows), 5))
    advance(ball, walls, effects or effects_of(), rows, H, np.array(state, dtype=float), out)
    return out


@pytest.mark.parametrize(("inertia", "factor"), [(0.4, 5.0 / 7.0), (2.0 / 3.0, 0.6)])
def test_rolling_on_the_floor(inertia, factor):
    out = moved(SMOOTH._replace(inertia=inertia), open_floor(), still_rows(0.05, 0.0, 300), [1.0, 0.0, 0.0, 0.0, 0.0])
    assert out[-1, 2] == pytest.approx(factor * GRAVITY * math.sin(0.05), rel=1e-9)
    assert out[-1, 0] - 1.0 == pytest.approx(0.5 * factor * GRAVITY * math.sin(0.05), rel=1e-9)


def test_rolling_on_floor_and_wall():
    # gravity pulls along x and against a wall along the x axis, below the ball
    ball, walls = SMOOTH._replace(wall=0.5), open_floor((1.0, 0.0, 0.002))
    out = moved(ball, walls, still_rows(0.03, 0.04, 300), [1.0, 0.002 + R, 0.0, 0.0, 0.0])
    assert out[-1, 2] == pytest.approx(5.0 / 9.0 * GRAVITY * math.sin(0.03), rel=1e-4)
    assert out[-1, 1] == pytest.approx(0.002 + R, abs=1e-5)
    assert out[-1, 4] == pytest.approx(-out[-1, 2], rel=1e-9)  # the tangent of a wall below points to -x


def test_sliding_along_a_wall():
    ball, walls = SMOOTH._replace(wall=0.05), open_floor((1.0, 0.0, 0.002))
    out = moved(ball, walls, still_rows(0.06, 0.04, 300), [1.0, 0.002 + R, 0.0, 0.0, 0.0])
    pull = GRAVITY * (math.sin(0.06) - 0.05 * math.cos(0.06) * math.sin(0.04))
    assert out[-1, 2] == pytest.approx(5.0 / 7.0 * pull, rel=1e-3)


def test_a_slow_ball_comes_back_with_its_restitution_and_a_fast_one_with_less():
    walls, rows = open_floor((0.0, 1.0, 0.002)), still_rows(0.0, 0.0, 60)
    ball = SMOOTH._replace(restitution=0.5, hold=0.02)
    for u in (0.02, 0.03, 0.1, 0.12):
        out = moved(ball, walls, rows, [0.002 + R + 0.1 * u, 1.0, -u, 0.0, 0.0])
        wanted = u * min(0.5, (0.5 - 0.4 + 0.02 / u) / 1.4)
        assert out[-1, 2] == pytest.approx(wanted, rel=1e-9)


def test_an_impact_depends_continuously_on_where_it_comes_from():
    walls, rows = open_floor((0.0, 1.0, 0.002)), still_rows(0.0, 0.0, 60)
    ball, u = SMOOTH._replace(restitution=0.4), 0.1
    ends = [
        moved(ball, walls, rows, [0.002 + R + 0.01 + d, 1.0, -u, 0.0, 0.0])[-1, 0] for d in np.linspace(0, 1e-3, 50)
    ]
    steps = np.diff(ends) / np.diff(np.linspace(0, 1e-3, 50))
    np.testing.assert_allclose(steps, -0.4, atol=1e-9)  # a longer way to the wall is a shorter one back


def test_a_rough_wall_makes_the_ball_roll_on_it():
    walls, rows = open_floor((0.0, 1.0, 0.002)), still_rows(0.0, 0.0, 60)
    v_t, w, k = 0.05, 0.01, 0.4
    out = moved(SMOOTH._replace(wall=9.0), walls, rows, [0.002 + R + 1e-3, 1.0, -0.1, v_t, w])
    together = ((1.0 + k) * v_t + k * w) / (1.0 + 2.0 * k)  # the impulse gives the one what it takes from the other
    np.testing.assert_allclose(out[-1, 3:], together, rtol=1e-9)
    little = moved(SMOOTH._replace(wall=0.05), walls, rows, [0.002 + R + 1e-3, 1.0, -0.1, v_t, w])
    impulse = 0.05 * (1.0 + k) * 0.1
    np.testing.assert_allclose(little[-1, 3:], [v_t - impulse / (1.0 + k), w + impulse / k], rtol=1e-9)


def test_rolling_friction_at_a_wall_slows_a_ball_that_rolls_along_it():
    share, v, k = 0.05, 0.2, 0.4
    ball, walls = SMOOTH._replace(wall=9.0, wall_rolling=share), open_floor((1.0, 0.0, 0.002))
    out = moved(ball, walls, still_rows(0.0, 0.04, 300), [1.0, 0.002 + R, v, 0.0, -v])
    slower = share * GRAVITY * math.sin(0.04) / (1.0 + 2.0 * k)  # for one second; energy (1 + 2 k) v^2 / 2 per mass
    assert v - out[-1, 2] == pytest.approx(slower, rel=0.05)
    assert out[-1, 4] == pytest.approx(-out[-1, 2], rel=0.01)


def test_rolling_friction_at_a_wall_stops_a_spin_and_never_turns_it():
    walls, rows = open_floor((0.0, 1.0, 0.002)), still_rows(0.0, 0.0, 60)
    for w, left in ((0.5, 0.5 - 0.7 * 0.1 * 1.4 / 0.4), (-0.5, -0.5 + 0.7 * 0.1 * 1.4 / 0.4), (0.1, 0.0), (-0.1, 0.0)):
        out = moved(SMOOTH._replace(wall_rolling=0.7), walls, rows, [0.002 + R + 1e-3, 1.0, -0.1, 0.0, w])
        assert out[-1, 4] == pytest.approx(left, abs=1e-12)


def test_dead_stop_below_stiction_and_none_above():
    ball = SMOOTH._replace(rolling=0.1)
    held = moved(ball, open_floor(), still_rows(0.7 * math.asin(0.1 / GRAVITY), 0.0, 600), [1.0, 0.0, 0.0, 0.02, 0.0])
    assert np.all(held[-200:, 2:4] == 0.0)
    assert np.ptp(held[-200:, 0]) == 0.0
    gone = moved(ball, open_floor(), still_rows(1.1 * math.asin(0.1 / GRAVITY), 0.0, 600), [1.0, 0.0, 0.0, 0.0, 0.0])
    assert gone[-1, 2] == pytest.approx(2.0 * 5.0 / 7.0 * 0.01, rel=0.01)


def test_rolling_and_spinning_share_their_friction():
    ball, rows = SMOOTH._replace(rolling=0.07, spin=0.03), still_rows(0.0, 0.0, 1)
    alone = moved(ball, open_floor(), rows, [1.0, 0.0, 0.1, 0.0, 0.0])[0]
    assert 0.1 - alone[2] == pytest.approx(H * 0.07 * 5.0 / 7.0)
    both = moved(ball, open_floor(), rows, [1.0, 0.0, 0.1, 0.0, -0.2])[0]
    size = math.hypot(0.07 * 0.1, 0.03 * 0.2)
    assert 0.1 - both[2] == pytest.approx(H * 0.07 * 5.0 / 7.0 * 0.07 * 0.1 / size)
    assert both[4] + 0.2 == pytest.approx(H * 0.03 / 0.4 * 0.03 * 0.2 / size)


def energy(out, k):
    """Per mass, of a level plate, (M,)."""
    return 0.5 * (1.0 + k) * (out[:, 2] ** 2 + out[:, 3] ** 2) + 0.5 * k * out[:, 4] ** 2


@pytest.mark.parametrize("seed", range(12))
def test_energy_never_grows(seed):
    rng = np.random.default_rng(seed)
    ball = Ball(rng.choice([0.4, 2 / 3]), 0.0, wall=rng.uniform(0, 1), restitution=rng.uniform(0, 0.9), hold=0.02)
    ring = MAZE.ring(int(rng.integers(1, 5)))
    angle = rng.uniform(-math.pi, math.pi)
    start = [ring.track_radius * math.cos(angle), ring.track_radius * math.sin(angle), *rng.normal(0.0, 0.15, 3)]
    out = moved(ball, pack_walls(MAZE), still_rows(0.0, 0.0, 900), start)
    left = energy(out, ball.inertia)
    assert np.all(np.diff(left) <= 1e-15)
    assert np.count_nonzero(np.diff(left) < 0.0) > 3  # it did meet walls


PASSING = range(5)  # seeds with which the ball finds an opening


@pytest.mark.parametrize("seed", range(6))
def test_a_ball_passes_openings_and_never_a_wall(seed):
    rng, count = np.random.default_rng(seed), 6000
    t = np.arange(0.0, H * count + 1.0, 0.01)
    motion = np.zeros((len(t), 6))
    for at in (0, 3):
        for amplitude, speed, phase in zip(
            rng.uniform(0.02, 0.06, 3), rng.uniform(1, 6, 3), rng.uniform(0, 6, 3), strict=True
        ):
            motion[:, at] += amplitude * np.sin(speed * t + phase)
            motion[:, at + 1] += amplitude * speed * np.cos(speed * t + phase)
            motion[:, at + 2] -= amplitude * speed**2 * np.sin(speed * t + phase)
    rows = np.zeros((count, ROW))
    plate_rows(PlateMotion(0.0, 0.01, motion), Tilting(), H * np.arange(count), H, 1, rows)
    walls = pack_walls(MAZE)
    out = moved(Ball(), walls, rows, [MAZE.track_radius(2), 0.0, 0.0, 0.0, 0.0])
    assert overlaps(walls, out[:, :2]).max() < 3e-4  # what one step may leave between two walls
    r = np.hypot(out[:, 0], out[:, 1])
    rings = np.array([MAZE.ring_at(x) for x in r])
    changes = np.flatnonzero(np.diff(rings))
    if seed in PASSING:
        assert len(changes) > 0
    for i in changes:
        angle = math.atan2(out[i, 1], out[i, 0])
        ways = MAZE.openings_between(int(rings[i]), int(rings[i + 1]))
        assert abs(rings[i] - rings[i + 1]) == 1
        assert (
            min(abs(r[i] * math.sin(angle - way.angle)) for way in ways) < 0.5 * max(w.width for w in ways) - R + 3e-4
        )


def test_newton_and_euler_in_space():
    """Along the motion that the model gives, force and torque in the resting frame must fit: the one force at the point
    of contact makes both, and no torque acts about the vertical."""
    ball, rng = SMOOTH._replace(inertia=0.4, height=0.011), np.random.default_rng(5)
    for _ in range(5):
        (b, b1, b2), (c, c1, c2) = rng.normal(0.0, [0.1, 0.5, 5.0], (2, 3))
        x, y, vx, vy, w = rng.normal(0.0, [0.06, 0.06, 0.2, 0.2, 0.2])
        plate = PlateMotion(-1.0, 1.0, np.tile([b, b1, b2, c, c1, c2], (3, 1)))
        rows = np.zeros((1, ROW))
        plate_rows(PlateMotion(-1.0, 1e9, plate.motion), Tilting(), np.array([-1.0]), 0.0, 1, rows)
        ax, ay, aw, n = _accelerated(ball, open_floor(), effects_of(), rows, x, y, vx, vy, w)

        def standing(t, b=b, b1=b1, b2=b2, c=c, c1=c1, c2=c2):
            p, q = b + b1 * t + 0.5 * b2 * t * t, c + c1 * t + 0.5 * c2 * t * t
            about_y = np.array([[math.cos(p), 0, math.sin(p)], [0, 1, 0], [-math.sin(p), 0, math.cos(p)]])
            return about_y @ np.array([[1, 0, 0], [0, math.cos(q), -math.sin(q)], [0, math.sin(q), math.cos(q)]])

        def place(t, o=(x, y, vx, vy, ax, ay)):
            return standing(t) @ [o[0] + o[2] * t + o[4] * t * t / 2, o[1] + o[3] * t + o[5] * t * t / 2, 0.011]

        def turning(t, o=(vx, vy, w, ax, ay, aw)):
            d = 1e-5
            skew = (standing(t + d) - standing(t - d)) / (2.0 * d) @ standing(t).T
            own = np.array([-(o[1] + o[4] * t), o[0] + o[3] * t, o[2] + o[5] * t]) / R
            return np.array([skew[2, 1], skew[0, 2], skew[1, 0]]) + standing(t) @ own

        d, normal = 1e-3, standing(0.0)[:, 2]
        force = (place(d) - 2.0 * place(0.0) + place(-d)) / d**2 + [0.0, 0.0, GRAVITY]
        torque = 0.4 * R * R * (turning(d) - turning(-d)) / (2.0 * d)
        np.testing.assert_allclose(torque, np.cross(-R * normal, force), atol=2e-5)
        assert force @ normal == pytest.approx(n, rel=1e-4)


@njit
def _accelerated(ball, walls, effects, rows, x, y, vx, vy, w):
    return accelerated(body_core(ball, walls, effects), pointer_to(rows, 0), x, y, vx, vy, w)


def test_rows_hold_what_effects_may_ask_for():
    row = still_rows(0.01, 0.02, 1)[0, :FELT_AT]
    assert row[:6] == pytest.approx([0.01, 0.0, 0.0, 0.02, 0.0, 0.0], abs=1e-15)
