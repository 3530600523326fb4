"""Effects of the registry, including those of users, on the rigid-body ball.

Planner, filter and rigid body use the same formula of an effect, so each formula exists once. The rigid body itself
models rolling (`Ball.inertia`) and contacts with walls and openings (`Ball.wall`, `Ball.restitution`). Effects of these
kinds are therefore refused here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mazeplan.physics.dynamics.rigid_body import FELT_ROOM, Effects, no_effects
from mazeplan.physics.effect import DRAG, DRY, FORCE, GRAVITY, Effect, Term
from mazeplan.physics.effects.ball import rolling_inertia
from mazeplan.physics.formulas.arrays import packed
from mazeplan.physics.formulas.compiled import CompiledFunctions, plane_functions
from mazeplan.physics.formulas.symbols import RECORDED, state, symbols_of

OURS = "mazeplan."
BESIDES = (GRAVITY, FORCE, DRAG, DRY)


def effects_of(terms: Sequence[Term]) -> Effects:
    """The sum of some effects for `rigid_body`. Raises ValueError for an effect that the rigid body already models, and
    for a formula with inputs of a record."""
    for term in terms:
        _check(term.effect)
    terms = [term for term in terms if not idle(term)]
    if not terms:
        return no_effects()
    made = _functions(tuple(term.effect for term in terms))
    held, numbers = made.counts["held"], packed(terms)
    room = np.array([*numbers, *[0.0] * (held + FELT_ROOM)], dtype=np.float64)
    return Effects(
        made.address["plane_at"], made.address["moment"] if held else 0, held, room, bool(made.counts["angled"])
    )


def idle(term: Term) -> bool:
    """Whether a term does nothing: all its parameters, except those that say where, have their defaults."""
    known = zip(term.effect.parameters.items(), term.numbers, strict=True)
    return all(name in term.effect.places or value == p.default for (name, p), value in known)


_made: dict[tuple[int, ...], tuple[tuple[Effect, ...], CompiledFunctions]] = {}  # by identity; keeps both alive


def _functions(effects: tuple[Effect, ...]) -> CompiledFunctions:
    """Compiled `plane_at` and `moment` of these effects, cached for filters."""
    key = tuple(map(id, effects))
    if key not in _made:
        _made[key] = effects, plane_functions(effects)
    return _made[key][1]


_checked: dict[int, Effect] = {}  # by identity; kept because evaluating a formula takes time


def _check(effect: Effect) -> None:
    if id(effect) in _checked:
        return
    if effect.acts not in BESIDES or effect.name == rolling_inertia.name:
        raise ValueError(f"got {effect.name}, which a ball with a body has by itself; expected {', '.join(BESIDES)}")
    if effect.formula is None:
        raise ValueError(f"got {effect.name} without a formula, expected one with a formula")
    module = getattr(effect.formula, "__module__", "")
    if effect.named and module.startswith(OURS):  # tests look at these; sympy is slow to import
        return
    made = effect.formula(state(), symbols_of(effect.parameters, ""))
    parts = list(made.values()) if isinstance(made, Mapping) else [made]
    asked = {symbol.name for part in parts for symbol in getattr(part, "free_symbols", ())}
    if asked & set(RECORDED):
        raise ValueError(f"got {effect.name}, which asks for {', '.join(sorted(asked & set(RECORDED)))}: a ball with "
                         "a body knows the moment only")  # fmt: skip
    _checked[id(effect)] = effect
