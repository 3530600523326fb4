"""Ball models of one ring behind one interface: what a prediction is made of does not show.

| kind | what |
|---|---|
| p | the equation of `effects` for a sliding point, nothing fitted |
| pi | its terms, each with a weight of its own: Bayesian linear regression |
| np | Gaussian process on the nine inputs |
| sp | the same plus a linear kernel on the features of effects |
| rf | random forest on the nine inputs (scikit-learn) |

All predict theta_dd; gravity has no say in what the turning plate itself does (`kinematic_terms`), which np and sp are
given and only learn the rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from mazeplan.models.features import FEATURES, INPUT_SETS, feature_jacobian, inputs, through_inputs
from mazeplan.models.gaussian_process import GaussianProcess
from mazeplan.models.linear import LinearFit
from mazeplan.physics.arrays import RingKinematics, kinematic_jacobian, kinematic_terms
from mazeplan.physics.ball_model import BallModel
from mazeplan.records import Array


class AccelerationModel(Protocol):
    """What predicts theta_dd, rad/s^2, for a batch of states."""

    def mean(self, k: RingKinematics) -> Array:
        """Expectation, (N,)."""
        ...

    def variance(self, k: RingKinematics) -> Array:
        """Variance of the expectation, (N,), without the noise of a sample; 0 where a model has no doubt."""
        ...

    def jacobian(self, k: RingKinematics) -> Array:
        """Derivatives of the mean by (theta, theta_dot, beta, beta_dot, gamma, gamma_dot), (N, 6)."""
        ...


@dataclass(frozen=True)
class PhysicsBall:
    """p: a sum of effects with given parameters."""

    ball: BallModel

    def mean(self, k: RingKinematics) -> Array:
        """theta_dd (N,)."""
        return self.ball.acceleration(k)

    def variance(self, k: RingKinematics) -> Array:
        """Zeros (N,)."""
        return np.zeros(len(k.theta))

    def jacobian(self, k: RingKinematics) -> Array:
        """(N, 6)."""
        return self.ball.jacobian(k)


@dataclass(frozen=True)
class LinearBall:
    """pi: weights of a set of features."""

    fit: LinearFit
    features: str = "paper"

    def mean(self, k: RingKinematics) -> Array:
        """theta_dd (N,)."""
        return self.fit.mean(FEATURES[self.features](k))

    def variance(self, k: RingKinematics) -> Array:
        """(N,), from the covariance of the weights."""
        return self.fit.variance(FEATURES[self.features](k))

    def jacobian(self, k: RingKinematics) -> Array:
        """(N, 6)."""
        return feature_jacobian(self.features, k, self.fit.weights)


@dataclass(frozen=True)
class GaussianBall:
    """np and sp: what the turning plate does, plus a process; features: a name in `FEATURES`, or "" for none; inputs: a
    name in `INPUT_SETS`."""

    process: GaussianProcess
    features: str = ""
    inputs: str = "state"

    def _features(self, k: RingKinematics) -> Array | None:
        return FEATURES[self.features](k) if self.features else None

    def mean(self, k: RingKinematics) -> Array:
        """theta_dd (N,)."""
        return kinematic_terms(k) + self.process.mean(INPUT_SETS[self.inputs](k), self._features(k))

    def variance(self, k: RingKinematics) -> Array:
        """(N,)."""
        return self.process.variance(INPUT_SETS[self.inputs](k), self._features(k))

    def jacobian(self, k: RingKinematics) -> Array:
        """(N, 6)."""
        slope = self.process.gradient(INPUT_SETS[self.inputs](k))
        out = kinematic_jacobian(k) + through_inputs(self.inputs, k, slope)
        return out + feature_jacobian(self.features, k, self.process.weights) if self.features else out


@dataclass(frozen=True)
class ForestBall:
    """rf: the mean of many trees."""

    forest: Any

    def mean(self, k: RingKinematics) -> Array:
        """theta_dd (N,)."""
        return np.asarray(self.forest.predict(inputs(k)), dtype=float)

    def variance(self, k: RingKinematics) -> Array:
        """How far the trees differ, (N,)."""
        x = inputs(k)
        return np.var([tree.predict(x) for tree in self.forest.estimators_], axis=0)

    def jacobian(self, k: RingKinematics) -> Array:
        """Zeros (N, 6): trees are constant in steps."""
        return np.zeros((len(k.theta), 6))
