"""Ball models of one ring behind one interface: each predicts theta_dd.

| kind | model |
|---|---|
| p | the ball's equation with given parameters of the effects |
| pi | the terms of the equation, each with a fitted weight: Bayesian linear regression |
| np | Gaussian process on the inputs of the kernel |
| sp | Gaussian process with an additional linear kernel on features |
| rf | random forest on the nine inputs (scikit-learn) |

np and sp learn the difference to `kinematic_terms`: the part due to the motion of the plate, without gravity.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from mazeplan.core.records import Array
from mazeplan.learning.features import EFFECTS, FEATURES, INPUT_SETS, inputs
from mazeplan.learning.gaussian_process import GaussianProcess
from mazeplan.learning.linear import LinearFit
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.effects.ball import dry_friction, rolling_inertia, tilt_offset, viscous_friction
from mazeplan.physics.formulas.arrays import RingKinematics, kinematic_terms


class AccelerationModel(Protocol):
    """A model of theta_dd, rad/s^2, for a batch of states."""

    def mean(self, k: RingKinematics) -> Array:
        """Expectation (N,)."""
        ...


@dataclass(frozen=True)
class PhysicsBall:
    """p: a sum of effects with given parameters."""

    ball: BallModel

    def mean(self, k: RingKinematics) -> Array:
        """theta_dd (N,)."""
        return self.ball.acceleration(k)


@dataclass(frozen=True)
class LinearBall:
    """pi: fitted weights of a set of features."""

    fit: LinearFit
    features: str = "paper"

    def mean(self, k: RingKinematics) -> Array:
        """theta_dd (N,)."""
        return self.fit.mean(FEATURES[self.features](k))


@dataclass(frozen=True)
class GaussianBall:
    """np and sp: `kinematic_terms` plus a Gaussian process.

    features:  a name in FEATURES; "" for none
    inputs:    a name in INPUT_SETS"""

    process: GaussianProcess
    features: str = ""
    inputs: str = "state"

    def mean(self, k: RingKinematics) -> Array:
        """theta_dd (N,)."""
        phi = FEATURES[self.features](k) if self.features else None
        return kinematic_terms(k) + self.process.mean(INPUT_SETS[self.inputs](k), phi)


@dataclass(frozen=True)
class ForestBall:
    """rf: random forest, the mean of many decision trees."""

    forest: Any

    def mean(self, k: RingKinematics) -> Array:
        """theta_dd (N,)."""
        return np.asarray(self.forest.predict(inputs(k)), dtype=float)


def effect_ball(values: Iterable[float], sigma: Iterable[float], asymmetry: float = 0.0) -> BallModel:
    """A ball from the values of the parameters `EFFECTS`.

    sigma:      their standard errors
    asymmetry:  of dry friction"""
    factor, viscous, dry, *offset = (float(value) for value in values)
    effects = (rolling_inertia(factor), viscous_friction(viscous), dry_friction(dry, asymmetry), tilt_offset(*offset))
    stderr: dict[str, dict[str, float]] = {}
    for name, error in zip(EFFECTS, sigma, strict=True):
        effect, parameter = name.split(".")
        stderr.setdefault(effect, {})[parameter] = float(error)
    return BallModel(effects, stderr)
