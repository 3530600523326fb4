"""Discrete dynamics of a ring with a learned part: those of `ring_dynamics`, plus a Gaussian process.

The learned part is evaluated once a step, at its beginning, and held over the step like the command. The parameters are
those of `RingParameters.pack`, then the learned part (`fast_gp.pack`). Numba caches this function by the date of this
file alone: touch this file, too, if you change a function that it calls.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from mazeplan.core.maths.compiled import KERNEL
from mazeplan.core.records import Array
from mazeplan.learning import fast_gp
from mazeplan.learning.fast_gp import mean_and_gradient
from mazeplan.learning.gaussian_process import GaussianProcess
from mazeplan.physics.dynamics import ring_dynamics
from mazeplan.physics.dynamics.ring_parameters import BY_ANGLE, BY_RATE, EXTRA, PROCESS, RingParameters


def pack(parameters: RingParameters, part: GaussianProcess) -> Array:
    """The vector of parameters of `linearise`."""
    return np.concatenate([parameters.pack(), fast_gp.pack(part)])


@njit(**KERNEL)
def linearise(s, u, p, out, A, B):
    """The state one dt later, into out (6,), and its derivatives by s and u, into A (6, 6) and B (6, 2)."""
    by_state = np.empty(6)
    p[EXTRA] = mean_and_gradient(p, np.int64(p[PROCESS]), s, by_state)
    ring_dynamics.linearise(s, u, p, out, A, B)
    for j in range(6):
        A[0, j] += p[BY_ANGLE] * by_state[j]
        A[1, j] += p[BY_RATE] * by_state[j]
