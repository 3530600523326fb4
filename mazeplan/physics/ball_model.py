"""The ball model of one ring: a sum of effects, whichever they are."""

from __future__ import annotations

from dataclasses import dataclass, field

from mazeplan.physics import arrays
from mazeplan.physics.arrays import RingKinematics
from mazeplan.physics.effect import Term
from mazeplan.records import Array


@dataclass(frozen=True)
class BallModel:
    """A sum of effects. `stderr` holds standard errors as {effect: {parameter: value}} where they are known."""

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
        """Those effects that planner and prediction use."""
        return tuple(term for term in self.effects if term.effect.planned)

    def acceleration(self, k: RingKinematics) -> Array:
        """theta_dd, shape (N,), rad/s^2; of effects of openings an acceleration says nothing."""
        return arrays.acceleration(self.effects, k)

    def jacobian(self, k: RingKinematics) -> Array:
        """Derivatives of theta_dd with respect to (theta, theta_dot, beta, beta_dot, gamma, gamma_dot), shape (N,
        6)."""
        return arrays.jacobian(self.effects, k)
