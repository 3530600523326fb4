"""Structure without a name: what an acceleration depends on when no effect explains it.

Each is a small sum over products of the variables in its `depends_on`; `past` are low-passed speeds, inputs w[6:9] with
the time constants PAST. They are tried beside the named effects, so that some wrong names do not stand in for one
unknown; what they find is reported as a dependence, never as an effect.
"""

from __future__ import annotations

import math

from numba import njit

from mazeplan.diagnosis.library import Candidate, Spec

PAST = (0.15, 0.5, 1.5)  # s


@njit(cache=True)
def speed_tilt(x, v, t, w, p):
    """v (p0 beta + p1 gamma)."""
    return v * (p[0] * w[0] + p[1] * w[3])


@njit(cache=True)
def speed_lean(x, v, t, w, p):
    """v |tilt|, and v times the outward lean and its size."""
    lean = w[0] * math.cos(x) - w[3] * math.sin(x)
    return v * (p[0] * math.sqrt(w[0] * w[0] + w[3] * w[3]) + p[1] * lean + p[2] * abs(lean))


@njit(cache=True)
def sign_lean(x, v, t, w, p):
    """Direction of motion times the outward lean and its size."""
    lean, sign = w[0] * math.cos(x) - w[3] * math.sin(x), math.tanh(v / 0.05)
    return sign * (p[0] * lean + p[1] * abs(lean))


@njit(cache=True)
def speed_angle(x, v, t, w, p):
    """v times the first two harmonics of the angle."""
    return v * (p[0] * math.cos(x) + p[1] * math.sin(x) + p[2] * math.cos(2.0 * x) + p[3] * math.sin(2.0 * x))


@njit(cache=True)
def tilt_rates(x, v, t, w, p):
    """Rates of the tilt, as they stand and along the ring."""
    return p[0] * w[1] + p[1] * w[4] + p[2] * w[1] * math.sin(x) + p[3] * w[4] * math.cos(x)


@njit(cache=True)
def tilt_squares(x, v, t, w, p):
    """Squares and product of the tilts."""
    return p[0] * w[0] * w[0] + p[1] * w[3] * w[3] + p[2] * w[0] * w[3]


@njit(cache=True)
def cubic(x, v, t, w, p):
    """Odd and even powers of the speed."""
    return p[0] * v * v * v + p[1] * v * v


@njit(cache=True)
def memory(x, v, t, w, p):
    """Low-passed speeds."""
    return p[0] * w[6] + p[1] * w[7] + p[2] * w[8]


@njit(cache=True)
def ripples(x, v, t, w, p):
    """Harmonics 4 to 7 of the angle."""
    c1, s1, total = math.cos(x), math.sin(x), 0.0
    c, s = math.cos(4.0 * x), math.sin(4.0 * x)
    for n in range(4):
        total += p[2 * n] * c + p[2 * n + 1] * s
        c, s = c * c1 - s * s1, s * c1 + c * s1
    return total


@njit(cache=True)
def backward_tilt(x, v, t, w, p):
    """Pull of tilts that come from the record played backwards."""
    return p[0] * w[9] * math.sin(x) + p[1] * w[10] * math.cos(x)


@njit(cache=True)
def backward_speed(x, v, t, w, p):
    """Friction that goes with them."""
    return v * (p[0] * w[9] + p[1] * w[10])


def _free(count: int, step: float = 1e-3) -> dict[str, Spec]:
    return {f"p{i}": Spec("", 0.0, -1e3, 1e3, step) for i in range(count)}


def anonymous_library() -> list[Candidate]:
    """All of them."""

    def one(name: str, term, count: int, *depends_on: str) -> Candidate:
        return Candidate(name, _free(count), term=term, named=False, depends_on=depends_on)

    return [
        one("speed and tilt", speed_tilt, 2, "theta_dot", "beta", "gamma"),
        one("speed and lean", speed_lean, 3, "theta_dot", "theta", "beta", "gamma"),
        one("direction and lean", sign_lean, 2, "theta_dot", "theta", "beta", "gamma"),
        one("speed and angle", speed_angle, 4, "theta_dot", "theta"),
        one("tilt rates", tilt_rates, 4, "beta_dot", "gamma_dot", "theta"),
        one("tilt squared", tilt_squares, 3, "beta", "gamma"),
        one("powers of the speed", cubic, 2, "theta_dot"),
        one("past speed", memory, 3, "theta_dot", "past of theta_dot"),
        one("ripples along the ring", ripples, 8, "theta"),
    ]


def placebos() -> list[Candidate]:
    """What cannot be there. They are tried like the others and must lose: what does not explain clearly more than the
    best of them is not believed."""
    return [
        Candidate("placebo: tilt played backwards", _free(2), term=backward_tilt, named=False, placebo=True),
        Candidate("placebo: friction with it", _free(2), term=backward_speed, named=False, placebo=True),
    ]
