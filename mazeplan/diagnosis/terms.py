"""Terms of an acceleration that more than one system has, compiled: x, v, t, inputs w, parameters p."""

from __future__ import annotations

import math

from numba import njit


@njit(cache=True)
def viscous(x, v, t, w, p):
    """- p0 v."""
    return -p[0] * v


@njit(cache=True)
def quadratic(x, v, t, w, p):
    """- p0 v |v|."""
    return -p[0] * v * abs(v)


@njit(cache=True)
def constant(x, v, t, w, p):
    """p0."""
    return p[0]


@njit(cache=True)
def drift(x, v, t, w, p):
    """- (p0 t + p1) v: friction that changes with time, from p1 more than it was said to be."""
    return -(p[0] * t + p[1]) * v


@njit(cache=True)
def harmonics(x, v, t, w, p):
    """Sum over n of p[2n - 2] cos(n x) + p[2n - 1] sin(n x)."""
    total = 0.0
    for n in range(len(p) // 2):
        total += p[2 * n] * math.cos((n + 1) * x) + p[2 * n + 1] * math.sin((n + 1) * x)
    return total


@njit(cache=True)
def bump(x, v, t, w, p):
    """Force of a hill at angle p0, of width p1, largest on its flanks: p2."""
    e = math.atan2(math.sin(x - p[0]), math.cos(x - p[0])) / p[1]
    return p[2] * e * math.exp(0.5 - 0.5 * e * e)


@njit(cache=True)
def oscillation(x, v, t, w, p):
    """p1 cos(2 pi p0 t) + p2 sin(2 pi p0 t)."""
    phase = 2.0 * math.pi * p[0] * t
    return p[1] * math.cos(phase) + p[2] * math.sin(phase)


@njit(cache=True)
def ring(x, v, t, w, p):
    """A ball in a ring of a tilting plate, without friction.

    p: g / r, factor of the gravity part, tilt of the table beta_0, gamma_0 (rad), angle of the camera (rad), scales of
    the tilt sensor; w: beta, its rate and acceleration, gamma's."""
    theta = x - p[4]
    b, bd, bdd = w[0] / p[5], w[1] / p[5], w[2] / p[5]
    c, cd = w[3] / p[6], w[4] / p[6]
    sin, cos, cos_c = math.sin(theta), math.cos(theta), math.cos(c)
    turning = bdd * math.sin(c) + 2.0 * bd * cd * cos_c * sin * sin + (cd * cd - bd * bd * cos_c * cos_c) * sin * cos
    beta, gamma = b + p[2], c + p[3]
    return turning - p[0] * p[1] * (math.sin(beta) * sin + math.sin(gamma) * math.cos(beta) * cos)
