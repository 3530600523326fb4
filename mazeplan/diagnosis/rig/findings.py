"""Found differences of a rig as entries of the document, in the registry's names and units, ring by ring."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from mazeplan.control.estimation.rigid_body_filter import BodyFilter, BodyModel
from mazeplan.control.estimation.rigid_body_fit import FRICTION, BodyFit, fit_body, number_of, value_of, with_values
from mazeplan.core.constants import GRAVITY
from mazeplan.diagnosis.document import Entry, effect_entry, values_of, with_plan
from mazeplan.diagnosis.rig.candidates import CANDIDATES, Candidate
from mazeplan.diagnosis.rig.fitting import (
    ENOUGH,
    NEEDED,
    NOISE,
    POLISH,
    STDERR_SCALE,
    SURE,
    Reference,
    known_value,
    surely_differs,
)
from mazeplan.diagnosis.rig.plate import MovedPlate
from mazeplan.diagnosis.rig.reference import RigReference
from mazeplan.diagnosis.rig.search import SearchResult
from mazeplan.diagnosis.rig.words import BY_SENSOR
from mazeplan.diagnosis.stage.comparison import AXES, moved_zero, stage_effects
from mazeplan.diagnosis.stage.navigation import coupling_in_navigation
from mazeplan.learning.rigid_body_entries import INERTIA, SAME
from mazeplan.physics.effects.local_forces import FAMILY
from mazeplan.physics.registry import EFFECTS, PACKAGED

Values = dict[str, float]
HARDLY = 3.0  # maximum change of a small effect, in smallest sizes
# errors of the model itself, found on known rigs: as a share of the value, and in the unit of the value
MODEL_ERROR = {
    "rolling": (0.012, 0.0), "viscous": (0.03, 0.005), "quadratic": (0.03, 0.0), "wall": (0.03, 0.0),
    "wall_rolling": (0.1, 0.0),
    "delay": (0.0, 1.2e-3), "inertia": (0.0, 2e-3), "angle": (0.0, 5e-4),
}  # fmt: skip


def of_the_stage(
    plate: MovedPlate, was: RigReference, radii: dict[int, float], found: Sequence[Candidate]
) -> list[Entry]:
    """Effects of stage and tilt sensor, the same in all rings. found: candidates of the ball"""
    if plate.stage is not None and plate.overtaxed:
        effects = coupling_in_navigation(plate.record, plate.stage, was.stage)
    else:
        effects = stage_effects(plate.stage, was.stage)
    if plate.sensor is not None:
        effects.append(plate.sensor)
    elif plate.servo is not None and not any(c.effect == "tilt_gain" for c in found):
        effects.append(plate.servo)
    effects += [] if plate.unseen is None else [plate.unseen]
    for e in effects:
        e["rings"] = {str(ring): {"after": values_of(e), "before": e["known_before"]} for ring in radii}
    return effects


def of_the_ball(
    plate: MovedPlate, was: RigReference, searched: SearchResult, found: Sequence[Candidate], radii: dict[int, float]
) -> tuple[list[Entry], list[tuple[str, ...]]]:
    """Effects of ball, table and camera, and names that the record cannot tell apart. found: those that predict"""
    effects, alike, others = list[Entry](), list[tuple[str, ...]](), {name for c in found for name in c.instead}
    for finding in searched.found:
        c = finding.candidate
        by_sensor = c.effect == "tilt_gain" and plate.sensor is not None
        if c not in found or not c.effect or c.effect in others or by_sensor:
            continue
        if any(e["name"] == c.effect for e in effects):  # sliding and rolling at walls: two numbers of one effect
            continue
        entry = registry_entry(c, searched.fit, was.body, radii)
        if small(entry, 1.0):  # a number of the rigid ball changed with another one, and what it does hardly changed
            continue
        effects.append(entry)
        names = tuple(r.effect for r in finding.rivals if r.effect)
        if names:
            alike.append((c.effect, *names))
    return by_servos(effects, alike, was) if plate.blind else (effects, alike)


def small(effect: Entry, most: float = HARDLY) -> bool:
    """Whether all changes of an effect are at most so many of its smallest sizes."""
    had, known = effect["known_before"], PACKAGED.get(effect["name"])
    return known is not None and all(
        abs(value - had[key]) <= most * known.parameters[key].smallest for key, value in values_of(effect).items()
    )


def by_servos(
    ball: list[Entry], alike: list[tuple[str, ...]], was: RigReference
) -> tuple[list[Entry], list[tuple[str, ...]]]:
    """The same without a tilt sensor: nothing has a scale, a late command looks like a late picture, and the same gain
    of both servos like another ball."""
    had, out = was.stage.values.get("servo_gain") or dict.fromkeys(AXES, 1.0), list[Entry]()
    for e in ball:
        if e["name"] == "tilt_gain":
            now = {axis: had[axis] / value for axis, value in values_of(e).items()}
            stderr = {axis: now[axis] ** 2 / had[axis] * e["parameters"][axis]["stderr"] for axis in AXES}
            both = {"after": now, "before": had}
            e = effect_entry(PACKAGED["servo_gain"], now, stderr, had, rings=dict.fromkeys(e["rings"], both))
            (one, two), (a, b) = (now[axis] / had[axis] for axis in AXES), stderr.values()
            if abs(one - two) < SURE * math.hypot(a, b):
                alike = [*alike, ("servo_gain", "rolling_inertia")]
        elif e["name"] == "sensor_delay":
            alike = [*alike, ("sensor_delay", "command_delay")]
        out.append(e)
    return out, alike


def by_zero(plate: MovedPlate, was: RigReference, effects: Sequence[Entry], radii: dict[int, float]) -> list[Entry]:
    """The table against a tilt sensor whose zero moved, and the ball does not feel it."""
    moved = moved_zero(plate.stage, was.stage)
    if plate.stage is None or not moved or any(e["name"] == "tilt_offset" for e in effects):
        return []
    had = {axis: value_of(was.body.model, f"tilt_{axis}") for axis in AXES}
    now = {axis: had[axis] - moved[axis] for axis in AXES}
    stderr = {axis: seen.stderr["offset"] for axis, seen in zip(AXES, plate.stage.axes, strict=True)}
    both = {"after": now, "before": had}
    entry = effect_entry(PACKAGED["tilt_offset"], now, stderr, had, rings={str(ring): both for ring in radii})
    return [with_plan(entry | BY_SENSOR)]


def with_asymmetry(effects: list[Entry]) -> list[Entry]:
    """Replace dry friction and a weaker push along the rings by friction with an asymmetry.

    A moving ball feels the same."""
    by_name = {effect["name"]: effect for effect in effects}
    friction, push = by_name.get("dry_friction"), by_name.get("constant_torque")
    if friction is None or push is None:
        return effects
    numbers, pushed = friction["parameters"], push["parameters"]["acceleration"]
    if abs(pushed["value"]) > numbers["coefficient"]["value"]:
        return effects
    numbers["asymmetry"] = {**pushed, "value": -pushed["value"]}
    friction["known_before"]["asymmetry"] = -push["known_before"]["acceleration"]
    for ring, both in friction["rings"].items():
        for when in ("before", "after"):
            both[when] = {**both[when], "asymmetry": -push["rings"][ring][when]["acceleration"]}
    return [effect for effect in effects if effect is not push]


def of_open_numbers(
    body: BodyFilter, searched: SearchResult, was: RigReference, radii: dict[int, float]
) -> list[Entry]:
    """Effects of numbers that the reference does not know.

    Against a textbook ball, these are all numbers that differ from it. Against a model of beads, this is friction, if
    it is far from the model's friction."""
    fit = searched.fit
    if was.body.start is not None:
        some = [c for c in CANDIDATES if c.effect and set(c.free) <= {*was.body.open, "inertia"}]
        some = [c for c in some if c not in searched.found]
        sure = [c for c in some if surely_differs(fit.model, fit.stderr, was.body, c.free)]
        return [registry_entry(c, fit, was.body, radii) for c in sure]
    if was.friction is None:
        return []
    value, (low, high) = value_of(fit.model, "rolling"), was.friction
    if low <= value <= high:
        return []
    nearest = with_values(fit.model, {"rolling": min(max(value, low), high)})
    rest = [name for name in fit.free if name != "rolling"]
    if fit_body(body, nearest, rest or NOISE, POLISH, ENOUGH).minus2 - fit.minus2 < NEEDED:
        return []
    (friction,) = [c for c in CANDIDATES if c.effect == "dry_friction"]
    return [registry_entry(friction, fit, was.body, radii)]


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
    effect = EFFECTS.get(c.effect) or next(term.effect for term in fit.model.terms if term.name == c.effect)
    if c.effect == "surface_bump":
        least = effect.parameters["height"].smallest
        rings = {ring: both for ring, both in rings.items() if abs(both["after"]["height"]) > least} or rings
    return effect_entry(effect, values, spread, before, rings={str(ring): both for ring, both in rings.items()})


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
