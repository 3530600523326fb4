"""What walls and their openings do to a ball in a ring, compiled.

A ball rests against the outer or the inner wall of its channel, as what presses it outwards is positive or negative:

    N / R = v^2 + f (g / R) (sin(beta) cos(theta) - sin(gamma) sin(theta)),      f = 5/9

with R the track radius; f is what is left of gravity for a ball that rolls on floor and wall at once, 1 / (1 + 2 2/5).
The wall takes mu |N| / R off its angular acceleration (Coulomb), and an opening throws back, at its far edge, only a
ball that lies against the wall it is in.
"""

from __future__ import annotations

import math

from numba import njit

ROLLING = 5.0 / 9.0
WIDTH = 0.1  # m/s^2; how sharply a ball changes sides: the tilt is known to about 0.5 degrees, which is as much
GRAVITY = 9.81  # m/s^2
FIRST_RIPPLE, RIPPLES = 4, 6  # first harmonic, and how many; those below are `terms.harmonics`


@njit(cache=True, error_model="numpy")
def pressing(x, v, w, pull):
    """N / R (rad/s^2) at angle x, speed v, tilt w[0] (beta) and w[3] (gamma); pull: g / R (1/s^2)."""
    return v * v + ROLLING * pull * (math.sin(w[0]) * math.cos(x) - math.sin(w[3]) * math.sin(x))


@njit(cache=True, error_model="numpy")
def against(normal, pull, side):
    """Share (0 to 1) in which a ball pressed outwards by `normal` = N / R lies against the wall; side: 1 the outer, -1
    the inner, 0 both."""
    if side == 0.0:
        return 1.0
    return 1.0 / (1.0 + math.exp(-side * normal * GRAVITY / (pull * WIDTH)))


@njit(cache=True)
def ripples(x, v, t, w, p):
    """Sum over n = 4 to 9 of p[2n - 8] cos(n x) + p[2n - 7] sin(n x), rad/s^2."""
    c1, s1, total = math.cos(x), math.sin(x), 0.0
    c, s = math.cos(FIRST_RIPPLE * x), math.sin(FIRST_RIPPLE * x)
    for i in range(RIPPLES):
        total += p[2 * i] * c + p[2 * i + 1] * s
        c, s = c * c1 - s * s1, s * c1 + c * s1
    return total
