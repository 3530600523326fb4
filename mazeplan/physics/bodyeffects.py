"""Effects of the registry, a user's own included, as they act on a ball with a body.

They come through the compiled function that planner and filter call already (`plane` of `compiled.ring_functions`), so
a formula is written once for all of them. What the body has by itself is refused here and goes into its own numbers:
it rolls (`Ball.inertia`), it meets walls and openings (`Ball.wall`, `Ball.restitution`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mazeplan.physics.arrays import packed
from mazeplan.physics.ball import rolling_inertia
from mazeplan.physics.body import FELT_ROOM, Effects, no_effects
from mazeplan.physics.compiled import Functions, plane_functions
from mazeplan.physics.effect import DRAG, DRY, FORCE, GRAVITY, Effect, Term
from mazeplan.physics.symbols import RECORDED, state, symbols_of

BESIDES = (GRAVITY, FORCE, DRAG, DRY)


def effects_of(terms: Sequence[Term]) -> Effects:
    """The sum of some effects for `physics.body`. Raises ValueError for one that the body has by itself, and for one
    whose formula asks for what only a record of beads has."""
    for term in terms:
        _check(term.effect)
    terms = [term for term in terms if not idle(term)]
    if not terms:
        return no_effects()
    numbers = [*packed(terms), *[0.0] * FELT_ROOM]
    return Effects(_address(tuple(term.effect for term in terms)), np.array(numbers, dtype=np.float64))


def idle(term: Term) -> bool:
    """Whether a term does nothing: all that says how large it is, is as it is without it."""
    known = zip(term.effect.parameters.items(), term.numbers, strict=True)
    return all(name in term.effect.places or value == p.default for (name, p), value in known)


_made: dict[tuple[int, ...], tuple[tuple[Effect, ...], Functions]] = {}  # by identity; keeps both alive


def _address(effects: tuple[Effect, ...]) -> int:
    """Of `plane`; a filter asks for it again and again."""
    key = tuple(map(id, effects))
    if key not in _made:
        _made[key] = effects, plane_functions(effects)
    return _made[key][1].address["plane"]


_checked: dict[int, Effect] = {}  # by identity, as looking at a formula takes time


def _check(effect: Effect) -> None:
    if id(effect) in _checked:
        return
    if effect.acts not in BESIDES or effect.name == rolling_inertia.name:
        raise ValueError(f"got {effect.name}, which a ball with a body has by itself; expected {', '.join(BESIDES)}")
    if effect.formula is None:
        raise ValueError(f"got {effect.name} without a formula, expected one with a formula")
    made = effect.formula(state(), symbols_of(effect.parameters, ""))
    parts = list(made.values()) if isinstance(made, Mapping) else [made]
    asked = {symbol.name for part in parts for symbol in getattr(part, "free_symbols", ())}
    if asked & set(RECORDED):
        raise ValueError(f"got {effect.name}, which asks for {', '.join(sorted(asked & set(RECORDED)))}: a ball with "
                         "a body knows the moment only")  # fmt: skip
    _checked[id(effect)] = effect
