"""npd, the counter-example: Gaussian processes on the discrete map x_k -> x_{k+1}, without an equation of motion.

There is one Gaussian process each for sin and cos of the next angle, and for the next rate. The map is nearly the
identity, and its error adds up with each step. A model of the acceleration leaves the integration to arithmetic.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mazeplan.core.maths.angles import nearest
from mazeplan.core.records import Array, IntArray
from mazeplan.learning.features import inputs
from mazeplan.learning.fitting import FitOptions
from mazeplan.learning.gaussian_process import GaussianProcess
from mazeplan.learning.gp_training import TrainingOptions, train
from mazeplan.learning.rollout import STEPS, Rollout
from mazeplan.learning.samples import RingSamples, pick
from mazeplan.learning.split import uniform_downsample
from mazeplan.physics.ball_model import RingKinematics


@dataclass(frozen=True)
class DiscreteMap:
    """Gaussian processes for sin theta, cos theta and theta_dot, one sample later."""

    sine: GaussianProcess
    cosine: GaussianProcess
    rate: GaussianProcess

    def next(self, k: RingKinematics) -> tuple[Array, Array]:
        """Angle (on the turn of the present one) and rate (N,) one sample later."""
        x = inputs(k)
        angle = np.arctan2(self.sine.mean(x), self.cosine.mean(x))
        return nearest(angle, k.theta), self.rate.mean(x)


def fit_discrete(samples: RingSamples, rows: IntArray, options: FitOptions) -> DiscreteMap:
    """Fit the map to pairs of neighbouring training rows."""
    following = np.append(samples.good[1:] & (samples.segment[1:] == samples.segment[:-1]), False)
    rows = rows[following[rows]]
    rows = rows[uniform_downsample(len(rows), options.most)]
    x, none = inputs(samples.at(rows)), np.zeros((len(rows), 0))
    theta = samples.k.theta[rows + 1]
    training = TrainingOptions(starts=1, seed=options.seed)

    def process(target: Array) -> GaussianProcess:
        return GaussianProcess.condition(train(x, none, target, training), x, none, target)

    return DiscreteMap(process(np.sin(theta)), process(np.cos(theta)), process(samples.k.theta_dot[rows + 1]))


def roll_out_discrete(
    model: DiscreteMap, samples: RingSamples, start: IntArray, theta: Array, theta_dot: Array
) -> Rollout:
    """Roll the map out from (theta, theta_dot) (W,) at rows `start` along the measured tilt."""
    angle, rate = np.empty((len(start), STEPS + 1)), theta_dot
    angle[:, 0] = theta
    for i in range(STEPS):
        k = replace(pick(samples.k, start + i), theta=angle[:, i], theta_dot=rate)
        angle[:, i + 1], rate = model.next(k)
    return Rollout.against(angle, samples.k.theta, start)
