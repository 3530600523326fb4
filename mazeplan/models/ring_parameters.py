"""Parameters of the ball in one ring and of the tilting stage, and the vector that compiled functions read."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mazeplan.errors import ModelError
from mazeplan.models import surface
from mazeplan.records import Array

if TYPE_CHECKING:
    from mazeplan.models.modelfile import RigModel

GRAVITY = 9.81  # m/s^2
SUBSTEPS = 2
# rad/s; the plate's acceleration, which pushes the ball, dies away with its fastest pole, and at a node counts for a
# sixth of a step, 2.8 ms: what is over before that would count far too much. No sample of a rig shows such a pole.
FASTEST = 150.0
ROLLING_BETWEEN_FLOOR_AND_WALL = 5.0 / 9.0  # 1 / (1 + 2 * 2/5): a solid sphere that turns on floor and wall at once

# where things are in the vector, and in the block of an axis
DRIVE, VISCOUS, DRY, WIDTH, BETA_0, GAMMA_0, STEP, SUBSTEP_COUNT, EXTRA, BY_ANGLE, BY_RATE, AXES = range(12)
GAIN, OFFSET, STIFFNESS, DAMPING, TABLE = range(5)
NODE = 4  # the entries of a 2x2 transition matrix in the table


def _positive(name: str, value: float) -> None:
    if not 0.0 < value < math.inf:
        raise ModelError(f"got {value}, expected a number > 0", key=name)


def _finite(name: str, value: float) -> None:
    if not math.isfinite(value):
        raise ModelError(f"got {value}, expected a finite number", key=name)


@dataclass(frozen=True)
class AxisParameters:
    """One axis of the stage, second order. gain: -; natural_frequency: rad/s; damping: ratio; offset: rad."""

    gain: float = 1.0
    natural_frequency: float = 26.0
    damping: float = 0.9
    offset: float = 0.0

    def __post_init__(self) -> None:
        _positive("stage gain", self.gain)
        _positive("stage natural_frequency", self.natural_frequency)
        _positive("stage damping", self.damping)
        _finite("stage offset", self.offset)


def resolved(natural_frequency: float, damping: float) -> tuple[float, float]:
    """Natural frequency (rad/s) and damping ratio with no pole beyond FASTEST; the slower one stays where it is."""
    w, z = natural_frequency, damping
    if z <= 1.0:
        return min(w, FASTEST), z
    apart = math.sqrt(z * z - 1.0)
    fast, slow = w * (z + apart), min(w / (z + apart), FASTEST)
    if fast <= FASTEST:
        return w, z
    fast = FASTEST
    return math.sqrt(fast * slow), 0.5 * (fast + slow) / math.sqrt(fast * slow)


@dataclass(frozen=True)
class RingParameters:
    """Everything the step needs.

    radius: m, where the ball's centre travels; rolling_factor: times the gravity part; viscous: 1/s; dry: rad/s^2;
    dry_width: rad/s over which dry friction changes sign; offset_beta, offset_gamma: tilt of the table, rad;
    beta, gamma: the stage; dt: s; gravity: m/s^2; physics: False leaves only what the turning plate does, for models
    that learned all the rest; surface: what the floor adds, as `surface.pack` has it, or empty. Raises ModelError for
    values out of range.
    """

    radius: float
    rolling_factor: float = ROLLING_BETWEEN_FLOOR_AND_WALL
    viscous: float = 0.0
    dry: float = 0.0
    dry_width: float = 0.1
    offset_beta: float = 0.0
    offset_gamma: float = 0.0
    beta: AxisParameters = AxisParameters()
    gamma: AxisParameters = AxisParameters()
    dt: float = 1.0 / 30.0
    gravity: float = GRAVITY
    physics: bool = True
    surface: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name in ("radius", "rolling_factor", "dry_width", "dt", "gravity"):
            _positive(name, getattr(self, name))
        for name in ("viscous", "dry"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise ModelError(f"got {getattr(self, name)}, expected a number >= 0", key=name)
        for name in ("offset_beta", "offset_gamma"):
            _finite(name, getattr(self, name))

    @classmethod
    def from_model(cls, model: RigModel, ring: int, radius: float) -> RingParameters:
        """The parameters of a fitted model for one ring, at its track radius (m)."""
        ball = model.ball(ring)
        floor = surface.pack(ball)
        axes = [
            AxisParameters(axis.gain, *resolved(axis.natural_frequency, axis.damping), axis.offset)
            for axis in (model.true_stage.beta, model.true_stage.gamma)
        ]
        return cls(
            radius=radius,
            rolling_factor=ball.parameter("rolling_inertia", "factor", 1.0),
            viscous=max(0.0, ball.parameter("viscous_friction", "coefficient", 0.0)),
            dry=max(0.0, ball.parameter("dry_friction", "coefficient", 0.0)),
            offset_beta=ball.parameter("tilt_offset", "beta", 0.0),
            offset_gamma=ball.parameter("tilt_offset", "gamma", 0.0),
            beta=axes[0],
            gamma=axes[1],
            physics=not (model.kind == "np" and ring in model.processes),
            surface=tuple(floor.tolist()) if floor[0] else (),
        )

    def pack(self, substeps: int = SUBSTEPS) -> Array:
        """The vector that the compiled functions read: ball, integration, then per axis its numbers and its table of
        transition matrices at 0, 1/2, 1, 3/2 ... `substeps` integration steps, then what the floor adds."""
        on = 1.0 if self.physics else 0.0
        ball = [
            on * self.rolling_factor * self.gravity / self.radius,
            on * self.viscous,
            on * self.dry,
            self.dry_width,
            self.offset_beta,
            self.offset_gamma,
            self.dt / substeps,
            substeps,
            0.0,  # EXTRA
            0.0,  # BY_ANGLE, BY_RATE: scratch space of `linearise`
            0.0,
        ]
        axes = [number for axis in (self.beta, self.gamma) for number in _pack_axis(axis, self.dt, substeps)]
        return np.array(ball + axes + list(self.surface or np.zeros(surface.SIZE)), dtype=float)


def _pack_axis(axis: AxisParameters, dt: float, substeps: int) -> list[float]:
    wn = axis.natural_frequency
    numbers = [axis.gain, axis.offset, wn * wn, 2.0 * axis.damping * wn]
    for node in range(2 * substeps + 1):
        numbers.extend(stage_transition(wn, axis.damping, 0.5 * node * dt / substeps).ravel())
    return numbers


def stage_transition(wn: float, zeta: float, t: float) -> Array:
    """exp(M t) of M = [[0, 1], [-wn^2, -2 zeta wn]], shape (2, 2), for any damping.

    exp(M t) = exp(-zeta wn t) [cosh(mu t) I + sinh(mu t)/mu (M + zeta wn I)],  mu = wn sqrt(zeta^2 - 1).
    """
    mu = wn * cmath.sqrt(complex(zeta * zeta - 1.0))
    slope = t if abs(mu * t) < 1e-9 else (cmath.sinh(mu * t) / mu).real
    rest = np.array([[zeta * wn, 1.0], [-wn * wn, -zeta * wn]])
    return math.exp(-zeta * wn * t) * (cmath.cosh(mu * t).real * np.eye(2) + slope * rest)
