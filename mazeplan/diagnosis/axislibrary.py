"""The effects that a diagnosis can name on a drive axis; what a ball in a ring has too has the same name and term.

    M q_dd = force + sum of effects,    effects in N

There is no delay among them: under control the force follows from the position that was measured, so that a term like a
delay fits the controller of one record and not the axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from numba import njit

from mazeplan.diagnosis import terms
from mazeplan.diagnosis.anonymous import cubic
from mazeplan.diagnosis.library import DRY, Candidate, Spec

LOAD, MASS = "moving_mass", "mass"  # effect, and where it acts
WORTH = 0.02  # of the force's root mean square; an effect that is smaller is not worth a word
FINE = 0.1  # step of numeric derivatives, in smallest sizes


@njit(cache=True)
def drive(x, v, t, w, p):
    """Force w0 on a mass whose inverse is p0."""
    return p[0] * w[0]


@njit(cache=True)
def lopsided(x, v, t, w, p):
    """- p0 |v|: a viscous friction that is larger by p0 forwards and smaller by it backwards."""
    return -p[0] * abs(v)


@njit(cache=True)
def growing(x, v, t, w, p):
    """- p0 t v."""
    return -p[0] * t * v


@njit(cache=True)
def spring(x, v, t, w, p):
    """- p0 x."""
    return -p[0] * x


@njit(cache=True)
def by_position(x, v, t, w, p):
    """Powers of the position."""
    return x * (p[0] + x * (p[1] + x * p[2]))


@dataclass(frozen=True)
class Scale:
    """Sizes of a record: force (N, root mean square), speed (m/s, largest), stroke (m), duration (s), mass (kg, a first
    guess)."""

    force: float = 1.0
    speed: float = 1.0
    stroke: float = 1.0
    duration: float = 1.0
    mass: float = 1.0


def axis_library(scale: Scale | None = None) -> list[Candidate]:
    """Everything that can be named on an axis, in a record of these sizes."""
    s = scale or Scale()
    worth = WORTH * s.force

    def size(unit: str, per: float = 1.0, low: float = -math.inf) -> Spec:
        """A parameter that makes a force when multiplied by `per`."""
        least = worth / per
        return Spec(unit, 0.0, low, math.inf, FINE * least, least)

    return [
        Candidate(LOAD, {"mass": Spec("kg", s.mass, 1e-4 * s.mass, math.inf, 1e-3 * s.mass, WORTH * s.mass)}, MASS),
        Candidate("viscous_friction", {"coefficient": size("N s/m", s.speed, 0.0)}, term=terms.viscous),
        Candidate("viscous_asymmetry", {"coefficient": size("N s/m", s.speed)}, term=lopsided),
        Candidate(
            "dry_friction",
            {"coefficient": size("N", low=0.0), "asymmetry": size("N")},
            DRY,
            starts=((10.0 * worth, 0.0),),
        ),
        Candidate("quadratic_drag", {"coefficient": size("N s^2/m^2", s.speed**2, 0.0)}, term=terms.quadratic),
        Candidate("constant_force", {"force": size("N")}, term=terms.constant),
        Candidate("elastic_force", {"stiffness": size("N/m", s.stroke)}, term=spring),
        Candidate("friction_drift", {"rate": size("N/m", s.speed * s.duration)}, term=growing),
    ]


def axis_anonymous(scale: Scale) -> list[Candidate]:
    """What has no name, in a record of these sizes. Nothing of it may look at measured rates: in a free run there are
    none."""

    def one(name: str, term, sizes: list[float], depends_on: str) -> Candidate:
        steps = {f"p{i}": FINE * WORTH * scale.force / scale.mass / size for i, size in enumerate(sizes)}
        specs = {key: Spec("", 0.0, -math.inf, math.inf, step) for key, step in steps.items()}
        return Candidate(name, specs, term=term, named=False, depends_on=(depends_on,))

    v, x = scale.speed, scale.stroke
    return [
        one("powers of the speed", cubic, [v**3, v**2], "speed"),
        one("powers of the position", by_position, [x, x**2, x**3], "position"),
    ]
