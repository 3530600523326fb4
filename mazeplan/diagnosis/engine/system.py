"""A system to diagnose, described by a class of a user or of a benchmark.

| attribute        | what                                                                                              |
|------------------|---------------------------------------------------------------------------------------------------|
| position, unit   | column of the measured position, and its unit: rad or m                                           |
| positions, units | instead of these, for several coordinates: columns (empty cells allowed) and units                |
| motion(s, p)     | the known acceleration (one for each coordinate), by the symbols s.position (or s.NAME of the     |
|                  | column), s.velocity (or s.NAME_dot), s.t and the inputs, and by the parameters p of the motion    |
| parameters       | parameters of the motion, by name                                                                 |
| inputs           | columns that formulas may use; they change linearly between samples                               |
| held             | inputs that keep the value of a sample until the next sample                                      |
| effects          | effects that may be missing: names of the library, or your own; default: `coordinate.FAMILY`      |
| force, inertia   | an input, and a parameter of the motion: if both are given, effects are forces over the inertia   |
| name             | name of the motion among the effects; default: motion                                             |

The effects of `INPUT` (delay, lag and gain of all inputs) may always be missing in a system that has inputs.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mazeplan.core.errors import InputError, reason
from mazeplan.physics.effect import DRAG, DRY, FORCE, INPUT, Effect, Parameter
from mazeplan.physics.effects.coordinate import FAMILY, INPUTS
from mazeplan.physics.formulas.compiled import term_functions
from mazeplan.physics.formulas.symbols import Symbols
from mazeplan.physics.registry import EFFECTS

ACTS = (FORCE, DRAG, DRY)
UNITS = ("rad", "m")
TAKEN = ("theta", "theta_dot", "position", "velocity", "t", "speed", "direction")
# unit of a parameter of an acceleration, and its unit for a force in {0} and a position in {1}
STRENGTHS = {"1/s": "{0} s/{1}", "rad/s^2": "{0}", "1/rad": "{0} s^2/{1}^2", "1/s^2": "{0}/{1}"}


@dataclass(frozen=True)
class Term:
    """A part of an effect: its compiled function and the coordinate on which it acts; held: whether it is friction."""

    address: int
    coordinate: int
    held: bool
    code: Any = field(repr=False, compare=False)  # keeps the compiled function alive

    def values(self, *state: Any) -> Any:
        """Values for arrays: position, speed, time, inputs, parameters."""
        return self.code.vectorised(np)["hold" if self.held else "term"](*state)


@dataclass(frozen=True)
class System:
    """The attributes of the table above. The motion is an effect, too.

    effects: those that may be missing; terms: compiled parts of each effect, by name
    on: coordinate of each effect that acts on one of several coordinates"""

    positions: tuple[str, ...]
    units: tuple[str, ...]
    motion: Effect
    inputs: tuple[str, ...]
    held: tuple[str, ...]
    effects: tuple[Effect, ...]
    inertia: str
    terms: dict[str, tuple[Term, ...]] = field(default_factory=dict, repr=False, compare=False)
    on: dict[str, str] = field(default_factory=dict, repr=False, compare=False)

    @property
    def library(self) -> list[Effect]:
        """All effects that the diagnosis can name, the motion first."""
        return [self.motion, *self.effects]


def system_of(described: Any, more: Sequence[Effect] = ()) -> System:
    """The system that a class describes. Raises InputError with what is wrong and what is allowed.

    more: further effects that may be missing"""
    positions, units = _coordinates(described)
    if not callable(getattr(described, "motion", None)):
        raise InputError("got no motion(s, p), expected the known acceleration as a function")
    inputs, held = _names(described, "inputs"), _names(described, "held")
    force, inertia = getattr(described, "force", ""), getattr(described, "inertia", "")
    parameters, effects = getattr(described, "parameters", {}), getattr(described, "effects", FAMILY)
    if not isinstance(parameters, Mapping):
        raise InputError(f"parameters: got {parameters!r}, expected a dictionary of Parameter by name")
    name = getattr(described, "name", "motion")
    motion = Effect(name, parameters, FORCE, described.motion, text="the motion that is known")
    chosen = [("held", one, inputs) for one in held]
    if force or inertia:
        chosen += [("force", force, inputs), ("inertia", inertia, tuple(parameters))]
    for key, one, allowed in chosen:
        if one not in allowed:
            raise InputError(f"{key}: got {one!r}, expected one of {', '.join(allowed) or 'none'}")
    plain = System(positions, units, motion, inputs, held, (), inertia)
    return _compiled(plain, [*_effects(effects, plain), *_effects(more, plain)])


def _coordinates(described: Any) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Columns and units of the coordinates."""
    names = getattr(described, "positions", getattr(described, "position", ""))
    names = (names,) if isinstance(names, str) else tuple(names)
    units = getattr(described, "units", getattr(described, "unit", ""))
    units = (units,) * len(names) if isinstance(units, str) else tuple(units)
    if not names or not all(isinstance(name, str) and name.isidentifier() for name in names):
        raise InputError(f"position: got {names!r}, expected the name of a column (positions: several)")
    if len(set(names)) < len(names) or len(units) != len(names):
        raise InputError(f"positions: got {len(set(names))} names and {len(units)} units, expected one unit for each")
    for name, unit in zip(names, units, strict=True):
        if unit not in UNITS:
            raise InputError(f"unit: got {unit!r}, expected rad or m: convert the column {name} first")
    return names, units


def _names(described: Any, key: str) -> tuple[str, ...]:
    """Names of inputs. A single name may stand without brackets."""
    found = getattr(described, key, ())
    found = tuple(found) if isinstance(found, list | tuple) else (found,)
    for name in found:
        if not (isinstance(name, str) and name.isidentifier()) or name in TAKEN:
            raise InputError(f"{key}: got {name!r}, expected names of columns but {', '.join(TAKEN)}")
    return found


def _effects(found: Any, system: System) -> list[tuple[Effect, int | None]]:
    """The effects that a class names or brings, each with its coordinate (None: a formula for all coordinates)."""
    known = {name: e for name, e in EFFECTS.items() if e.acts in ACTS} | {e.name: e for e in (*FAMILY, *INPUTS)}
    out: list[tuple[Effect, int | None]] = []
    for one in found if isinstance(found, list | tuple) else [found]:
        effect = known.get(one) if isinstance(one, str) else one
        if not isinstance(effect, Effect):
            raise InputError(f"effects: got {one!r}, expected an Effect or one of {', '.join(known)}")
        if effect is not known.get(effect.name) or effect.acts == INPUT:
            out.append((effect, None))
        else:
            out += [(_in_units(effect, system, i), i) for i in range(len(system.positions))]
    return out


def _in_units(effect: Effect, system: System, coordinate: int) -> Effect:
    """An effect of the library in the units of a coordinate.

    It loses its smallest sizes and its bounds, except a lower bound of 0, because they belong to a ball."""
    length = system.units[coordinate]
    strength = {"m": "N"}.get(length, "N m") if system.inertia else f"{length}/s^2"

    def one(p: Parameter) -> Parameter:
        unit = re.sub(r"\brad\b", length, p.unit)
        if p.unit not in STRENGTHS:
            return replace(p, unit=unit)
        unit = STRENGTHS[p.unit].format(strength, length) if system.inertia else unit
        return Parameter(unit, p.default, 0.0 if p.low == 0.0 else -math.inf, math.inf)

    parameters = {name: one(p) for name, p in effect.parameters.items()}
    return replace(effect, parameters=parameters, starts=effect.starts if effect.places else ())


def _compiled(system: System, candidates: Sequence[tuple[Effect, int | None]]) -> System:
    """The system with its candidates and their compiled terms. Raises InputError for what cannot be used.

    Dry friction has no asymmetry where a constant force is a candidate: while it moves, both are the same."""
    given = {effect.name for effect, _ in candidates}
    steady = any(name.startswith("constant_") for name in given)
    further = [(e, None) for e in INPUTS if system.inputs and e.name not in given]
    terms, on, effects = dict[str, tuple[Term, ...]](), dict[str, str](), list[Effect]()
    for effect, coordinate in [(system.motion, None), *candidates, *further]:
        one = effect
        if coordinate is not None and len(system.positions) > 1:
            column = system.positions[coordinate]
            one = replace(one, name=f"{effect.name}_{column}")
            on[one.name] = column
        if effect.name == "dry_friction" and coordinate is not None and steady:
            fixed = replace(one.parameters["asymmetry"], fixed=True)
            one = replace(one, parameters={**one.parameters, "asymmetry": fixed})
        _check(one, set(terms), effect is system.motion)
        terms[one.name] = () if one.acts == INPUT else _terms(one, system, coordinate)
        effects.append(one)
    return replace(system, motion=effects[0], effects=tuple(effects[1:]), terms=terms, on=on)


def _terms(effect: Effect, system: System, coordinate: int | None) -> tuple[Term, ...]:
    """The compiled terms of an effect. A formula for all coordinates gives one acceleration for each."""
    inputs, held = system.inputs, effect.acts == DRY
    if len(system.positions) > 1:
        inputs = (*inputs, *(part for name in system.positions for part in (f"{name}_at", f"{name}_at_dot")))
    out = []
    for i in range(len(system.positions)) if coordinate is None else [coordinate]:
        try:
            own = effect.formula if coordinate is not None else _formula(effect.formula, system, i)
            code = term_functions(replace(effect, formula=own), inputs)
        except Exception as problem:  # a user's formula may raise anything
            why = str(problem) if isinstance(problem, ValueError) else reason(problem)
            known = ", ".join(effect.parameters) or "none"
            raise InputError(
                f"the formula of {effect.name} cannot be used: {why}; expected a static method of state and parameters "
                "that returns a number, by sin, cos, sqrt, size, sign of mazeplan.physics, without if; "
                f"parameters: {known}"
            ) from None
        out.append(Term(code.address["hold" if held else "term"], i, held, code))
    return tuple(out)


def _formula(formula: Any, system: System, coordinate: int) -> Callable[[Any, Any], Any]:
    """The formula with the names of the coordinates as symbols; of several accelerations, that of one coordinate."""
    names, alone = system.positions, len(system.positions) == 1

    def named(s: Any) -> Any:
        own = {"t": s.t}
        for name in names:
            place, rate = (s.theta, s.theta_dot) if alone else (getattr(s, f"{name}_at"), getattr(s, f"{name}_at_dot"))
            own |= {name: place, f"{name}_dot": rate}
        if alone:
            own |= {key: getattr(s, key) for key in TAKEN}
        return Symbols(**own)

    def one(s: Any, p: Any) -> Any:
        found = formula(named(s), p)
        several = isinstance(found, tuple | list)
        if alone:
            return found[0] if several else found
        if not several or len(found) != len(names):
            raise ValueError(f"got {found!r}, expected {len(names)} accelerations, one for each coordinate")
        return found[coordinate]

    return one


def _check(effect: Effect, names: set[str], motion: bool) -> None:
    """Raises InputError for an effect that cannot be used here."""
    if effect.acts != INPUT and (effect.acts not in ACTS or not callable(effect.formula)):
        raise InputError(f"{effect.name}: got an effect on {effect.acts}, expected a formula of {', '.join(ACTS)}")
    if effect.name in names or not str(effect.name).isidentifier():
        raise InputError(f"got the effect {effect.name!r}, expected names of letters, each of them once")
    if not isinstance(effect.parameters, Mapping) or not (effect.parameters or motion):
        raise InputError(f"{effect.name}: got parameters {effect.parameters!r}, expected a dictionary of Parameter")
    for key, p in effect.parameters.items():
        if not isinstance(p, Parameter):
            raise InputError(f"{effect.name}.{key}: got {p!r}, expected Parameter(unit, value, lowest, highest)")
        if not (math.isfinite(p.default) and p.low <= p.default <= p.high and p.low < p.high and p.step > 0.0):
            raise InputError(f"{effect.name}.{key}: got value {p.default:g}, expected {p.low:g} to {p.high:g}")
