"""All effects that can be named: those of the package, and those that users and other packages add."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from mazeplan.errors import InputError
from mazeplan.physics import ball, openings, rig
from mazeplan.physics.effect import BALL, Effect, Parameter, Term
from mazeplan.plugins import EFFECTS as GROUP
from mazeplan.plugins import plugins
from mazeplan.usermodule import reason, user_module

PACKAGED: dict[str, Effect] = {e.name: e for e in (*ball.FAMILY, *openings.FAMILY, *openings.WALLS, *rig.FAMILY)}
EFFECTS: dict[str, Effect] = dict(PACKAGED)
TRIED = ((0.3, 0.7, 1.0), (-2.5, -3.0, 20.0), (1.4, 0.0, 0.0))  # theta, theta_dot, t at which formulas are tried
TILT = (0.02, 0.1, -1.0, -0.03, -0.2, 2.0, 0.07, 0.006, *([0.01] * 7))  # inputs there


def make_term(name: str, values: Mapping[str, Any]) -> Term:
    """The effect of that name with values; of an installed package, too. Raises ValueError naming what is allowed."""
    if name not in EFFECTS:
        _look_into_packages(name)
    if name not in EFFECTS:
        own = "; an effect of your own needs --effects MODULE:FUNCTION"
        raise ValueError(f"got effect {name!r}, expected one of {', '.join(ring_effects())}{own}")
    return EFFECTS[name](**values)


def ring_effects() -> dict[str, Effect]:
    """Effects that can stand in a ring of a model file, by name."""
    return {name: e for name, e in EFFECTS.items() if e.acts in BALL and e.named}


def register(effects: Iterable[Effect]) -> None:
    """Add effects: models may hold them, diagnosis looks for them. One that is there already stays. Raises InputError
    for what is no effect, has the name of another, or whose formula gives no number."""
    for effect in effects:
        problem = problem_of(effect)
        if problem is not None:
            raise InputError(problem)
        EFFECTS[effect.name] = effect


def _look_into_packages(name: str) -> None:
    """Register the effect of that name where an installed package has it; what is broken is left out."""
    for plugin in plugins(GROUP):
        try:
            found = [e for e in offered(plugin.load()) if getattr(e, "name", "") == name and problem_of(e) is None]
        except Exception:  # whatever anybody's code does
            continue
        register(found)


def own_effects(spec: str | None) -> list[Effect]:
    """The effects on the ball that a module of a user offers, `MODULE:FUNCTION`, registered; of the working folder,
    too. Raises InputError for anything else."""
    found = [] if spec is None else brought(spec)
    names = set[str]()
    for effect in found:
        problem = problem_of(effect)
        if problem is None and effect.name in names:
            problem = f"got the name {effect.name!r} twice"
        if problem is not None:
            raise InputError(f"--effects: {problem}")
        names.add(effect.name)
    register(found)
    return found


def brought(spec: str) -> list[Any]:
    """What a module of a user offers, `MODULE:FUNCTION`, as it is. Raises InputError where nothing comes of it."""
    module, _, name = spec.partition(":")
    if not module or not name:
        raise InputError(f"--effects: got {spec!r}, expected MODULE:FUNCTION")
    code = user_module(module, "--effects")
    try:
        return offered(getattr(code, name))
    except InputError as problem:
        raise InputError(f"--effects: {spec!r} {problem.problem}") from None
    except Exception as problem:  # whatever anybody's code does
        raise InputError(f"--effects: {spec!r} gives no effects: {reason(problem)}") from None


def offered(found: Any) -> list[Any]:
    """What a module offers: one effect, several, or a function that returns them. Raises InputError."""
    found = found if isinstance(found, Effect) or not callable(found) else found()
    if isinstance(found, Effect):
        return [found]
    if not isinstance(found, Iterable):
        raise InputError(f"gives no effects: got {found!r}, expected an Effect, several, or a function")
    return list(found)


def problem_of(effect: Any) -> str | None:
    """Why something is no effect that could be added; None where it is one."""
    if not isinstance(effect, Effect) or effect.acts not in BALL or effect.formula is None:
        what = effect.name if isinstance(effect, Effect) else repr(effect)
        return f"got {what}, expected an Effect with a formula that acts on the ball: {', '.join(BALL)}"
    if effect.name in PACKAGED:
        return f"got the name {effect.name!r}, which the library has; expected another"
    if not effect.name.isidentifier():
        return f"got the name {effect.name!r}, expected letters, digits and underscores"
    if not (
        isinstance(effect.parameters, Mapping) and all(isinstance(p, Parameter) for p in effect.parameters.values())
    ):
        return f"got parameters {effect.parameters!r} of {effect.name}, expected a dictionary of Parameter"
    if not effect.parameters:
        return f"got no parameters of {effect.name}, expected at least one"
    for name, p in effect.parameters.items():
        if not (p.low <= p.default <= p.high and p.low < p.high and p.step > 0.0):
            return f"{effect.name}.{name}: got {p.low:g} to {p.high:g}, default {p.default:g}, step {p.step:g}"
    return _trial(effect)


def _trial(effect: Effect) -> str | None:
    """What goes wrong with a formula where balls are."""
    import numpy as np

    from mazeplan.physics.compiled import term_functions

    try:
        functions = term_functions(effect).vectorised(np)
    except Exception as problem:  # whatever anybody's code does
        return f"the formula of {effect.name} cannot be compiled: {reason(problem)}"
    if effect.acts == "gravity":
        return None
    name = next(n for n in ("term", "hold", "loss") if n in functions)
    for theta, rate, t in TRIED:
        for off in (0.0, 1.0):
            p = [q.default + off * q.step for q in effect.parameters.values()]
            try:
                value = functions[name](theta, rate, t, TILT, p)
                finite = math.isfinite(value)
            except Exception as problem:  # whatever anybody's code does
                value, finite = reason(problem), False
            if not finite:
                at = f"theta {theta}, theta_dot {rate}, t {t}, parameters {p}"
                return f"the formula of {effect.name} gives {value} at {at}; expected a finite number"
    return None


def document(effect: Effect) -> dict[str, Any]:
    """An effect as `effect list --json` has it."""
    from mazeplan.physics.equation import text

    return {
        "name": effect.name,
        "acts_on": "ball" if effect.acts in BALL else effect.acts,
        "formula": text(effect) or ", ".join(effect.entry.values()),
        "parameters": {
            name: {"unit": p.unit, "default": p.default, "low": p.low, "high": p.high, "smallest": p.smallest or None}
            for name, p in effect.parameters.items()
        },
        "planned": effect.planned,
        "why_not": effect.why_not or None,
    }
