"""What the fit finds in records of an integrator that shares nothing with the model (`plainball`)."""

from __future__ import annotations

from functools import cache

import numpy as np
import plainball
import pytest

from mazeplan.control.estimation.rigid_body_filter import BallPictures, BodyFilter, BodyModel
from mazeplan.control.estimation.rigid_body_fit import DEFAULT_FREE, autocorrelation, fit_body, with_values
from mazeplan.diagnosis.rig.reference import fit_reference
from mazeplan.physics.dynamics.plate import PlateMotion
from mazeplan.physics.dynamics.walls import GAP, SLAB, Walls
from mazeplan.physics.effect import FORCE, Effect, Parameter
from mazeplan.physics.formulas.symbols import cos

pytestmark = pytest.mark.slow

TABLE, NOISE = (0.003, -0.004), 5e-4
FREE = tuple(name for name in DEFAULT_FREE if name not in ("hold", "strike"))  # plainball's floor always holds


def push(a):
    """A user's effect: it pushes along the ring."""
    amplitude = Parameter("rad/s^2", 0.0, -20.0, 20.0, smallest=0.05)
    return Effect("mine", {"a": amplitude}, FORCE, lambda s, p: p.a * cos(s.theta))(a=a)


@cache
def recorded(toy, lost=0.0):
    """The filter for a record, and a guess that is off."""
    t, y, wave, _ = plainball.record(toy, seconds=60.0, table=TABLE, noise=NOISE)
    y[np.random.default_rng(5).random(len(y)) < lost] = np.nan
    grid = np.arange(0.0, t[-1] + 0.1, 5e-3)
    plate = PlateMotion(0.0, 5e-3, np.array([plainball.plate_at(wave, at) for at in grid]))
    wall = np.array([[toy.inner - 0.003, toy.inner - 1e-3, 0.0, 0.0]])
    walls = Walls(wall, np.zeros((0, GAP)), np.zeros((0, SLAB)), toy.outer, toy.radius, 1e-3)
    body = BodyFilter(BallPictures(t, 1.0 / 30.0, y, t == 0.0), plate, walls)
    return body, with_values(BodyModel(), {"hold": 1.0, "inertia": toy.k})


def near(fit, true, scale):
    """Names of numbers that are further off than five standard errors and a hundredth of a usual size."""
    return {
        name: (fit.value(name), fit.stderr[name], value)
        for name, value in true.items() if abs(fit.value(name) - value) > 5.0 * fit.stderr[name] + 0.01 * scale[name]
    }  # fmt: skip


SCALE = {
    "rolling": 0.1, "spin": 0.1, "wall": 1.0, "tilt_beta": 0.01, "tilt_gamma": 0.01, "noise": 1e-3,
    "delay": 0.1, "offset_x": 5e-3, "offset_y": 5e-3,
}  # fmt: skip


@pytest.mark.parametrize(("toy", "lost"), [
    (plainball.Toy(), 0.0), (plainball.Toy(k=2.0 / 3.0, c=0.18, wall=0.4, e=0.3), 0.1),
])  # fmt: skip
def test_the_parameters_of_the_ball_are_found(toy, lost):
    body, guess = recorded(toy, lost)
    fit = fit_body(body, guess, FREE)
    true = {
        "rolling": toy.c, "spin": toy.c_s, "wall": toy.wall, "noise": NOISE,
        "tilt_beta": TABLE[0], "tilt_gamma": TABLE[1], "delay": 2.0 / 30.0, "offset_x": 0.0, "offset_y": 0.0,
    }  # fmt: skip
    assert near(fit, true, SCALE) == {}
    assert fit.value("restitution") == pytest.approx(toy.e, abs=0.12), "steps of 1/150 s smooth the last of bouncing"
    assert np.abs(autocorrelation(fit.filtered)).max() < 0.07
    assert np.mean(fit.filtered.whitened() ** 2) == pytest.approx(1.0, abs=0.06)
    assert fit.filtered.left_out < 0.01 * len(body.pictures)


def test_a_users_effect_is_found_as_large_as_it_is():
    body, guess = recorded(plainball.Toy(push=2.0))
    free = ("rolling", "wall", "tilt_beta", "tilt_gamma", "delay", "noise", "plane")
    without = fit_body(body, guess, free)
    fit = fit_body(body, guess._replace(terms=(push(0.0),)), (*free, "mine.a"))
    assert fit.value("mine.a") == pytest.approx(2.0, abs=5.0 * fit.stderr["mine.a"] + 0.03)
    assert without.minus2 - fit.minus2 > 100.0
    assert fit.value("wall") == pytest.approx(0.22, abs=0.04)


def test_walls_that_return_little_are_not_explained_by_a_floor_that_slips():
    """With no grip of the floor, an impact returns (e - k) / (1 + k): as much as of a smaller e, where it holds."""
    toy = plainball.Toy(e=0.05)
    body, guess = recorded(toy)
    slips = with_values(guess, {"restitution": toy.k + 0.05 * (1.0 + toy.k), "hold": 0.0})
    ball = fit_reference(body, slips).model.ball
    assert ball.hold > 0.01
    assert ball.restitution == pytest.approx(0.05, abs=0.03)
