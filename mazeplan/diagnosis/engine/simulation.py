"""Simulate windows of a record, compiled: each window starts from its own initial state.

    x_dd_i = sum of terms_i(x, x_dot, t, w; p) - direction_i * hold_i(x, x_dot, t, w; p)        i: coordinate

Runge-Kutta 4 from sample to sample, whatever the time between two samples is; a long step is divided. Dry friction has
no smoothing: a step ends where a speed crosses zero. There, a coordinate stays at rest as long as the other forces are
smaller than its friction.

The terms are called through their addresses (`core.maths.compiled`), so this module is compiled once for all systems.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from mazeplan.core.maths.compiled import KERNEL, pointer_to, shifted
from mazeplan.core.records import Array, IntArray
from mazeplan.physics.formulas.compiled import call_term as _term

STUCK = 2.0  # direction of a coordinate at rest
EVENTS = 6  # maximum number of changes of direction within one step
LEFT = 1e6  # a coordinate beyond this multiple of the record's range has left it; the simulation stops there


class Problem(NamedTuple):
    """What the simulation needs beside states and parameters.

    t: times (N,)
    w: inputs (N, 2, W) at the begin and at the end of the step that follows each sample
    terms, holds: rows of address, coordinate, first parameter (J, 3)
    divide: number of parts of each step (N,)
    windows: first row and the row behind the last one (M, 2)
    limit: size of a coordinate at which a simulation has left the record (C,)"""

    t: Array
    w: Array
    terms: IntArray
    holds: IntArray
    divide: IntArray
    windows: IntArray
    limit: Array


@njit(cache=True, error_model="numpy", inline="always")
def _forces(terms, holds, n_terms, n_holds, c, x, t, w, pw, pp, u, a, hold):
    """Acceleration without dry friction into a, and size of dry friction into hold. pw, pp: pointers to w, p"""
    if c > 1:
        for i in range(c):
            w[u + 2 * i] = x[i]
            w[u + 2 * i + 1] = x[c + i]
    for i in range(c):
        a[i] = 0.0
        hold[i] = 0.0
    for j in range(n_terms):
        i = terms[j, 1]
        a[i] += _term(terms[j, 0], (x[i], x[c + i], t, pw, shifted(pp, terms[j, 2])))
    for j in range(n_holds):
        i = holds[j, 1]
        hold[i] += max(_term(holds[j, 0], (x[i], x[c + i], t, pw, shifted(pp, holds[j, 2]))), 0.0)


@njit(**KERNEL)
def decayed(x, e, forced):
    """x_k+1 = e_k x_k + forced_k from x_0 = x, (N + 1,), for factors and forces (N,)."""
    out = np.empty(len(e) + 1)
    out[0] = x
    for k in range(len(e)):
        x = x * e[k] + forced[k]
        out[k + 1] = x
    return out


@njit(**KERNEL)
def simulate(problem, p, x0):
    """Coordinates and speeds (N, 2 C) of windows that start in states x0 (M, 2 C); NaN where no window is.

    The first row of a window holds the end of the window before, if there is one."""
    n, size = len(problem.t), x0.shape[1]
    c, u = size // 2, problem.w.shape[2]
    times, inputs, windows, limit = problem.t, problem.w, problem.windows, problem.limit
    terms, holds, divide = problem.terms, problem.holds, problem.divide
    n_terms, n_holds = len(terms), len(holds)
    y = np.full((n, size), np.nan)
    x, out, xs = np.empty(size), np.empty(size), np.empty(size)
    a, hold, direction = np.empty(c), np.zeros(c), np.zeros(c)
    held = np.zeros(c, dtype=np.bool_)
    for j in range(n_holds):
        held[holds[j, 1]] = True
    k = np.empty((4, size))
    w = np.zeros(u + 2 * c)
    pw, pp = pointer_to(w, 0), pointer_to(p, 0)
    for m in range(len(windows)):
        first, last = windows[m, 0], windows[m, 1]
        for i in range(size):
            x[i] = x0[m, i]
        for row in range(first, last - 1):
            parts, whole = divide[row], times[row + 1] - times[row]
            for part in range(parts):
                s0, stop = part / parts, (part + 1) / parts
                events, begun, which = 0, False, -1
                share = 1.0  # of the rest of this part
                while True:
                    t, h = times[row] + s0 * whole, share * (stop - s0) * whole
                    known = n_holds > 0 and not begun
                    if known:
                        for i in range(u):
                            w[i] = inputs[row, 0, i] + s0 * (inputs[row, 1, i] - inputs[row, 0, i])
                        _forces(terms, holds, n_terms, n_holds, c, x, t, w, pw, pp, u, a, hold)
                        for i in range(c):
                            v = x[c + i]
                            direction[i] = 0.0
                            if held[i]:
                                if v != 0.0:
                                    direction[i] = 1.0 if v > 0.0 else -1.0
                                elif abs(a[i]) <= hold[i]:
                                    direction[i] = STUCK
                                else:
                                    direction[i] = 1.0 if a[i] > 0.0 else -1.0
                    for stage in range(4):  # Runge-Kutta 4 with fixed directions
                        d = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
                        for i in range(size):
                            xs[i] = x[i] if stage == 0 else x[i] + d * h * k[stage - 1, i]
                        if stage > 0 or not known:
                            s = s0 + d * share * (stop - s0)
                            for i in range(u):
                                w[i] = inputs[row, 0, i] + s * (inputs[row, 1, i] - inputs[row, 0, i])
                            _forces(terms, holds, n_terms, n_holds, c, xs, t + d * h, w, pw, pp, u, a, hold)
                        for i in range(c):
                            moves = direction[i] != STUCK
                            k[stage, i] = xs[c + i] if moves else 0.0
                            k[stage, c + i] = a[i] - direction[i] * hold[i] if moves else 0.0
                    for i in range(size):
                        out[i] = x[i] + h / 6.0 * (k[0, i] + 2.0 * k[1, i] + 2.0 * k[2, i] + k[3, i])
                    if begun:  # the step ended where a speed crossed zero
                        for i in range(size):
                            x[i] = out[i]
                        x[c + which] = 0.0
                        s0, share, begun = s0 + share * (stop - s0), 1.0, False
                        continue
                    which, share = -1, 1.0
                    for i in range(c):
                        if held[i] and direction[i] != STUCK and out[c + i] * direction[i] < 0.0:
                            here = x[c + i] / (x[c + i] - out[c + i])
                            if here < share:
                                which, share = i, here
                    events += 1
                    if which < 0 or events > EVENTS:
                        for i in range(size):
                            x[i] = out[i]
                        break
                    if share > 1e-9:
                        begun = True
                    else:
                        x[c + which], share = 0.0, 1.0
            for i in range(c):
                if not abs(x[i]) < limit[i]:
                    x[i], x[c + i] = limit[i], 0.0
            for i in range(size):
                y[row + 1, i] = x[i]
    return y
