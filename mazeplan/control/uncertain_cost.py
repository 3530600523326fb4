"""Cost of a motion along one ring, with a price on the uncertainty of the learned model.

Each step costs as in `cost`, plus

    w v(s)      v: variance of the learned part of theta_dd at s, given the nearest training row

Therefore plans prefer states that the rig has visited. v is never smaller than the variance given all rows, and needs
only one pass over the rows.

The packed vector is that of `cost`, then w, the noise variance of a sample, and the learned part by
`fast_gp.pack`. Numba caches these functions by the date of this file: touch this file after changing functions
that it calls. int64() is there because with a bare constant Numba would compile all callees once more.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from mazeplan.control import cost
from mazeplan.control.cost import CostParameters
from mazeplan.core.records import Array
from mazeplan.learning import fast_gp
from mazeplan.learning.fast_gp import D, variance_and_derivatives
from mazeplan.learning.fast_gp import variance as variance_at
from mazeplan.learning.gaussian_process import GaussianProcess

PLAIN = len(CostParameters().pack(0.0))  # length of the vector of `cost`
_WEIGHT, _NOISE, _PROCESS = PLAIN, PLAIN + 1, PLAIN + 2

final, final_derivatives = cost.final, cost.final_derivatives
plain_running, plain_derivatives = cost.running, cost.running_derivatives


def pack(parameters: CostParameters, part: GaussianProcess) -> Array:
    """The packed vector; the caller fills its first PLAIN numbers from `CostParameters.pack`."""
    noise = part.hyper.noise
    return np.concatenate([np.zeros(PLAIN), [parameters.uncertainty, noise * noise], fast_gp.pack(part)])


@njit(cache=True, error_model="numpy")
def running(k, s, u, q):
    """Cost of step k."""
    gap = np.empty(D)
    return plain_running(k, s, u, q) + q[_WEIGHT] * variance_at(q, np.int64(_PROCESS), s, q[_NOISE], gap)


@njit(cache=True, error_model="numpy")
def running_derivatives(k, s, u, q, lx, lu, lxx, luu):
    """Gradient (6,), (2,) and Hessians (6, 6), (2, 2) of `running`."""
    plain_derivatives(k, s, u, q, lx, lu, lxx, luu)
    gap, by_state, bend = np.empty(D), np.empty(6), np.empty(6)
    variance_and_derivatives(q, np.int64(_PROCESS), s, q[_NOISE], gap, by_state, bend)
    for i in range(6):
        lx[i] += q[_WEIGHT] * by_state[i]
        lxx[i, i] += q[_WEIGHT] * bend[i]
