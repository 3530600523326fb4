"""Definition of a physical effect; compiled code, file entries, candidates and documentation derive from it.

An effect has parameters and a formula. The formula is a function of the state's symbols (`symbols.Symbols`) and of the
parameters. Its result depends on where the effect acts:

gravity      any of {"factor", "beta", "gamma", "x", "y"}: a factor of gravity; tilt (rad) and horizontal acceleration
             (m/s^2) that are added to those of the plate
force        an acceleration along the ring, rad/s^2
drag         a rate, 1/s: the ball loses speed at rate times speed
dry          a deceleration against the motion, rad/s^2, that can hold a ball at rest
wall         as dry, for a ball that touches a wall
opening      {"angle", "loss"}: an angle, rad, and the share of its speed that a passing ball loses there
stage, tilt sensor, camera
             no formula: these effects are numbers in the model of that part of the rig, see `entry`
input        no formula: a delay, lag or gain of the inputs of a mechanism
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from mazeplan.core.errors import one_of

GRAVITY, FORCE, DRAG, DRY, WALL, OPENING = "gravity", "force", "drag", "dry", "wall", "opening"
STAGE, TILT_SENSOR, CAMERA, INPUT = "stage", "tilt sensor", "camera", "input"
BALL = (GRAVITY, FORCE, DRAG, DRY, WALL, OPENING)  # effects on the ball: entries of a ring in a model file
ACTS = (*BALL, STAGE, TILT_SENSOR, CAMERA, INPUT)
NO_JUMPS = "a plan does not follow a jump of the speed"
DEFAULT_STEP = 0.01  # default step of numeric derivatives, as a share of `Parameter.smallest`


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect.

    unit:      as text
    default:   the value without the effect
    low, high: bounds
    smallest:  smallest relevant size; 0 for a parameter that says where the effect is
    step:      step of numeric derivatives; 0 stands for DEFAULT_STEP times `smallest`, or 1e-3 if `smallest` is 0
    prior:     standard deviation of prior knowledge
    words:     name in reports
    fixed:     True excludes the parameter from fits
    """

    unit: str
    default: float
    low: float
    high: float
    smallest: float = 0.0
    step: float = 0.0
    prior: float = math.inf
    words: str = ""
    fixed: bool = False

    def __post_init__(self) -> None:
        if self.step == 0.0:
            object.__setattr__(self, "step", DEFAULT_STEP * self.smallest or 1e-3)

    @property
    def valid(self) -> bool:
        """Whether bounds, default and step fit together."""
        return self.low <= self.default <= self.high and self.low < self.high and self.step > 0.0


@dataclass(frozen=True, eq=False)
class Effect:
    """A physical effect. Two effects are equal only if they are the same object.

    name, parameters: see `Parameter`
    acts:       where the effect acts, such as "force"
    formula:    function of the state's symbols and of the parameters; None for a part of the rig
    text:       a description in one sentence
    source:     source of the formula
    why_not:    why the planner cannot use the effect; empty if it can. No plan uses an effect of openings
    entry:      place of each parameter in the model of a part of the rig, such as `stage.beta.gain`
    by_radius:  powers of the radius that scale each parameter to another ring; None if values hold for one place
    common:     whether the effect is the same in all rings

    Hints for fits and the diagnosis:

    starts:     start values of a fit
    places:     parameters that say where the effect is, not how large
    rivals:     effects with the same meaning
    named:      False for a term that only shows a dependence
    depends_on: the variables of such a term
    placebo:    True for an impossible term, which measures what chance can explain

    The openings of a wall as one effect, see `openings`:

    pattern:    angles of the openings in the map, rad
    side:       1 for the outer wall of the ring, -1 for the inner wall
    """

    name: str
    parameters: Mapping[str, Parameter]
    acts: str = FORCE
    formula: Callable[..., Any] | None = None
    text: str = ""
    source: str = ""
    why_not: str = ""
    entry: Mapping[str, str] = field(default_factory=dict)
    by_radius: Mapping[str, int] | None = None
    common: bool = False
    starts: tuple[tuple[float, ...], ...] = ()
    places: tuple[str, ...] = ()
    rivals: tuple[str, ...] = ()
    named: bool = True
    depends_on: tuple[str, ...] = ()
    placebo: bool = False
    pattern: tuple[float, ...] = (0.0,)
    side: float = 0.0

    def __post_init__(self) -> None:
        if self.acts == OPENING and not self.why_not:
            object.__setattr__(self, "why_not", NO_JUMPS)

    def __call__(self, *values: float, **more: float) -> Term:
        """The effect with values, in the order of its parameters or by name; missing ones keep their defaults.

        Raises ValueError for unknown names and for values out of bounds."""
        if len(values) > len(self.parameters):
            raise ValueError(f"got {len(values)} values of {self.name}, expected {len(self.parameters)} at most")
        given = dict(zip(self.parameters, values, strict=False)) | more
        for key, value in given.items():
            if key not in self.parameters:
                raise ValueError(f"got parameter {key!r} of {self.name}, expected {one_of(self.parameters, key)}")
            allowed = self.parameters[key]
            if not allowed.low <= value <= allowed.high:  # also refuses NaN
                raise ValueError(f"{key}: got {value}, expected {allowed.low} to {allowed.high} {allowed.unit}".strip())
        return Term(self, tuple(float(given.get(key, p.default)) for key, p in self.parameters.items()))

    @property
    def planned(self) -> bool:
        """Whether planner and prediction use the effect."""
        return not self.why_not

    def numbers(self, values: Mapping[str, float]) -> list[float]:
        """Values of the parameters in order; missing values are the defaults."""
        return [values.get(name, parameter.default) for name, parameter in self.parameters.items()]

    def first_guesses(self) -> list[tuple[float, ...]]:
        """Start values of a fit; the defaults if `starts` is empty."""
        return list(self.starts) or [tuple(p.default for p in self.parameters.values())]

    def size(self, values: Mapping[str, float], declared: Mapping[str, float]) -> float:
        """Largest deviation from the declared values, in units of `Parameter.smallest`; 1 or more is relevant."""
        sized = ((name, p) for name, p in self.parameters.items() if p.smallest > 0.0 and name in values)
        return max((abs(values[n] - declared.get(n, p.default)) / p.smallest for n, p in sized), default=math.inf)


@dataclass(frozen=True)
class Term:
    """An effect with values: one summand of a model. numbers: values in the order of the effect's parameters."""

    effect: Effect
    numbers: tuple[float, ...]

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.effect.name

    def values(self) -> dict[str, float]:
        """Parameters by name."""
        return dict(zip(self.effect.parameters, self.numbers, strict=True))

    @property
    def idle(self) -> bool:
        """Whether the term does nothing: all its parameters, except those that say where, have their defaults."""
        known = zip(self.effect.parameters.items(), self.numbers, strict=True)
        return all(name in self.effect.places or value == p.default for (name, p), value in known)

    def told_as(self) -> tuple[str, dict[str, float]]:
        """Name and values for a fingerprint, without the effect's code."""
        return "".join(part.capitalize() for part in self.name.split("_")), self.values()
