"""Simulate windows of a record, compiled: each window starts from its own initial state.

    x_dd_i = sum of terms_i(x, x_dot, t, w; p) - direction_i * hold_i(x, x_dot, t, w; p)        i: coordinate

Runge-Kutta 4 from sample to sample, whatever the time between two samples is; a long step is divided. Dry friction has
no smoothing: a step ends where a speed crosses zero. There, a coordinate stays at rest as long as the other forces are
smaller than its friction.

The terms are called through their addresses (`core.maths.compiled`), so this module is compiled once for all systems.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from mazeplan.core.maths.compiled import CALLEE, KERNEL, pointer_to, shifted
from mazeplan.core.records import Array, IntArray
from mazeplan.physics.formulas.compiled import call_term as _term

STUCK = 2.0  # direction of a coordinate at rest
EVENTS = 6  # maximum number of changes of direction within one step
LEFT = 1e6  # a coordinate beyond this multiple of the record's range has left it; the simulation stops there


class Problem(NamedTuple):
    """What the simulation needs beside states and parameters."""

    t: Array  # times (N,)
    w: Array  # inputs (N, 2, W) at the begin and at the end of the step that follows each sample
    terms: IntArray  # rows of address, coordinate, first parameter (J, 3)
    holds: IntArray  # the same of dry friction
    divide: IntArray  # number of parts of each step (N,)
    windows: IntArray  # first row and the row behind the last one (M, 2)
    limit: Array  # size of a coordinate at which a simulation has left the record (C,)


class Step(NamedTuple):
    """Pointers to what a step works on: passing arrays on would cost more than the arithmetic."""

    terms: Any  # as in `Problem`
    holds: Any
    p: Any  # parameters
    w: Any  # inputs and coordinates at a moment
    x: Any  # state (2 C) at the begin of a step
    xs: Any  # during the step
    new: Any  # at its end
    slope: Any  # of Runge-Kutta (2 C)
    total: Any
    a: Any  # acceleration without dry friction (C)
    hold: Any  # size of dry friction (C)
    direction: Any  # of the motion (C)
    held: Any  # whether there is dry friction (C)


@njit(inline="always", **CALLEE)
def _copy(source, to, n):
    """Copy n numbers."""
    for i in range(n):
        to[i] = source[i]


@njit(inline="always", **CALLEE)
def _forces(q, sizes, x, t, inputs, s):
    """Acceleration without dry friction, and size of dry friction, in state x at the share s of a sample's step."""
    c, u, n_terms, n_holds = sizes
    for i in range(u):
        q.w[i] = inputs[i] + s * (inputs[u + i] - inputs[i])
    if c > 1:
        for i in range(c):
            q.w[u + 2 * i] = x[i]
            q.w[u + 2 * i + 1] = x[c + i]
    for i in range(c):
        q.a[i] = q.hold[i] = 0.0
    for j in range(n_terms):
        i = q.terms[3 * j + 1]
        q.a[i] += _term(q.terms[3 * j], (x[i], x[c + i], t, q.w, shifted(q.p, q.terms[3 * j + 2])))
    for j in range(n_holds):
        i = q.holds[3 * j + 1]
        size = _term(q.holds[3 * j], (x[i], x[c + i], t, q.w, shifted(q.p, q.holds[3 * j + 2])))
        q.hold[i] += max(size, 0.0)


@njit(inline="always", **CALLEE)
def _direct(q, c):
    """Directions of dry friction, from the forces and the state at the begin of a step."""
    for i in range(c):
        v, a = q.x[c + i], q.a[i]
        if q.held[i] == 0.0:
            q.direction[i] = 0.0
        elif v != 0.0:
            q.direction[i] = 1.0 if v > 0.0 else -1.0
        elif abs(a) <= q.hold[i]:
            q.direction[i] = STUCK
        else:
            q.direction[i] = 1.0 if a > 0.0 else -1.0


@njit(inline="always", **CALLEE)
def _runge_kutta(q, sizes, t, h, inputs, s0, width, known):
    """One step with fixed directions from q.x to q.new. known: whether the forces at its begin are there already"""
    c = sizes[0]
    for stage in range(4):
        d = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
        for i in range(2 * c):
            q.xs[i] = q.x[i] if stage == 0 else q.x[i] + d * h * q.slope[i]
        if stage > 0 or not known:
            _forces(q, sizes, q.xs, t + d * h, inputs, s0 + d * width)
        for i in range(c):
            moves = q.direction[i] != STUCK
            q.slope[i] = q.xs[c + i] if moves else 0.0
            q.slope[c + i] = q.a[i] - q.direction[i] * q.hold[i] if moves else 0.0
        for i in range(2 * c):
            one = q.slope[i] if stage in (0, 3) else 2.0 * q.slope[i]
            q.total[i] = one if stage == 0 else q.total[i] + one
    for i in range(2 * c):
        q.new[i] = q.x[i] + h / 6.0 * q.total[i]


@njit(inline="always", **CALLEE)
def _reversal(q, c):
    """The first coordinate whose direction turns round in a step (-1: none), and the share of the step until then."""
    which, share = -1, 1.0
    for i in range(c):
        if q.held[i] != 0.0 and q.direction[i] != STUCK and q.new[c + i] * q.direction[i] < 0.0:
            here = q.x[c + i] / (q.x[c + i] - q.new[c + i])
            if here < share:
                which, share = i, here
    return which, share


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
    times, inputs, windows, limit, divide = problem.t, problem.w, problem.windows, problem.limit, problem.divide
    sizes = c, u, len(problem.terms), len(problem.holds)
    y, vectors, w = np.full((n, size), np.nan), np.zeros((9, size)), np.zeros(u + 2 * c)
    for j in range(len(problem.holds)):
        vectors[8, problem.holds[j, 1]] = 1.0
    q = Step(
        pointer_to(problem.terms, 0), pointer_to(problem.holds, 0), pointer_to(p, 0), pointer_to(w, 0),
        pointer_to(vectors, 0), pointer_to(vectors, size), pointer_to(vectors, 2 * size),
        pointer_to(vectors, 3 * size), pointer_to(vectors, 4 * size), pointer_to(vectors, 5 * size),
        pointer_to(vectors, 6 * size), pointer_to(vectors, 7 * size), pointer_to(vectors, 8 * size),
    )  # fmt: skip
    for m in range(len(windows)):
        _copy(pointer_to(x0, m * size), q.x, size)
        for row in range(windows[m, 0], windows[m, 1] - 1):
            parts, whole, at_inputs = divide[row], times[row + 1] - times[row], pointer_to(inputs, 2 * u * row)
            for part in range(parts):
                s0, stop = part / parts, (part + 1) / parts
                events, ends, which = 0, False, -1  # ends: whether this step ends where a speed crosses zero
                share = 1.0  # of the rest of this part
                while True:
                    t, h = times[row] + s0 * whole, share * (stop - s0) * whole
                    known = sizes[3] > 0 and not ends
                    if known:
                        _forces(q, sizes, q.x, t, at_inputs, s0)
                        _direct(q, c)
                    _runge_kutta(q, sizes, t, h, at_inputs, s0, share * (stop - s0), known)
                    if ends:
                        _copy(q.new, q.x, size)
                        q.x[c + which] = 0.0
                        s0, share, ends = s0 + share * (stop - s0), 1.0, False
                        continue
                    which, share = _reversal(q, c)
                    events += 1
                    if which < 0 or events > EVENTS:
                        _copy(q.new, q.x, size)
                        break
                    if share > 1e-9:
                        ends = True
                    else:
                        q.x[c + which], share = 0.0, 1.0
            for i in range(c):
                if not abs(q.x[i]) < limit[i]:
                    q.x[i], q.x[c + i] = limit[i], 0.0
            _copy(q.x, pointer_to(y, (row + 1) * size), size)
    return y
