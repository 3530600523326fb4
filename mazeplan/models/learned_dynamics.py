"""Discrete dynamics of a ring whose ball model has a learned part: the ring's own, plus a Gaussian process.

The process is asked once a step, at the state in which the step begins, and what it says is held over the step, as the
command is: at 30 Hz that is what the samples it was trained on can tell apart. Numba keeps these functions on disk by
the date of this file alone: who changes what they call must change this file, too. Signatures are those of
`ring_dynamics`; the parameters are those of `RingParameters.pack`, then the process (`fast_gp.pack`).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from mazeplan.models import fast_gp
from mazeplan.models.fast_gp import mean, mean_and_gradient
from mazeplan.models.gaussian_process import GaussianProcess
from mazeplan.physics import ring_dynamics
from mazeplan.physics.ring_parameters import BY_ANGLE, BY_RATE, EXTRA, PROCESS, RingParameters
from mazeplan.records import Array


def pack(parameters: RingParameters, gp: GaussianProcess) -> Array:
    """The vector that `step` and `linearise` read."""
    return np.concatenate([parameters.pack(), fast_gp.pack(gp)])


@njit(cache=True, error_model="numpy")
def step(s, u, p, out):
    """The state one dt later, into out (6,)."""
    p[EXTRA] = mean(p, np.int64(p[PROCESS]), s)
    ring_dynamics.step(s, u, p, out)


@njit(cache=True, error_model="numpy")
def linearise(s, u, p, out, A, B):
    """`step`, and its derivatives by s and u, into A (6, 6) and B (6, 2)."""
    by_state = np.empty(6)
    p[EXTRA] = mean_and_gradient(p, np.int64(p[PROCESS]), s, by_state)
    ring_dynamics.linearise(s, u, p, out, A, B)
    for j in range(6):
        A[0, j] += p[BY_ANGLE] * by_state[j]
        A[1, j] += p[BY_RATE] * by_state[j]
