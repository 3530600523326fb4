"""The numbers of a `BodyModel` by name: see `learning.rigid_body_entries`; those of its terms as EFFECT.PARAMETER."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from mazeplan.control.estimation.rigid_body_filter import BodyModel
from mazeplan.learning.modelfile import RigModel
from mazeplan.learning.rigid_body_entries import (
    ABSENT,
    KEPT,
    PARAMETERS,
    REACH,
    Body,
    Number,
    determined,
    stamp,
    to_body_unit,
)
from mazeplan.maze.geometry import Maze
from mazeplan.physics.effect import BALL
from mazeplan.physics.registry import PACKAGED
from mazeplan.physics.rig.entries import part_stderr, part_values

LEFT_OVER = ("cross_beta", "cross_gamma")  # of the coupling, only what the fitted stage does not have already
FRICTION = ("rolling", "viscous", "quadratic")  # a bead has f times these values; f: rolling_inertia.factor


def number_of(model: BodyModel, name: str) -> Number:
    """Unit, bounds and description of a number. Raises KeyError for an unknown name."""
    if name in PARAMETERS:
        return PARAMETERS[name]
    i, key = _term(model, name)
    p = model.terms[i].effect.parameters[key]
    return Number("terms", name, p.unit, p.low, p.high, p.smallest or p.step, False, p.words or name, name)


def _term(model: BodyModel, name: str) -> tuple[int, str]:
    """Index of the term, and name of its parameter, for a name EFFECT.PARAMETER. Raises KeyError."""
    effect, _, key = name.partition(".")
    for i, term in enumerate(model.terms):
        if term.name == effect and key in term.effect.parameters:
            return i, key
    raise KeyError(name)


def value_of(model: BodyModel, name: str) -> float:
    """A number of a model by its name, in its unit."""
    if name not in PARAMETERS:
        i, key = _term(model, name)
        return model.terms[i].values()[key]
    where = PARAMETERS[name]
    return float(getattr(getattr(model, where.part), where.field))


def with_values(model: BodyModel, values: Mapping[str, float]) -> BodyModel:
    """The model with other values of some numbers, in their units."""
    for name, value in values.items():
        if name in PARAMETERS:
            where = PARAMETERS[name]
            part = getattr(model, where.part)._replace(**{where.field: value})
            model = model._replace(**{where.part: part})
            continue
        i, key = _term(model, name)
        term, terms = model.terms[i], list(model.terms)
        terms[i] = replace(term, numbers=tuple((term.values() | {key: value}).values()))
        model = model._replace(terms=tuple(terms))
    return model


def bead_values(rig: RigModel, maze: Maze, name: str) -> tuple[float, ...]:
    """Values of a number in a model of beads, in the unit of the rigid ball.

    There is one value for each ring with the effect, one for a number of the whole rig, none if the model does not
    have the number."""
    where = PARAMETERS[name]
    effect, _, key = where.effect.partition(".")
    if not effect or name in LEFT_OVER:
        return ()
    power = where.origin[1]
    if PACKAGED[effect].acts not in BALL:
        return (to_body_unit(part_values(rig, PACKAGED[effect])[key], where.how, power, REACH),)
    found = []
    for ring in sorted(rig.balls):
        ball, radius = rig.balls[ring], maze.track_radius(ring)
        value = ball.parameter(effect, key, math.nan)
        if not math.isfinite(value) or radius <= 0.0:
            continue
        share = ball.parameter("rolling_inertia", "factor", 1.0) if name in FRICTION else 1.0
        found.append(to_body_unit(value, where.how, power, radius) / share)
    return tuple(found[:1] if PACKAGED[effect].common else found)


def bead_stderr(rig: RigModel, maze: Maze) -> dict[str, float]:
    """Standard errors of the numbers in a model of beads, by name: the largest over the rings."""
    out = {}
    for name, number in PARAMETERS.items():
        effect, _, key = number.effect.partition(".")
        if not effect or name in LEFT_OVER:
            continue
        if PACKAGED[effect].acts not in BALL:
            errors = [part_stderr(rig, PACKAGED[effect]).get(key, math.nan)]
        else:
            known = ((b.stderr.get(effect, {}).get(key, math.nan), maze.track_radius(r)) for r, b in rig.balls.items())
            errors = [error / (radius or REACH) ** number.origin[1] for error, radius in known]
        if errors := [error for error in errors if math.isfinite(error)]:
            out[name] = max(errors)
    return out


def body_of(rig: RigModel) -> BodyModel | None:
    """The rigid ball of a rig's model; None if there is none, or if it was identified with other effects."""
    if rig.body is None or rig.body.of != stamp(rig.balls):
        return None
    values = {**ABSENT, **rig.body.values}
    values["delay"] = max(rig.camera_delay + values["delay"], -rig.stage.dead_time)
    return with_values(BodyModel(), values)._replace(terms=rig.body.terms)


def with_body(rig: RigModel, model: BodyModel, stderr: Mapping[str, float]) -> RigModel:
    """The rig's model with this rigid ball. It keeps only the terms that a run can use for prediction."""
    terms = tuple(term for term in model.terms if term.effect.planned and not term.idle)
    values = {name: value_of(model, name) for name in KEPT}
    values["delay"] -= rig.camera_delay
    for name, value in values.items():  # a search of logarithms may end beside a bound, by rounding
        number = PARAMETERS[name]
        values[name] = min(max(value, -number.high if name == "delay" else number.low), number.high)
    known = {name: value for name, value in values.items() if determined(name, value, stderr.get(name))}
    return replace(rig, body=Body(known, stamp(rig.balls), {k: s for k, s in stderr.items() if k in known}, terms))
