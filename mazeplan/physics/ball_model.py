"""The ball model of one ring, a sum of effects, and its equation of motion for arrays of samples."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mazeplan.core.constants import GRAVITY
from mazeplan.core.records import Array
from mazeplan.physics.effect import OPENING, Term
from mazeplan.physics.effects.ball import rolling_inertia, tilt_offset
from mazeplan.physics.formulas.compiled import ring_functions

EXACT = 1e-12  # rad/s over which dry friction changes its sign: practically at once
BALL_RADIUS = 6.35e-3  # m; of the toy's steel ball
NO_GRAVITY = Term(rolling_inertia, (0.0,))  # leaves the plate's rotation alone


@dataclass(frozen=True)
class RingKinematics:
    """Samples of ball and plate in one ring, arrays of shape (N,): rad, rad/s, rad/s^2; radius m."""

    radius: float
    theta: Array
    theta_dot: Array
    beta: Array
    beta_dot: Array
    beta_ddot: Array
    gamma: Array
    gamma_dot: Array
    gamma_ddot: Array

    @property
    def plate(self) -> tuple[Any, ...]:
        """The inputs of formulas, in their order (`symbols.PLATE`)."""
        plate = (self.beta, self.beta_dot, self.beta_ddot, self.gamma, self.gamma_dot, self.gamma_ddot)
        return (*plate, self.radius, BALL_RADIUS)


@dataclass(frozen=True)
class BallModel:
    """A sum of effects; stderr: known standard errors, {effect: {parameter: value}}."""

    effects: tuple[Term, ...] = ()
    stderr: dict[str, dict[str, float]] = field(default_factory=dict, compare=False)

    def parameter(self, effect: str, parameter: str, default: float) -> float:
        """A parameter's value, or `default` when the effect is not in the model."""
        return next((t.values()[parameter] for t in self.effects if t.name == effect), default)

    @property
    def planned(self) -> tuple[Term, ...]:
        """The effects that planner and prediction use."""
        return tuple(term for term in self.effects if term.effect.planned)

    def acceleration(self, k: RingKinematics) -> Array:
        """theta_dd, shape (N,), rad/s^2, without effects of openings."""
        return acceleration(self.effects, k)


def ball_of(balls: Mapping[int, BallModel], ring: int) -> BallModel:
    """The ball model of a ring, or of the nearest ring that has one; balls: by ring."""
    return balls[min(balls, key=lambda number: abs(number - ring))]


def packed(terms: Sequence[Term], width: float = EXACT) -> list[float]:
    """The parameters of some terms, as compiled code expects them."""
    return [width, *(number for term in terms for number in term.numbers)]


def acceleration(terms: Sequence[Term], k: RingKinematics, width: float = EXACT) -> Array:
    """theta_dd (N,), rad/s^2, of a sum of effects; width: rad/s over which dry friction changes its sign."""
    f, p = _along(terms, width)
    on_ball = k.theta, k.theta_dot, np.sin(k.theta), np.cos(k.theta)
    return f["value"](*on_ball, f["plate"](0.0, k.plate, p), p) + np.zeros_like(k.theta)


def jacobian(terms: Sequence[Term], k: RingKinematics, width: float = EXACT) -> Array:
    """Derivatives of theta_dd by (theta, theta_dot, beta, beta_dot, gamma, gamma_dot), (N, 6), with beta_ddot and
    gamma_ddot held."""
    f, p = _along(terms, width)
    on_ball = k.theta, k.theta_dot, np.sin(k.theta), np.cos(k.theta)
    found = f["partials"](*on_ball, f["plate_partials"](0.0, k.plate, p), p)[1:]
    theta, rate, beta, beta_d, _, gamma, gamma_d = (part + np.zeros_like(k.theta) for part in found)
    return np.stack([theta, rate, beta, beta_d, gamma, gamma_d], axis=1)


def _along(terms: Sequence[Term], width: float = EXACT) -> tuple[Any, list[float]]:
    """Functions and parameters of the terms along the ring, without openings."""
    terms = [term for term in terms if term.effect.acts != OPENING]
    return ring_functions([term.effect for term in terms]).vectorised(np), packed(terms, width)


def kinematic_terms(k: RingKinematics) -> Array:
    """Acceleration from the plate's rotation alone, (N,), rad/s^2."""
    return acceleration([NO_GRAVITY], k)


def gravity_part(k: RingKinematics, beta_0: float = 0.0, gamma_0: float = 0.0) -> Array:
    """Pull of gravity along the ring on a table tilted by (beta_0, gamma_0), (N,), rad/s^2."""
    return acceleration([Term(tilt_offset, (beta_0, gamma_0))], k) - kinematic_terms(k)


def gravity_jacobian(k: RingKinematics, beta_0: float = 0.0, gamma_0: float = 0.0) -> Array:
    """Derivatives of `gravity_part`, (N, 6)."""
    return jacobian([Term(tilt_offset, (beta_0, gamma_0))], k) - jacobian([NO_GRAVITY], k)


def level_tilt(terms: Sequence[Term]) -> tuple[float, float]:
    """Apparent tilt (beta, gamma), rad, of a level plate: commands must subtract it."""
    x, y, *_ = _in_plane(terms)
    beta = math.asin(x / GRAVITY)
    return beta, math.asin(-y / (GRAVITY * math.cos(beta)))


def gravity_factor(terms: Sequence[Term]) -> float:
    """Share of gravity that moves the ball."""
    return float(_in_plane(terms)[-1])


def _in_plane(terms: Sequence[Term]) -> tuple[float, ...]:
    """Outputs of `generate.plane_routine` for a ball at rest on a level plate."""
    f, p = _along(terms)
    return f["plane"](0.0, 0.0, 0.0, 0.0, 0.0, (0.0,) * 6 + (0.1, BALL_RADIUS), p)
