"""The ball's motion in a ring as a sum of named effects.

A point mass at radius r in a plate with R = Ry(beta) Rx(gamma) (Lagrange, kept in place by its ring):

    theta_dd = beta_dd sin(gamma)
             - beta_d^2 sin(theta) cos(theta) cos(gamma)^2  + 2 beta_d gamma_d cos(gamma) sin(theta)^2
             + gamma_d^2 sin(theta) cos(theta)
             - (g / r) (sin(beta) sin(theta) + sin(gamma) cos(beta) cos(theta))

The last line is the gravity part; `rolling_inertia` scales it and `tilt_offset` adds to the tilt in it. Each other
effect adds a
term of its own. An effect is a frozen dataclass whose fields are its parameters; `term` gives it, in rad/s^2,
for arrays of samples; `jacobian` its derivatives with respect to (theta, theta_dot, beta, beta_dot, gamma, gamma_dot).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np

from mazeplan.records import Array

GRAVITY = 9.81  # m/s^2


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


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect: unit, value without the effect, plausible range."""

    unit: str
    default: float
    low: float
    high: float


@dataclass(frozen=True)
class Effect:
    """Base of all effects; `name` is what model files and reports call it."""

    name: ClassVar[str] = ""
    parameters: ClassVar[Mapping[str, Parameter]] = {}

    def __post_init__(self) -> None:
        for f in fields(self):
            value, allowed = getattr(self, f.name), self.parameters[f.name]
            if not allowed.low <= value <= allowed.high:  # also refuses NaN
                raise ValueError(
                    f"{f.name}: got {value}, expected {allowed.low} to {allowed.high} {allowed.unit}".strip()
                )

    def values(self) -> dict[str, float]:
        """Parameters by name."""
        return {f.name: float(getattr(self, f.name)) for f in fields(self)}

    def term(self, k: RingKinematics) -> Array:
        """The effect's term of theta_dd, shape (N,), rad/s^2; effects inside the gravity part have none of their
        own."""
        return np.zeros_like(k.theta)

    def jacobian(self, k: RingKinematics) -> Array:
        """Derivatives of `term`, shape (N, 6)."""
        return np.zeros((k.theta.size, 6))


@dataclass(frozen=True)
class RollingInertia(Effect):
    """The gravity part times `factor`: 1 for a sliding point, 5/7 for a solid sphere that rolls on the floor, less
    along a wall."""

    factor: float = 1.0
    name: ClassVar[str] = "rolling_inertia"
    parameters: ClassVar[Mapping[str, Parameter]] = {"factor": Parameter("1", 1.0, 0.05, 1.5)}


@dataclass(frozen=True)
class TiltOffset(Effect):
    """The table is not level: beta + beta_0 and gamma + gamma_0 in the gravity part."""

    beta: float = 0.0
    gamma: float = 0.0
    name: ClassVar[str] = "tilt_offset"
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "beta": Parameter("rad", 0.0, -0.2, 0.2),
        "gamma": Parameter("rad", 0.0, -0.2, 0.2),
    }


@dataclass(frozen=True)
class ViscousFriction(Effect):
    """- coefficient theta_dot."""

    coefficient: float = 0.0
    name: ClassVar[str] = "viscous_friction"
    parameters: ClassVar[Mapping[str, Parameter]] = {"coefficient": Parameter("1/s", 0.0, 0.0, 20.0)}

    def term(self, k: RingKinematics) -> Array:
        """- c theta_dot."""
        return -self.coefficient * k.theta_dot

    def jacobian(self, k: RingKinematics) -> Array:
        """Only theta_dot counts."""
        out = np.zeros((k.theta.size, 6))
        out[:, 1] = -self.coefficient
        return out


@dataclass(frozen=True)
class DryFriction(Effect):
    """- coefficient sign(theta_dot) - asymmetry (Coulomb friction of a moving ball; none at rest)."""

    coefficient: float = 0.0
    asymmetry: float = 0.0
    name: ClassVar[str] = "dry_friction"
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "coefficient": Parameter("rad/s^2", 0.0, 0.0, 20.0),
        "asymmetry": Parameter("rad/s^2", 0.0, -10.0, 10.0),
    }

    def term(self, k: RingKinematics) -> Array:
        """- c sign(theta_dot) - a |sign(theta_dot)|; its derivatives are zero where they exist."""
        sign = np.sign(k.theta_dot)
        return -self.coefficient * sign - self.asymmetry * np.abs(sign)


@dataclass(frozen=True)
class QuadraticDrag(Effect):
    """- coefficient theta_dot |theta_dot|."""

    coefficient: float = 0.0
    name: ClassVar[str] = "quadratic_drag"
    parameters: ClassVar[Mapping[str, Parameter]] = {"coefficient": Parameter("1/rad", 0.0, 0.0, 5.0)}

    def term(self, k: RingKinematics) -> Array:
        """- c theta_dot |theta_dot|."""
        return -self.coefficient * k.theta_dot * np.abs(k.theta_dot)

    def jacobian(self, k: RingKinematics) -> Array:
        """Only theta_dot counts."""
        out = np.zeros((k.theta.size, 6))
        out[:, 1] = -2.0 * self.coefficient * np.abs(k.theta_dot)
        return out


@dataclass(frozen=True)
class ConstantTorque(Effect):
    """+ acceleration, the same everywhere."""

    acceleration: float = 0.0
    name: ClassVar[str] = "constant_torque"
    parameters: ClassVar[Mapping[str, Parameter]] = {"acceleration": Parameter("rad/s^2", 0.0, -10.0, 10.0)}

    def term(self, k: RingKinematics) -> Array:
        """A constant; its derivatives are zero."""
        return np.full_like(k.theta, self.acceleration)


_WAVE = Parameter("rad/s^2", 0.0, -20.0, 20.0)


@dataclass(frozen=True)
class SurfaceProfile(Effect):
    """+ sum over n of cos_n cos(n theta) + sin_n sin(n theta): a floor that is not flat."""

    cos1: float = 0.0
    sin1: float = 0.0
    cos2: float = 0.0
    sin2: float = 0.0
    cos3: float = 0.0
    sin3: float = 0.0
    name: ClassVar[str] = "surface_profile"
    parameters: ClassVar[Mapping[str, Parameter]] = {f"{k}{n}": _WAVE for n in (1, 2, 3) for k in ("cos", "sin")}

    def term(self, k: RingKinematics) -> Array:
        """The sum."""
        waves = ((1, self.cos1, self.sin1), (2, self.cos2, self.sin2), (3, self.cos3, self.sin3))
        return np.sum([c * np.cos(n * k.theta) + s * np.sin(n * k.theta) for n, c, s in waves], axis=0)

    def jacobian(self, k: RingKinematics) -> Array:
        """Only theta counts."""
        waves = ((1, self.cos1, self.sin1), (2, self.cos2, self.sin2), (3, self.cos3, self.sin3))
        out = np.zeros((k.theta.size, 6))
        out[:, 0] = np.sum([n * (s * np.cos(n * k.theta) - c * np.sin(n * k.theta)) for n, c, s in waves], axis=0)
        return out


@dataclass(frozen=True)
class SurfaceBump(Effect):
    """+ height e exp((1 - e^2) / 2), e = (theta - centre) / width: off a hill, or, with a negative height, towards a
    spot."""

    centre: float = 0.0
    width: float = 0.2
    height: float = 0.0
    name: ClassVar[str] = "surface_bump"
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "centre": Parameter("rad", 0.0, -2.0 * np.pi, 2.0 * np.pi),
        "width": Parameter("rad", 0.2, 0.03, 1.5),
        "height": Parameter("rad/s^2", 0.0, -50.0, 50.0),
    }

    def _at(self, k: RingKinematics) -> tuple[Array, Array]:
        e = np.arctan2(np.sin(k.theta - self.centre), np.cos(k.theta - self.centre)) / self.width
        return e, self.height * np.exp(0.5 - 0.5 * e * e)

    def term(self, k: RingKinematics) -> Array:
        """The hill's flanks."""
        e, size = self._at(k)
        return size * e

    def jacobian(self, k: RingKinematics) -> Array:
        """Only theta counts."""
        (e, size), out = self._at(k), np.zeros((k.theta.size, 6))
        out[:, 0] = size * (1.0 - e * e) / self.width
        return out


@dataclass(frozen=True)
class GateLoss(Effect):
    """The share `loss` of its speed that the ball loses in passing an angle. For the eye and for `diagnose`: an
    acceleration says nothing of it."""

    angle: float = 0.0
    loss: float = 0.0
    name: ClassVar[str] = "gate_loss"
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "angle": Parameter("rad", 0.0, -2.0 * np.pi, 2.0 * np.pi),
        "loss": Parameter("1", 0.0, 0.0, 0.9),
    }


EFFECTS: dict[str, type[Effect]] = {
    kind.name: kind
    for kind in (
        RollingInertia, TiltOffset, ViscousFriction, DryFriction, QuadraticDrag, ConstantTorque, SurfaceProfile,
        SurfaceBump, GateLoss,
    )
}  # fmt: skip


def kinematic_terms(k: RingKinematics) -> Array:
    """What the turning plate does to the ball without gravity, shape (N,), rad/s^2."""
    s, c, cg = np.sin(k.theta), np.cos(k.theta), np.cos(k.gamma)
    return (
        k.beta_ddot * np.sin(k.gamma)
        - k.beta_dot**2 * s * c * cg**2
        + 2.0 * k.beta_dot * k.gamma_dot * cg * s**2
        + k.gamma_dot**2 * s * c
    )


def kinematic_jacobian(k: RingKinematics) -> Array:
    """Derivatives of `kinematic_terms`, shape (N, 6), with beta_ddot and gamma_ddot held."""
    s, c, sg, cg = np.sin(k.theta), np.cos(k.theta), np.sin(k.gamma), np.cos(k.gamma)
    bd, gd = k.beta_dot, k.gamma_dot
    out = np.zeros((k.theta.size, 6))
    out[:, 0] = (gd**2 - bd**2 * cg**2) * (c**2 - s**2) + 4.0 * bd * gd * cg * s * c
    out[:, 3] = -2.0 * bd * s * c * cg**2 + 2.0 * gd * cg * s**2
    out[:, 4] = k.beta_ddot * cg + 2.0 * bd**2 * s * c * cg * sg - 2.0 * bd * gd * sg * s**2
    out[:, 5] = 2.0 * bd * cg * s**2 + 2.0 * gd * s * c
    return out


def gravity_part(k: RingKinematics, beta_0: float = 0.0, gamma_0: float = 0.0) -> Array:
    """Pull of gravity along the ring on a table tilted by (beta_0, gamma_0), shape (N,), rad/s^2."""
    b, g = k.beta + beta_0, k.gamma + gamma_0
    return -(GRAVITY / k.radius) * (np.sin(b) * np.sin(k.theta) + np.sin(g) * np.cos(b) * np.cos(k.theta))


def gravity_jacobian(k: RingKinematics, beta_0: float = 0.0, gamma_0: float = 0.0) -> Array:
    """Derivatives of `gravity_part`, shape (N, 6)."""
    b, g = k.beta + beta_0, k.gamma + gamma_0
    s, c, scale = np.sin(k.theta), np.cos(k.theta), -GRAVITY / k.radius
    out = np.zeros((k.theta.size, 6))
    out[:, 0] = scale * (np.sin(b) * c - np.sin(g) * np.cos(b) * s)
    out[:, 2] = scale * (np.cos(b) * s - np.sin(g) * np.sin(b) * c)
    out[:, 4] = scale * np.cos(g) * np.cos(b) * c
    return out


def make_effect(name: str, values: Mapping[str, Any]) -> Effect:
    """The effect of that name. Raises ValueError naming what is allowed."""
    if name not in EFFECTS:
        raise ValueError(f"got effect {name!r}, expected one of {', '.join(EFFECTS)}")
    kind = EFFECTS[name]
    for key in values:
        if key not in kind.parameters:
            raise ValueError(f"got parameter {key!r} of {name}, expected one of {', '.join(kind.parameters)}")
    return kind(**values)
