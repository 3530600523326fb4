"""Registry of effects: of the package, of users, and of installed packages."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from itertools import product
from typing import Any

from mazeplan.core.errors import InputError, reason
from mazeplan.core.user_modules import user_module
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


def register(effects: Iterable[Any]) -> list[Effect]:
    """Add effects for models and diagnosis. Returns them.

    Raises InputError for an object that is no effect on the ball with parameters, for a name that the library has or
    that comes twice, and for a formula without a finite value."""
    found: dict[str, Effect] = {}
    for effect in effects:
        if not isinstance(effect, Effect) or effect.acts not in BALL or effect.formula is None:
            what = effect.name if isinstance(effect, Effect) else repr(effect)
            raise InputError(f"got {what}, expected an Effect with a formula that acts on the ball: {', '.join(BALL)}")
        if effect.name in PACKAGED or effect.name in found or not effect.name.isidentifier():
            expected = "letters, digits and underscores, and no name of the library or of another effect"
            raise InputError(f"got the name {effect.name!r}, expected {expected}")
        parameters = effect.parameters.values() if isinstance(effect.parameters, Mapping) else ()
        if not parameters or not all(isinstance(p, Parameter) and p.valid for p in parameters):
            expected = "a dictionary of Parameter with low <= default <= high, low < high and step > 0"
            raise InputError(f"{effect.name}: got parameters {effect.parameters!r}, expected {expected}")
        _try_formula(effect)
        found[effect.name] = effect
    EFFECTS.update(found)
    return list(found.values())


def own_effects(spec: str | None) -> list[Effect]:
    """Register and return the effects of a user's module, `MODULE:FUNCTION`; none for None. Raises InputError."""
    try:
        return [] if spec is None else register(load_effects(spec))
    except InputError as problem:
        raise problem if problem.problem.startswith("--effects") else InputError(f"--effects: {problem}") from None


def load_effects(spec: str) -> list[Any]:
    """The objects, not yet checked, that a user's module `MODULE:FUNCTION` has: an effect, several, or a function that
    returns them. Raises InputError."""
    module, _, name = spec.partition(":")
    if not module or not name:
        raise InputError(f"--effects: got {spec!r}, expected MODULE:FUNCTION{', without .py' * spec.endswith('.py')}")
    code = user_module(module, "--effects")
    try:
        found = getattr(code, name)
        found = found() if callable(found) and not isinstance(found, Effect) else found
        return [found] if isinstance(found, Effect) else list(found)
    except Exception as problem:  # foreign code may raise anything
        raise InputError(f"--effects: {spec!r} gives no effects: {reason(problem)}") from None


def _try_formula(effect: Effect) -> None:
    """Raises InputError if the formula gives no finite number at typical states."""
    import numpy as np

    from mazeplan.physics.formulas.compiled import term_functions

    at = ""
    try:
        functions = term_functions(effect).vectorised(np)
        name = next(n for n in ("term", "hold", "loss") if n in functions)
        for (theta, rate, t), off in product(TRIED, (0.0, 1.0)):
            p = [q.default + off * q.step for q in effect.parameters.values()]
            at = f" at theta {theta}, theta_dot {rate}, t {t}, parameters {p}"
            if not math.isfinite(value := functions[name](theta, rate, t, TILT, p)):
                raise ValueError(f"got {value}, expected a finite number")
    except Exception as problem:  # foreign code may raise anything
        raise InputError(f"the formula of {effect.name}{at}: {reason(problem)}") from None


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
