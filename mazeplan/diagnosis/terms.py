"""Terms of an acceleration that more than one system has, compiled: x, v, t, inputs w, parameters p (w and p are bare
pointers in the filter: they are indexed and have no length)."""

from __future__ import annotations

import math

from numba import njit

HARMONICS = 3


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
    """Sum over n to HARMONICS of p[2n - 2] cos(n x) + p[2n - 1] sin(n x)."""
    c1, s1, total = math.cos(x), math.sin(x), 0.0
    c, s = c1, s1
    for n in range(HARMONICS):
        total += p[2 * n] * c + p[2 * n + 1] * s
        c, s = c * c1 - s * s1, s * c1 + c * s1
    return total


@njit(cache=True)
def bump(x, v, t, w, p):
    """Force of a hill at angle p0, of width p1, largest on its flanks: p2."""
    off = x - p[0]
    e = (off - 2.0 * math.pi * math.floor(off / (2.0 * math.pi) + 0.5)) / p[1]
    if abs(e) > 7.0:  # 1e-10 of its height
        return 0.0
    return p[2] * e * math.exp(0.5 - 0.5 * e * e)


@njit(cache=True)
def oscillation(x, v, t, w, p):
    """p1 cos(2 pi p0 t) + p2 sin(2 pi p0 t)."""
    phase = 2.0 * math.pi * p[0] * t
    return p[1] * math.cos(phase) + p[2] * math.sin(phase)


PAST_AT, PLACEBO_AT = 6, 9  # where in w past speeds (3) and the placebos' inputs (2) begin, behind the plate's motion
RING_AT = 11  # ... and the coefficients of `ring`
RING_COUNT = 5


@njit(cache=True)
def ring(x, v, t, w, p):
    """A ball in a ring of a tilting plate, without friction; p: camera's angle (rad); w: see `ring_coefficients`."""
    sin, cos = math.sin(x - p[0]), math.cos(x - p[0])
    return w[11] + sin * (w[12] * sin + w[13] * cos - w[14]) - w[15] * cos


@njit(cache=True, error_model="numpy")
def _sine(x):
    """sin x; of tilts by its series, 1e-12 exact."""
    if abs(x) > 0.25:
        return math.sin(x)
    y = x * x
    return x * (1.0 - y / 6.0 * (1.0 - y / 20.0 * (1.0 - y / 42.0 * (1.0 - y / 72.0))))


@njit(cache=True, error_model="numpy")
def _cosine(x):
    """cos x, likewise."""
    if abs(x) > 0.25:
        return math.cos(x)
    y = x * x
    return 1.0 - y / 2.0 * (1.0 - y / 12.0 * (1.0 - y / 30.0 * (1.0 - y / 56.0 * (1.0 - y / 90.0))))


@njit(cache=True, error_model="numpy")
def ring_coefficients(w, p):
    """What `ring` needs of the plate's motion w[0:6], into w[RING_AT:]:

        theta_dd = c_0 + c_1 sin^2 + c_2 sin cos - c_3 sin - c_4 cos of theta

    p: g / r, factor of the gravity part, tilt of the table beta_0, gamma_0 (rad), scales of the tilt sensor; motion:
    beta, its rate and acceleration, gamma's."""
    b, bd, bdd = w[0] / p[4], w[1] / p[4], w[2] / p[4]
    c, cd = w[3] / p[5], w[4] / p[5]
    cos_c = _cosine(c)
    w[11] = bdd * _sine(c)
    w[12] = 2.0 * bd * cd * cos_c
    w[13] = cd * cd - bd * bd * cos_c * cos_c
    w[14] = p[0] * p[1] * _sine(b + p[2])
    w[15] = p[0] * p[1] * _sine(c + p[3]) * _cosine(b + p[2])
