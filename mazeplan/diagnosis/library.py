"""The effects that a diagnosis can name on a ring: parameters with units, bounds, starts, smallest sizes.

A candidate is a few lines: a compiled term of the acceleration (`terms`), or where else it acts. To add one, append a
`Candidate` with a term of your own (`numba.njit`, arguments x, v, t, w, p) to what `ring_library` returns.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from mazeplan.diagnosis import terms, wallterms

TERM, RING, DRY, GATE, DELAY, STAGE = "term", "ring", "dry", "gate", "delay", "stage"
WALL, CAMERA = "wall", "camera"
CALIBRATED = 0.1  # by how much the scale of a tilt sensor is off, one standard deviation: it was held against a level
BEHIND = 0.02  # rad that the far edge of an opening, which a ball passes through, is at least behind its middle
ALIKE = 0.1  # by how much the losses of openings differ that were made in one way, one standard deviation
FINE = 0.25  # rad/s^2; as large are ripples of high harmonics at a guess, one standard deviation
GATES = 8  # directions in which gates of a wall are looked for, between one and the next


@dataclass(frozen=True)
class Spec:
    """A parameter: unit, value without the effect, bounds, step of numeric derivatives, smallest size worth a word,
    standard deviation of what is known of it beforehand (inf: nothing)."""

    unit: str
    default: float
    low: float
    high: float
    step: float
    smallest: float = 0.0
    prior: float = math.inf


@dataclass(frozen=True)
class Candidate:
    """An effect that may be missing. acts: term (its compiled function is `term`), ring (parameters of the ring's own
    equation), dry, wall, gate, delay, camera; starts: where fits begin, each a tuple of values; named: False for what
    only says that something is there; depends_on: variables, for those; places: parameters that say where, not how
    large; placebo: it cannot be there, and is tried to see what chance does; pattern: of gates that have angle and loss
    in common, what is added to the angle, rad; side: of the wall they are in, 1 outer, -1 inner, 0 not known;
    own: of a gate each, a parameter that its loss has beyond what all have in common; rivals: names of others that say
    the same in another way."""

    name: str
    parameters: dict[str, Spec]
    acts: str = TERM
    term: Any = None
    starts: tuple[tuple[float, ...], ...] = ()
    named: bool = True
    depends_on: tuple[str, ...] = ()
    places: tuple[str, ...] = ()
    placebo: bool = False
    pattern: tuple[float, ...] = (0.0,)
    side: float = 0.0
    own: tuple[str, ...] = ()
    rivals: tuple[str, ...] = ()

    def numbers(self, values: dict[str, float]) -> list[float]:
        """Its parameters in order, those that are not among the values as they are without it."""
        return [values.get(name, spec.default) for name, spec in self.parameters.items()]

    def of_gate(self, values: dict[str, float], i: int) -> list[float]:
        """Parameters of gate i of the pattern, as many as the values have: angle, loss, and what follows them."""
        numbers = [values[name] for name in self.parameters if name in values and name not in self.own]
        if self.own:
            numbers[1] += values.get(self.own[i], 0.0)
        return numbers

    def first(self) -> list[tuple[float, ...]]:
        """Starts of a fit; the defaults where none are given."""
        return list(self.starts) or [tuple(spec.default for spec in self.parameters.values())]

    def size(self, values: dict[str, float], declared: dict[str, float]) -> float:
        """Largest deviation from what was declared, in smallest sizes; 1 or more is worth a word."""
        sizes = [
            abs(values[name] - declared.get(name, spec.default)) / spec.smallest
            for name, spec in self.parameters.items()
            if spec.smallest > 0.0
        ]
        return max(sizes, default=math.inf)


def stage_errors(directions: Iterable[str]) -> Candidate:
    """What the tilt sensor leaves open of the stage, in standard errors along independent directions. Fitted along
    where values and intervals are reported; never a finding."""
    return Candidate("stage", {n: Spec("1", 0.0, -10.0, 10.0, 0.1, prior=1.0) for n in directions}, STAGE, named=False)


def _angles(count: int) -> list[float]:
    return [-math.pi + 2.0 * math.pi * (i + 0.5) / count for i in range(count)]


@dataclass(frozen=True)
class Gates:
    """Angles (rad) of the gates in the outer and the inner wall of a ring, by the map."""

    outer: tuple[float, ...] = ()
    inner: tuple[float, ...] = ()


def wall_library(gates: Gates) -> list[Candidate]:
    """What the gates of a ring's walls do: how far the map is turned against the camera, and the share of the speed
    lost in passing a gate while lying against its wall; above 1 the ball is thrown back."""
    found = []
    for name, angles, side in (("outer_gates", gates.outer, 1.0), ("inner_gates", gates.inner, -1.0)):
        if angles:
            specs = {
                "rotation": Spec("rad", 0.0, -2 * math.pi, 2 * math.pi, 0.03),
                "loss": Spec("1", 0.0, 0.0, 1.8, 1e-3, 0.03),
            }
            period = _period(angles)
            count = max(GATES, round(period / math.radians(5.0)))
            starts = tuple((period * ((i + 0.5) / count - 0.5), 0.3) for i in range(count))
            found.append(
                Candidate(
                    name, specs, GATE, starts=starts, places=("rotation",), pattern=tuple(angles), side=side,
                    rivals=(name.replace("gates", "edges"),),
                )
            )  # fmt: skip
    return found


def closer_library(gates: Gates) -> list[Candidate]:
    """The gates of a ring's walls, looked at more closely. As `wall_library`, with how sharply a ball changes sides:
    by 0.1 m/s^2 where the tilt is known to 0.5 degrees, but nobody knows how well it is. And in other words, which must
    not gain by that: a ball sinks into an opening and meets its far edge, at some reach behind its middle, and the
    deeper it sank, the more it loses; loss: of a ball that sank in by its radius."""
    found = []
    for plain in wall_library(gates):
        width = {"width": Spec("m/s^2", wallterms.WIDTH, 2e-3, 1.0, 0.01)}
        found.append(replace(plain, parameters={**plain.parameters, **width}, places=("rotation", "width")))
        specs = {
            **plain.parameters,
            "reach": Spec("rad", BEHIND, BEHIND, 0.3, 0.03),
            "sinking": Spec("1", 0.0, 0.0, 1.0, 1e-2),  # one that sinks in further by its turning alone leaves the ring
        }
        starts = tuple((rotation, 0.5, 0.05, 0.6) for rotation, _ in plain.starts)
        name, places = plain.name.replace("gates", "edges"), ("rotation", "reach", "sinking")
        found.append(replace(plain, name=name, parameters=specs, starts=starts, places=places, rivals=(plain.name,)))
    return found


def finer_library(gates: Gates) -> list[Candidate]:
    """The same effects in more numbers than one can read, each held near nought by what is known beforehand: the loss
    of each opening of a wall, which were made alike; and the ripples of the floor up to harmonic 17."""
    found = []
    for plain in closer_library(gates):
        if plain.name.endswith("edges"):
            own = tuple(f"loss{i + 1}" for i in range(len(plain.pattern)))
            beyond = dict.fromkeys(own, Spec("1", 0.0, -1.0, 1.0, 1e-3, prior=ALIKE))
            found.append(replace(plain, parameters={**plain.parameters, **beyond}, own=own))
    first, known = wallterms.FIRST_RIPPLE, wallterms.FIRST_RIPPLE + wallterms.RIPPLES
    (ripple,) = (c for c in ring_library() if c.name == "surface_ripple")
    further = {
        f"{kind}{n}": Spec("rad/s^2", 0.0, -20.0, 20.0, 1e-3, 0.06, FINE)
        for n in range(known, first + wallterms.FINE_RIPPLES)
        for kind in ("cos", "sin")
    }
    return [*found, replace(ripple, parameters={**ripple.parameters, **further}, term=wallterms.fine_ripples)]


def _period(angles: Sequence[float]) -> float:
    """By how much (rad) gates must be turned to look the same."""
    turn = 2.0 * math.pi
    for parts in range(len(angles), 1, -1):
        moved = [(a + turn / parts - b) % turn for a in angles for b in angles]
        if sum(min(d, turn - d) < math.radians(1.0) for d in moved) == len(angles):
            return turn / parts
    return turn


def ring_library() -> list[Candidate]:
    """Everything that can be named on a ring of which no map is known."""
    rad = math.radians
    return [
        Candidate("rolling_inertia", {"factor": Spec("1", 1.0, 0.05, 1.5, 1e-4, 0.007)}, RING),
        Candidate("viscous_friction", {"coefficient": Spec("1/s", 0.0, 0.0, 20.0, 1e-4, 0.02)}, term=terms.viscous),
        Candidate(
            "dry_friction",
            {
                "coefficient": Spec("rad/s^2", 0.0, 0.0, 20.0, 1e-3, 0.035),
                "asymmetry": Spec("rad/s^2", 0.0, -10.0, 10.0, 1e-3, 0.035),
            },
            DRY,
            starts=((0.1, 0.0),),
        ),
        Candidate("wall_friction", {"coefficient": Spec("1", 0.0, 0.0, 2.0, 1e-4, 0.01)}, WALL, starts=((0.02,),)),
        Candidate("quadratic_drag", {"coefficient": Spec("1/rad", 0.0, 0.0, 5.0, 1e-4, 0.01)}, term=terms.quadratic),
        Candidate(
            "tilt_offset",
            {
                "beta": Spec("rad", 0.0, -0.2, 0.2, 1e-5, 0.0004),
                "gamma": Spec("rad", 0.0, -0.2, 0.2, 1e-5, 0.0004),
            },
            RING,
        ),
        Candidate(
            "constant_torque", {"acceleration": Spec("rad/s^2", 0.0, -10.0, 10.0, 1e-4, 0.03)}, term=terms.constant
        ),
        Candidate(
            "surface_profile",
            {f"{kind}{n}": Spec("rad/s^2", 0.0, -20.0, 20.0, 1e-3, 0.06) for n in (1, 2, 3) for kind in ("cos", "sin")},
            term=terms.harmonics,
        ),
        Candidate(
            "surface_ripple",
            {
                f"{kind}{n}": Spec("rad/s^2", 0.0, -20.0, 20.0, 1e-3, 0.06)
                for n in range(wallterms.FIRST_RIPPLE, wallterms.FIRST_RIPPLE + wallterms.RIPPLES)
                for kind in ("cos", "sin")
            },
            term=wallterms.ripples,
        ),
        Candidate(
            "surface_bump",
            {
                "centre": Spec("rad", 0.0, -2 * math.pi, 2 * math.pi, 1e-3),
                "width": Spec("rad", 0.2, rad(2), 1.5, 1e-3),
                "height": Spec("rad/s^2", 0.0, -50.0, 50.0, 1e-3, 0.075),
            },
            term=terms.bump,
            starts=tuple((angle, 0.25, 0.1) for angle in _angles(24)),
            places=("centre", "width"),
        ),
        Candidate(
            "gate_loss",
            {"angle": Spec("rad", 0.0, -2 * math.pi, 2 * math.pi, 0.03), "loss": Spec("1", 0.0, 0.0, 0.9, 1e-3, 0.02)},
            GATE,
            starts=tuple((angle, 0.1) for angle in _angles(24)),
            places=("angle",),
        ),
        Candidate(
            "friction_drift",
            {
                "rate": Spec("1/s^2", 0.0, -0.1, 0.1, 1e-6, 0.00025),
                "start": Spec("1/s", 0.0, -20.0, 20.0, 1e-4),
            },
            term=terms.drift,
            places=("start",),
        ),
        Candidate(
            "tilt_gain",
            {axis: Spec("1", 1.0, 0.3, 3.0, 1e-4, 0.012, CALIBRATED) for axis in ("beta", "gamma")},
            RING,
        ),
        Candidate("axis_misalignment", {"angle": Spec("rad", 0.0, -0.8, 0.8, 1e-4, 0.005)}, RING),
        Candidate(
            "camera_offset",
            {"x": Spec("m", 0.0, -0.02, 0.02, 1e-5, 4e-4), "y": Spec("m", 0.0, -0.02, 0.02, 1e-5, 4e-4)},
            CAMERA,
        ),
        Candidate("sensor_delay", {"delay": Spec("s", 0.0, -0.1, 0.3, 1e-4, 0.004)}, DELAY),
    ]
