"""The ball model of one ring: the equation of `effects` with a set of effects in it."""

from __future__ import annotations

from dataclasses import dataclass, field

from mazeplan.models.effects import (
    Effect,
    RingKinematics,
    gravity_jacobian,
    gravity_part,
    kinematic_jacobian,
    kinematic_terms,
)
from mazeplan.records import Array


@dataclass(frozen=True)
class BallModel:
    """A sum of effects. `stderr` holds standard errors as {effect: {parameter: value}} where they are known."""

    effects: tuple[Effect, ...] = ()
    stderr: dict[str, dict[str, float]] = field(default_factory=dict, compare=False)

    def parameter(self, effect: str, parameter: str, default: float) -> float:
        """A parameter's value, or `default` when the effect is not in the model."""
        for e in self.effects:
            if e.name == effect:
                return e.values()[parameter]
        return default

    def _gravity(self) -> tuple[float, float, float]:
        return (
            self.parameter("rolling_inertia", "factor", 1.0),
            self.parameter("tilt_offset", "beta", 0.0),
            self.parameter("tilt_offset", "gamma", 0.0),
        )

    def acceleration(self, k: RingKinematics) -> Array:
        """theta_dd, shape (N,), rad/s^2."""
        factor, beta_0, gamma_0 = self._gravity()
        total = kinematic_terms(k) + factor * gravity_part(k, beta_0, gamma_0)
        for effect in self.effects:
            total = total + effect.term(k)
        return total

    def jacobian(self, k: RingKinematics) -> Array:
        """Derivatives of theta_dd with respect to (theta, theta_dot, beta, beta_dot, gamma, gamma_dot), shape (N,
        6)."""
        factor, beta_0, gamma_0 = self._gravity()
        total = kinematic_jacobian(k) + factor * gravity_jacobian(k, beta_0, gamma_0)
        for effect in self.effects:
            total = total + effect.jacobian(k)
        return total
