"""What walls and their openings do to a ball in a ring, compiled.

A ball rests against the outer or the inner wall of its channel, as what presses it outwards is positive or negative:

    N / R = v^2 + f (g / R) (sin(beta) cos(theta) - sin(gamma) sin(theta)),      f = 5/9

with R the track radius; f is what is left of gravity for a ball that rolls on floor and wall at once, 1 / (1 + 2 2/5).
The wall takes mu |N| / R off its angular acceleration (Coulomb), and an opening throws back, at its far edge, only a
ball that lies against the wall it is in.

How much, depends on how deep the ball has sunk into the opening on its way across, b: away from the wall it falls as a
ball that rolls on the floor does (f = 5/7), and when it meets the edge, the edge takes the part of the speed v that
goes against it, sin^2 of the angle between edge and middle of the ball, of radius a:

    d = b / a = s N' / (R v^2),    share = 1 - (1 - d)^2

s is d where nothing but its turning presses: width^2 / (2 R a), were the whole width crossed in the air. N' is N by
what the tilt was of late: a ball needs about a tenth of a second from wall to wall, too.
"""

from __future__ import annotations

import math

from numba import njit

from mazeplan.diagnosis.terms import RING_AT, RING_COUNT

ROLLING = 5.0 / 9.0
WIDTH = 0.1  # m/s^2; how sharply a ball changes sides, unless that is fitted: the tilt is known to about 0.5 degrees
GRAVITY = 9.81  # m/s^2
FREE = 5.0 / 7.0  # of gravity that a ball feels which rolls on the floor alone
LEAN_AT, LEANS = RING_AT + RING_COUNT, 2  # where in w the tilt of late is, beta and gamma
LEAN_S = 0.05  # s; time constant of its average
SLOWEST = 1e-9  # rad^2/s^2
FIRST_RIPPLE, RIPPLES, FINE_RIPPLES = 4, 6, 14  # first harmonic, and how many; those below are `terms.harmonics`


@njit(cache=True, error_model="numpy")
def pressing(x, v, w, pull):
    """N / R (rad/s^2) at angle x, speed v, tilt w[0] (beta) and w[3] (gamma); pull: g / R (1/s^2)."""
    return v * v + ROLLING * pull * (math.sin(w[0]) * math.cos(x) - math.sin(w[3]) * math.sin(x))


@njit(cache=True, error_model="numpy")
def against(normal, pull, side, width):
    """Share (0 to 1) in which a ball pressed outwards by `normal` = N / R lies against the wall; side: 1 the outer, -1
    the inner, 0 both; width: how sharply it changes sides, m/s^2."""
    if side == 0.0:
        return 1.0
    return 1.0 / (1.0 + math.exp(-side * normal * GRAVITY / (pull * width)))


@njit(cache=True, error_model="numpy")
def struck(x, v, w, pull, sinking, side):
    """Share (0 to 1) of its speed v with which a ball at x runs against the far edge of an opening in the wall on a
    side (1 outer, -1 inner); sinking: by how much of its radius it sinks in where nothing but its turning presses."""
    across = math.sin(w[LEAN_AT]) * math.cos(x) - math.sin(w[LEAN_AT + 1]) * math.sin(x)
    depth = sinking * side * (1.0 + FREE * pull * across / (v * v + SLOWEST))
    depth = min(max(depth, 0.0), 1.0)
    return depth * (2.0 - depth)


@njit(cache=True)
def _rippled(x, p, count):
    """Sum over n = 4 to 3 + count of p[2n - 8] cos(n x) + p[2n - 7] sin(n x)."""
    c1, s1, total = math.cos(x), math.sin(x), 0.0
    c, s = math.cos(FIRST_RIPPLE * x), math.sin(FIRST_RIPPLE * x)
    for i in range(count):
        total += p[2 * i] * c + p[2 * i + 1] * s
        c, s = c * c1 - s * s1, s * c1 + c * s1
    return total


@njit(cache=True)
def ripples(x, v, t, w, p):
    """Harmonics 4 to 9 of a force along the ring, rad/s^2; p: their cosines and sines in turn."""
    return _rippled(x, p, RIPPLES)


@njit(cache=True)
def fine_ripples(x, v, t, w, p):
    """Harmonics 4 to 17, likewise."""
    return _rippled(x, p, FINE_RIPPLES)
