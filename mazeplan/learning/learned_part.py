"""The learned part of a ball model in the planner: a Gaussian process (`fast_gp`) or networks (`networks`).

The first number of a packed part tells which it is: the number of rows of a Gaussian process, or minus the number of
networks.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from mazeplan.core.records import Array
from mazeplan.learning import fast_gp, networks
from mazeplan.learning.gaussian_process import GaussianProcess
from mazeplan.learning.networks import Networks

LearnedPart = GaussianProcess | Networks
process_mean, process_slopes = fast_gp.mean, fast_gp.mean_and_gradient
process_variance, process_bend = fast_gp.variance, fast_gp.variance_and_derivatives
network_slopes, network_bend = networks.mean_and_gradient, networks.variance_and_derivatives


def pack(part: LearnedPart) -> Array:
    """The vector for the compiled functions. Raises ModelError for a part that a planner cannot use."""
    return networks.pack(part) if isinstance(part, Networks) else fast_gp.pack(part)


def noise_of(part: LearnedPart) -> float:
    """Standard deviation of the noise of a sample, rad/s^2."""
    return part.noise if isinstance(part, Networks) else part.hyper.noise


@njit(cache=True, error_model="numpy")
def mean(p, at, s):
    """Mean of the part packed in p from `at` on, at the state s (6,), rad/s^2."""
    if p[at] < 0.0:
        return network_slopes(p, at, s, s, False)
    return process_mean(p, at, s)


@njit(cache=True, error_model="numpy")
def mean_and_gradient(p, at, s, by_state):
    """`mean`; writes its derivatives by s into by_state (6,)."""
    if p[at] < 0.0:
        return network_slopes(p, at, s, by_state, True)
    return process_slopes(p, at, s, by_state)


@njit(cache=True, error_model="numpy")
def variance(p, at, s, noise2, gap):
    """Variance of the part at s, (rad/s^2)^2: see `fast_gp.variance`; for networks, the variance over the members."""
    if p[at] < 0.0:
        return network_bend(p, at, s, np.empty(6), np.empty(6))
    return process_variance(p, at, s, noise2, gap)


@njit(cache=True, error_model="numpy")
def variance_and_derivatives(p, at, s, noise2, gap, by_state, bend):
    """`variance`; writes its derivatives by s into by_state (6,), the convex part of their diagonal into bend (6,)."""
    if p[at] < 0.0:
        return network_bend(p, at, s, by_state, bend)
    return process_bend(p, at, s, noise2, gap, by_state, bend)
