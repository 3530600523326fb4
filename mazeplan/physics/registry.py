"""Registry of effects: of the package, of users, and of installed packages."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from mazeplan.core.errors import InputError
from mazeplan.core.user_modules import reason, user_module
from mazeplan.physics.effect import BALL, Effect, Parameter, Term
from mazeplan.physics.effects import ball, openings, rig

PACKAGED: dict[str, Effect] = {e.name: e for e in (*ball.FAMILY, *openings.FAMILY, *openings.WALLS, *rig.FAMILY)}
EFFECTS: dict[str, Effect] = dict(PACKAGED)
TRIED = ((0.3, 0.7, 1.0), (-2.5, -3.0, 20.0), (1.4, 0.0, 0.0))  # theta, theta_dot, t of the trial
TILT = (0.02, 0.1, -1.0, -0.03, -0.2, 2.0, 0.07, 0.006, *([0.01] * 7))  # inputs (`symbols.INPUTS`) of the trial


def make_term(name: str, values: Mapping[str, Any]) -> Term:
    """The effect `name` with values. Raises ValueError with the allowed names."""
    if name not in EFFECTS:
        own = "; an effect of your own needs --effects MODULE:FUNCTION"
        raise ValueError(f"got effect {name!r}, expected one of {', '.join(ring_effects())}{own}")
    return EFFECTS[name](**values)


def ring_effects() -> dict[str, Effect]:
    """Effects that a ring in a model file may have, by name."""
    return {name: e for name, e in EFFECTS.items() if e.acts in BALL and e.named}


def register(effects: Iterable[Effect]) -> None:
    """Add effects for models and diagnosis. Raises InputError for an object that is not an effect, for a name that the
    library has, and for a formula without a finite value."""
    for effect in effects:
        problem = problem_of(effect)
        if problem is not None:
            raise InputError(problem)
        EFFECTS[effect.name] = effect


def own_effects(spec: str | None) -> list[Effect]:
    """Register and return the effects of a user's module, `MODULE:FUNCTION`. Raises InputError."""
    found = [] if spec is None else load_effects(spec)
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


def load_effects(spec: str) -> list[Any]:
    """The objects, not yet checked, that a user's module `MODULE:FUNCTION` offers. Raises InputError."""
    module, _, name = spec.partition(":")
    if not module or not name:
        raise InputError(f"--effects: got {spec!r}, expected MODULE:FUNCTION{', without .py' * spec.endswith('.py')}")
    code = user_module(module, "--effects")
    try:
        return offered(getattr(code, name))
    except InputError as problem:
        raise InputError(f"--effects: {spec!r} {problem.problem}") from None
    except Exception as problem:  # foreign code may raise anything
        raise InputError(f"--effects: {spec!r} gives no effects: {reason(problem)}") from None


def offered(found: Any) -> list[Any]:
    """A list from one effect, from several, or from a function that returns one or several. Raises InputError."""
    found = found if isinstance(found, Effect) or not callable(found) else found()
    if isinstance(found, Effect):
        return [found]
    if not isinstance(found, Iterable):
        raise InputError(f"gives no effects: got {found!r}, expected an Effect, several, or a function")
    return list(found)


def problem_of(effect: Any) -> str | None:
    """Why an object cannot be registered as an effect; None if it can."""
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
    """What is wrong with a formula at typical states, or None."""
    import numpy as np

    from mazeplan.physics.formulas.compiled import term_functions

    try:
        functions = term_functions(effect).vectorised(np)
    except Exception as problem:  # foreign code may raise anything
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
            except Exception as problem:  # foreign code may raise anything
                value, finite = reason(problem), False
            if not finite:
                at = f"theta {theta}, theta_dot {rate}, t {t}, parameters {p}"
                return f"the formula of {effect.name} gives {value} at {at}; expected a finite number"
    return None


def document(effect: Effect) -> dict[str, Any]:
    """The JSON of an effect for `effect list --json`."""
    from mazeplan.physics.formulas.equation import text

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
