"""The ball with a body against an integrator that shares nothing with it (`plainball`)."""

from __future__ import annotations

import math

import numpy as np
import plainball
import pytest

from mazeplan.physics.dynamics.plate import ROW, PlateMotion, Tilting, plate_rows
from mazeplan.physics.dynamics.rigid_body import Ball, advance, effects_of
from mazeplan.physics.dynamics.walls import GAP, SLAB, Walls

TABLE = (0.003, -0.004)


def channel(toy):
    """Its walls, without an opening."""
    wall = np.array([[toy.inner - 0.003, toy.inner - 1e-3, 0.0, 0.0]])
    return Walls(wall, np.zeros((0, GAP)), np.zeros((0, SLAB)), toy.outer, toy.radius, 1e-3)


def body_of(toy):
    """The same ball; a floor that always holds."""
    return Ball(toy.k, toy.c, 0.0, 0.0, toy.wall, toy.e, 1e9, toy.c_s)


def both(toy, start, seconds, *, fine=6000, coarse=6000, seed=3):
    """Places (M, 2) 100 times a second by either."""
    wave, start = plainball.waves(seed), np.array(start, dtype=float)
    plain, per = np.empty((round(100 * seconds), 5)), fine // 100
    plainball.play(toy, wave, np.array(TABLE), start, 1.0 / fine, len(plain) * per, per, plain)
    grid = np.arange(0.0, seconds + 0.1, 1e-3)
    plate = PlateMotion(0.0, 1e-3, np.array([plainball.plate_at(wave, t) for t in grid]))
    per, h = coarse // 100, 1.0 / coarse
    rows, out = np.zeros((len(plain) * per, ROW)), np.empty((len(plain) * per, 5))
    plate_rows(plate, Tilting(tilt_beta=TABLE[0], tilt_gamma=TABLE[1]), h * np.arange(len(rows)), h, 1, rows)
    advance(body_of(toy), channel(toy), effects_of(), rows, h, start, out)
    return plain, np.vstack([start, out[per - 1 :: per][:-1]])


@pytest.mark.slow
@pytest.mark.parametrize("k", [0.4, 2.0 / 3.0])
def test_free_rolling_on_a_moving_plate(k):
    toy = plainball.Toy(k=k, inner=0.001, outer=50.0)
    plain, body = both(toy, [0.05, 0.02, 0.1, -0.05, 0.08], 2.0)
    assert np.ptp(plain[:, 0]) > 0.02
    np.testing.assert_allclose(body[:, :2], plain[:, :2], atol=2e-5)
    np.testing.assert_allclose(body[:, 2:], plain[:, 2:], atol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("k", [0.4, 2.0 / 3.0])
@pytest.mark.parametrize("wall", [0.0, 0.22, 5.0])
def test_a_second_of_impacts_in_a_channel(wall, k):
    toy = plainball.Toy(wall=wall, k=k)
    plain, body = both(toy, [0.0525, 0.0, 0.05, 0.12, 0.0], 1.0, fine=24000, coarse=24000)
    r = np.hypot(*plain[:, :2].T)
    assert r.max() > toy.outer - toy.radius - 1e-4, "it met the wall"
    np.testing.assert_allclose(body[:, :2], plain[:, :2], atol=1.5e-4)
    np.testing.assert_allclose(body[:, 4], plain[:, 4], atol=4e-3)


@pytest.mark.slow
def test_steps_as_long_as_the_filters_go_the_same_way():
    """1/150 s, from forty starts: after a third of a second most are within a fraction of the camera's noise."""
    off, rng = [], np.random.default_rng(2)
    for _ in range(40):
        theta, place = rng.uniform(-math.pi, math.pi), rng.uniform(0.0520, 0.0532)
        start = [place * math.cos(theta), place * math.sin(theta), *rng.normal(0.0, 0.1, 3)]
        plain, body = both(plainball.Toy(), start, 0.35, coarse=300, seed=int(rng.integers(100)))
        off.append(math.hypot(*(body[33, :2] - plain[33, :2])))
    assert np.median(off) < 3e-4
    assert np.quantile(off, 0.9) < 1.5e-3
