"""The ball model of one ring: a sum of effects."""

from __future__ import annotations

from dataclasses import dataclass, field

from mazeplan.core.records import Array
from mazeplan.physics.effect import Term
from mazeplan.physics.formulas import arrays
from mazeplan.physics.formulas.arrays import RingKinematics


@dataclass(frozen=True)
class BallModel:
    """A sum of effects; stderr: known standard errors, {effect: {parameter: value}}."""

    effects: tuple[Term, ...] = ()
    stderr: dict[str, dict[str, float]] = field(default_factory=dict, compare=False)

    def parameter(self, effect: str, parameter: str, default: float) -> float:
        """A parameter's value, or `default` when the effect is not in the model."""
        for term in self.effects:
            if term.name == effect:
                return term.values()[parameter]
        return default

    @property
    def planned(self) -> tuple[Term, ...]:
        """The effects that planner and prediction use."""
        return tuple(term for term in self.effects if term.effect.planned)

    def acceleration(self, k: RingKinematics) -> Array:
        """theta_dd, shape (N,), rad/s^2, without effects of openings."""
        return arrays.acceleration(self.effects, k)

    def jacobian(self, k: RingKinematics) -> Array:
        """Derivatives of theta_dd with respect to (theta, theta_dot, beta, beta_dot, gamma, gamma_dot), shape (N,
        6)."""
        return arrays.jacobian(self.effects, k)
