"""Quadratic programme in two variables inside a box, in closed form, compiled.

    minimise 1/2 x' H x + g' x   subject to   lower <= x <= upper,        H symmetric positive definite

The objective is convex. If its unconstrained minimum lies outside the box, its minimum in the box lies on the border.
Each of the four edges is then a problem in one variable. This is the inner problem of control-limited DDP (Tassa,
Mansard, Todorov, ICRA 2014). There, a variable is free unless the gradient holds it at a bound.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from mazeplan.core.maths.compiled import KERNEL


@njit(cache=True, error_model="numpy", inline="always")
def _clip(x, low, high):
    return min(max(x, low), high)


@njit(**KERNEL)
def box_qp(h00, h01, h11, g0, g1, low0, high0, low1, high1):
    """Minimise the objective in the box. Returns (x0, x1, free0, free1, ok).

    x0, x1:        the minimiser; it meets the bounds exactly
    free0, free1:  whether the variable is free; it is not free if its bounds coincide, or if it is at a bound and the
                   objective would fall beyond this bound
    ok:            whether H is positive definite; if not (also for NaN), the other results are zero and False

    Arguments and results are scalars, so that nothing is allocated.
    """
    det = h00 * h11 - h01 * h01
    if not (h00 > 0.0 and h11 > 0.0 and det > 0.0):
        return 0.0, 0.0, False, False, False
    x0, x1 = (h01 * g1 - h11 * g0) / det, (h01 * g0 - h00 * g1) / det
    if not (low0 <= x0 <= high0 and low1 <= x1 <= high1):
        best = np.inf
        for edge in range(4):
            if edge < 2:
                e0 = low0 if edge == 0 else high0
                e1 = _clip(-(g1 + h01 * e0) / h11, low1, high1)
            else:
                e1 = low1 if edge == 2 else high1
                e0 = _clip(-(g0 + h01 * e1) / h00, low0, high0)
            cost = 0.5 * (h00 * e0 * e0 + h11 * e1 * e1) + h01 * e0 * e1 + g0 * e0 + g1 * e1
            if cost < best:
                best, x0, x1 = cost, e0, e1
    slope0, slope1 = h00 * x0 + h01 * x1 + g0, h01 * x0 + h11 * x1 + g1
    held0 = low0 >= high0 or (x0 <= low0 and slope0 > 0.0) or (x0 >= high0 and slope0 < 0.0)
    held1 = low1 >= high1 or (x1 <= low1 and slope1 > 0.0) or (x1 >= high1 and slope1 < 0.0)
    return x0, x1, not held0, not held1, True
