"""Found numbers of the ball as effects of the registry, in its names and units, ring by ring."""

from __future__ import annotations

import math
from collections.abc import Mapping

from mazeplan.control.estimation.rigid_body_filter import BodyModel
from mazeplan.control.estimation.rigid_body_fit import BodyFit
from mazeplan.control.estimation.rigid_body_parameters import FRICTION, number_of, value_of, with_values
from mazeplan.core.constants import GRAVITY
from mazeplan.diagnosis.effect_entry import Entry, effect_entry
from mazeplan.diagnosis.rig.candidates import Candidate
from mazeplan.diagnosis.rig.fitting import Reference
from mazeplan.diagnosis.rig.search import STDERR_SCALE, known_value
from mazeplan.learning.rigid_body_entries import INERTIA, SAME
from mazeplan.physics.effect import Effect
from mazeplan.physics.effects.local_forces import FAMILY
from mazeplan.physics.registry import EFFECTS

Values = dict[str, float]
# errors of the model itself, found on known rigs: as a share of the value, and in the unit of the value
MODEL_ERROR = {
    "rolling": (0.012, 0.0), "viscous": (0.03, 0.005), "quadratic": (0.03, 0.0), "wall": (0.03, 0.0),
    "wall_rolling": (0.1, 0.0),
    "delay": (0.0, 1.2e-3), "inertia": (0.0, 2e-3), "angle": (0.0, 5e-4),
}  # fmt: skip


def registry_entry(c: Candidate, fit: BodyFit, was: Reference, radii: Mapping[int, float]) -> Entry:
    """A found candidate as an entry of the document: values in the ring that shows it most, and in all rings.

    radii: track radii by ring, m; the ring with most pictures is first"""
    if c.effect in ("local_friction", "gate_loss"):
        term = c.free[0].partition(".")[0]
        low, high = (known_value(fit.model, f"{term}.{key}") for key in ("inner", "outer"))
        radii = {ring: radius for ring, radius in radii.items() if low < radius < high} or radii
    if c.effect == "surface_bump":
        away = math.hypot(*(known_value(fit.model, f"floor_bump.{key}") for key in "xy"))
        radii = dict(sorted(radii.items(), key=lambda pair: abs(pair[1] - away)))
    had = {*FAMILY, *(term.name for term in was.model.terms)}
    # an effect of a user that the reference lacks is at its defaults
    lacking = (term.effect() for term in fit.model.terms if term.name == c.effect and term.name not in had)
    old = was.model._replace(terms=(*was.model.terms, *lacking))
    rings = {
        ring: {"after": _numbers(c, fit.model, was, radius), "before": _numbers(c, old, was, radius)}
        for ring, radius in radii.items()
    }
    values, before = (next(iter(rings.values()))[when] for when in ("after", "before"))
    spread = _spread(c, fit, was, next(iter(radii.values())), values)
    effect = _effect(c, fit)
    if c.effect == "surface_bump":
        least = effect.parameters["height"].smallest
        rings = {ring: both for ring, both in rings.items() if abs(both["after"]["height"]) > least} or rings
    return effect_entry(effect, values, spread, before, rings={str(ring): both for ring, both in rings.items()})


def _effect(c: Candidate, fit: BodyFit) -> Effect:
    """The effect of the registry, or of a user."""
    return EFFECTS.get(c.effect) or next(term.effect for term in fit.model.terms if term.name == c.effect)


def _spread(c: Candidate, fit: BodyFit, was: Reference, radius: float, at: Values) -> Values:
    """Standard errors, by finite differences. They combine ROUGH times those of the fit and the error of the model."""
    out = dict.fromkeys(at, 0.0)
    for name in c.free:
        share, least = MODEL_ERROR.get(name, (0.0, 0.0))
        value = value_of(fit.model, name)
        stderr = fit.stderr.get(name, was.stderr.get(name, 0.0))  # a number that no fit moved is as sure as before
        sigma = math.hypot(STDERR_SCALE * was.misfit * stderr, share * value, least)
        step = min(sigma, number_of(fit.model, name).high - value)
        there = _numbers(c, with_values(fit.model, {name: value + step}), was, radius)
        scale = sigma / step if step > 0.0 else 0.0  # the step ends at the bound
        out = {key: math.hypot(out[key], scale * (there[key] - at[key])) for key in at}
    return out


def _numbers(c: Candidate, model: BodyModel, was: Reference, radius: float) -> Values:
    """Parameters of the registry's effect, in a ring with a track radius (m)."""
    f = 1.0 / (1.0 + model.ball.inertia)

    def of(term: str, *keys: str) -> list[float]:
        return [known_value(model, f"{term}.{key}") for key in keys]

    if c.effect in ("surface_profile", "surface_ripple"):
        waves = dict.fromkeys(EFFECTS[c.effect].parameters, 0.0)
        if c.effect == "surface_profile":
            a, b = of("floor_warp", "a", "b")
            return waves | {"cos2": -2.0 * f * GRAVITY * b, "sin2": 2.0 * f * GRAVITY * a}
        count, cos, sin = of("floor_ripple", "waves", "c", "s")
        return waves | {f"cos{int(count or 4)}": cos / radius, f"sin{int(count or 4)}": sin / radius}
    if c.effect == "surface_bump":
        x, y, depth, width = of("floor_bump", "x", "y", "depth", "width")
        aside = (math.hypot(x, y) - radius) / width if width else 0.0
        height = -f * GRAVITY * depth * math.exp(-0.5 * aside * aside) / radius
        return {"centre": math.atan2(y, x), "width": width / radius, "height": height}
    if c.effect == "constant_torque":
        turn, force = of("ring_push", "turn", "force")
        return {"acceleration": turn + force / radius}
    if c.effect == "friction_drift":
        return dict(zip(("rate", "start"), of("drag_drift", "rate", "start"), strict=True))
    if c.effect == "gate_loss":
        centre, size = of("floor_kerb", "centre", "size")
        return {"angle": centre, "loss": 1.0 - math.exp(-size)}
    if c.effect == "local_friction":
        start, end, size = of("floor_dirt", "start", "end", "coefficient")
        return {"start": start, "end": end, "coefficient": size / radius}
    if c.effect == "table_rocking":
        frequency, bs, bc, gs, gc = of("table_swing", "frequency", "bs", "bc", "gs", "gc")
        phase = math.atan2(bc, bs) if math.hypot(bs, bc) > math.hypot(gs, gc) else math.atan2(gc, gs)
        s, c_ = math.cos(phase), math.sin(phase)
        return {"frequency": frequency, "beta": bs * s + bc * c_, "gamma": gs * s + gc * c_, "phase": phase}
    if c.free == ("wall_rolling",):  # its effect on a ball that rolls on the floor and on the wall
        return {"coefficient": model.ball.wall_rolling * (1.0 + model.ball.inertia) / (1.0 + 2.0 * model.ball.inertia)}
    return dict(_number(name, model, was, radius, f) for name in c.free)


def _number(name: str, model: BodyModel, was: Reference, radius: float, f: float) -> tuple[str, float]:
    """A number of the ball, or of a user's term, as a parameter of the registry; f: 1 / (1 + inertia)."""
    try:
        number, value = number_of(model, name), value_of(model, name)
    except KeyError:  # the model has no such term
        return name.partition(".")[2], 0.0
    key = number.effect.partition(".")[2]
    if number.part == "terms":
        return key, value
    if number.how == SAME:
        return key, value * radius ** number.origin[1] * (f if name in FRICTION else 1.0)
    return key, 1.0 / (value + 1.0) if number.how == INERTIA else value_of(was.model, name) / value
