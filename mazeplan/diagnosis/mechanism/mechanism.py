"""A system with one degree of freedom, described by a class of a user or of a benchmark.

| attribute       | what                                                                                               |
|-----------------|----------------------------------------------------------------------------------------------------|
| position, unit  | column of the measured position, and its unit: rad or m                                            |
| motion(s, p)    | the known acceleration, by the symbols s.position (s.theta), s.velocity (s.theta_dot), s.t and the |
|                 | inputs, and by the parameters p of the motion                                                      |
| parameters      | parameters of the motion, by name                                                                  |
| inputs          | columns that formulas may use; they change linearly between samples                                |
| held            | inputs that keep the value of a sample until the next sample                                       |
| effects         | effects that may be missing: names of the library, or your own; default: `coordinate.FAMILY`       |
| force, inertia  | an input, and a parameter of the motion: if both are given, effects are forces over the inertia    |
| name            | name of the motion among the effects; default: motion                                              |
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from mazeplan.core.errors import InputError
from mazeplan.core.user_modules import reason
from mazeplan.physics.effect import DRAG, DRY, FORCE, Effect, Parameter
from mazeplan.physics.effects.coordinate import FAMILY
from mazeplan.physics.formulas.compiled import term_functions
from mazeplan.physics.registry import EFFECTS

ACTS = (FORCE, DRAG, DRY)
UNITS = ("rad", "m")
NEEDED = ("position", "unit", "motion")
TAKEN = ("theta", "theta_dot", "position", "velocity", "t", "speed", "direction")
# unit of a parameter of an acceleration, and its unit for a force in {0} and a position in {1}
STRENGTHS = {"1/s": "{0} s/{1}", "rad/s^2": "{0}", "1/rad": "{0} s^2/{1}^2", "1/s^2": "{0}/{1}"}


@dataclass(frozen=True)
class Mechanism:
    """The attributes of the table above. The motion is an effect, too. effects: those that may be missing"""

    position: str
    unit: str
    motion: Effect
    inputs: tuple[str, ...]
    held: tuple[str, ...]
    effects: tuple[Effect, ...]
    force: str
    inertia: str

    @property
    def library(self) -> list[Effect]:
        """All effects that the diagnosis can name, the motion first."""
        return [self.motion, *self.effects]

    @property
    def scored(self) -> str:
        """The quantity in which models are compared: force or acceleration."""
        return "force" if self.inertia else "acceleration"

    @property
    def strength(self) -> str:
        """The unit of the compared quantity."""
        return {"m": "N"}.get(self.unit, "N m") if self.inertia else f"{self.unit}/s^2"

    @property
    def shown(self) -> tuple[float, str]:
        """Factor and unit with which messages show differences of positions."""
        return (1e3, "mm") if self.unit == "m" else (1.0, self.unit)


def mechanism_of(described: Any, more: Sequence[Effect] = ()) -> Mechanism:
    """The mechanism that a class describes. Raises InputError with what is wrong and what is allowed.

    more: further effects that may be missing"""
    for key in NEEDED:
        if not hasattr(described, key):
            raise InputError(f"got no {key}, expected {', '.join(NEEDED[:-1])} and {NEEDED[-1]}(s, p)")
    for key in NEEDED[:-1]:
        if not (isinstance(getattr(described, key), str) and getattr(described, key)):
            raise InputError(f"{key}: got {getattr(described, key)!r}, expected a name")
    if described.unit not in UNITS:
        raise InputError(
            f"unit: got {described.unit!r}, expected rad or m: convert the column {described.position} first"
        )
    inputs, held = _names(described, "inputs"), _names(described, "held")
    force, inertia = getattr(described, "force", ""), getattr(described, "inertia", "")
    parameters, effects = getattr(described, "parameters", {}), getattr(described, "effects", FAMILY)
    if not isinstance(parameters, Mapping):
        raise InputError(f"parameters: got {parameters!r}, expected a dictionary of Parameter by name")
    motion = Effect(
        getattr(described, "name", "motion"), parameters, FORCE, described.motion, text="the motion that is known"
    )
    for key, found, allowed in (
        ("held", held, inputs),
        *(((("force", [force], inputs)), ("inertia", [inertia], tuple(parameters))) if force or inertia else ()),
    ):
        for name in found:
            if name not in allowed:
                raise InputError(f"{key}: got {name!r}, expected one of {', '.join(allowed) or 'none'}")
    plain = Mechanism(described.position, described.unit, motion, inputs, held, (), force, inertia)
    whole = replace(plain, effects=(*_effects(effects, plain), *_effects(more, plain)))
    names = set[str]()
    for effect in whole.library:
        _check(effect, inputs, names)
        names.add(effect.name)
        if not effect.parameters and effect is not motion:
            raise InputError(f"{effect.name}: got no parameters, expected at least one")
    return whole


def _names(described: Any, key: str) -> tuple[str, ...]:
    """Names of inputs. A single name may stand without brackets."""
    found = getattr(described, key, ())
    found = (found,) if isinstance(found, str) else found
    for name in found if isinstance(found, Sequence) else [found]:
        if not (isinstance(name, str) and name.isidentifier()) or name in TAKEN:
            raise InputError(f"{key}: got {name!r}, expected names of columns but {', '.join(TAKEN)}")
    return tuple(found)


def _effects(found: Any, mechanism: Mechanism) -> list[Effect]:
    """The effects that a class names or brings."""
    known = {name: e for name, e in EFFECTS.items() if e.acts in ACTS} | {e.name: e for e in FAMILY}
    out = []
    for one in found if isinstance(found, Sequence) and not isinstance(found, str) else [found]:
        effect = known.get(one) if isinstance(one, str) else one
        if not isinstance(effect, Effect):
            raise InputError(f"effects: got {one!r}, expected an Effect or one of {', '.join(known)}")
        out.append(in_units(effect, mechanism) if effect is known.get(effect.name) else effect)
    return out


def in_units(effect: Effect, mechanism: Mechanism) -> Effect:
    """An effect of the library in the units of a mechanism.

    It loses its smallest sizes and its bounds, except a lower bound of 0, because they belong to a ball."""
    length = mechanism.unit

    def one(p: Parameter) -> Parameter:
        unit = re.sub(r"\brad\b", length, p.unit)
        if p.unit not in STRENGTHS:
            return replace(p, unit=unit)
        unit = STRENGTHS[p.unit].format(mechanism.strength, length) if mechanism.inertia else unit
        return Parameter(unit, p.default, 0.0 if p.low == 0.0 else -math.inf, math.inf)

    parameters = {name: one(p) for name, p in effect.parameters.items()}
    return replace(effect, parameters=parameters, starts=effect.starts if effect.places else ())


def _check(effect: Effect, inputs: tuple[str, ...], names: set[str]) -> None:
    """Raises InputError for an effect that cannot be used here."""
    if effect.acts not in ACTS or not callable(effect.formula):
        raise InputError(f"{effect.name}: got an effect on {effect.acts}, expected a formula of {', '.join(ACTS)}")
    if effect.name in names or not str(effect.name).isidentifier():
        raise InputError(f"got the effect {effect.name!r}, expected names of letters, each of them once")
    if not isinstance(effect.parameters, Mapping):
        raise InputError(f"{effect.name}: got parameters {effect.parameters!r}, expected a dictionary of Parameter")
    for key, p in effect.parameters.items():
        if not isinstance(p, Parameter):
            raise InputError(f"{effect.name}.{key}: got {p!r}, expected Parameter(unit, value, lowest, highest)")
        if not (math.isfinite(p.default) and p.low <= p.default <= p.high and p.low < p.high and p.step > 0.0):
            raise InputError(f"{effect.name}.{key}: got value {p.default:g}, expected {p.low:g} to {p.high:g}")
    try:
        term_functions(effect, inputs)
    except Exception as problem:  # a user's formula may raise anything
        why = str(problem) if isinstance(problem, ValueError) else reason(problem)
        raise InputError(f"the formula of {effect.name} cannot be used: {why}") from None
