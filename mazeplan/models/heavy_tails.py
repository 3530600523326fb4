"""What is typical: a process that expects some rows to be far off, by Student's t instead of normal noise.

    y_i = f(x_i) + e_i,  e_i = s t_i,  t of nu degrees of freedom: normal with variance s^2 / lambda_i, lambda_i drawn
    z_i = (y_i - f_i) / spread,        f_i without row i and its neighbours; nu and spread the likeliest for them
    s_i^2 = s^2 (nu + z_i^2) / (nu + 1)

A ball that meets the edge of an opening is thrown back, or it is not: what decides that no model is told. The mean of
both is best where squared errors count. With it a roll-out is off wherever a blow was possible and did not come, which
is most of the time: where absolute errors count, what is typical is best, and a few blows must not bend it for all
states around. The variance s_i^2 is what a step of expectation maximisation takes for row i (Lange, Little, Taylor,
"Robust Statistical Modeling Using the t Distribution", JASA 84, 1989). One step is enough: on other blocks of the
training rows of measured data a second one left roll-outs as they were.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import stats

from mazeplan.data.split import uniform_downsample
from mazeplan.models.gaussian_process import GaussianProcess, Hyperparameters
from mazeplan.records import Array

FREEDOM = (1.0, 30.0)  # least and most degrees of freedom nu; measured rings have 2 to 3, simulated ones 5 to 7
FOLDS = 4
BLOCK = 10  # rows left out together: a smoothed acceleration spreads a blow over the neighbours
FEW = 1000  # rows of the process that is asked what it leaves over


def typical(process: GaussianProcess, y: Array) -> GaussianProcess:
    """The process conditioned anew on its values y (N,), in order of time, with heavy tails; for its mean alone."""
    noise = row_noise(process.hyper, process.inputs, process.features, y)
    robust = GaussianProcess.condition(process.hyper, process.inputs, process.features, y, noise)
    return replace(robust, factor=np.zeros((0, 0)))  # it would take as much memory as all else of a comparison


def row_noise(hyper: Hyperparameters, x: Array, phi: Array, y: Array) -> Array:
    """Standard deviation (N,) of the noise of each row, units of y, for inputs x (N, D), features phi (N, M), M may be
    0, and values y (N,), in order of time."""
    left = left_over(hyper, x, phi, y)
    if not np.any(left):  # what fits exactly has no tails
        return np.full(len(y), hyper.noise)
    found, _, spread = stats.t.fit(left, floc=0.0)
    nu = float(np.clip(found, *FREEDOM))
    return hyper.noise * np.sqrt((nu + (left / spread) ** 2) / (nu + 1.0))


def left_over(hyper: Hyperparameters, x: Array, phi: Array, y: Array) -> Array:
    """What (N,), units of y, a process on at most FEW rows of other blocks leaves over in each row."""
    n = len(y)
    fold = np.arange(n) // max(1, min(BLOCK, n // FOLDS)) % FOLDS
    left = y.copy()
    for own in range(FOLDS):
        mine, others = np.flatnonzero(fold == own), np.flatnonzero(fold != own)
        if len(mine) and len(others):
            some = others[uniform_downsample(len(others), FEW)]
            process = GaussianProcess.condition(hyper, x[some], phi[some], y[some])
            left[mine] -= process.mean(x[mine], phi[mine])
    return left
