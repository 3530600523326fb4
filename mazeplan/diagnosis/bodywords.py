"""What differs about a rig, in the registry's names and units, and in words with what to do."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from mazeplan.constants import GRAVITY
from mazeplan.diagnosis.bodysearch import ROUGH, Candidate, Reference
from mazeplan.estimation.bodyfilter import BodyModel
from mazeplan.estimation.bodyfit import BodyFit
from mazeplan.estimation.bodynumbers import FRICTION, number_of, value_of, with_values
from mazeplan.models.bodyentries import INERTIA, SAME
from mazeplan.physics.effect import Parameter
from mazeplan.physics.registry import EFFECTS

if TYPE_CHECKING:
    from mazeplan.diagnosis.bodyverdict import BodyVerdict

Values = dict[str, float]
REMAINS, TWICE = 1.5, 2.0  # times the noise, from which what remains is compared, and from which it is too much
REPAIRS = {
    "tilt_offset": "Level the table", "axis_misalignment": "Turn the camera back", "camera_offset": "Centre the camera",
    "sensor_delay": "Look for what delays the camera's pictures", "servo_gain": "Check the linkage of the servo",
    "servo_lag": "Check the servo's supply and load", "backlash": "Tighten the linkage",
    "deadband": "Check the servo", "command_delay": "Look for what delays the commands",
    "tilt_gain": "Calibrate the tilt sensor", "dry_friction": "Clean the ball and the floor",
    "viscous_friction": "Clean the ball and the floor", "wall_friction": "Clean the walls",
    "quadratic_drag": "Look for what brakes a fast ball", "local_friction": "Clean the floor",
    "friction_drift": "Look for what warms up or gets dirty", "constant_torque": "Look for a draught that goes round",
    "surface_bump": "Look for a magnet or a dent", "surface_profile": "Check that the floor is flat",
    "table_rocking": "Stop the table from rocking", "camera_scale": "Calibrate the camera",
    "lens_distortion": "Calibrate the camera", "axis_coupling": "Align the axes of the plate",
    "rolling_inertia": "Check that it is the same ball", "gate_loss": "Look for an edge or a burr",
    "surface_ripple": "Check that the floor is flat",
}  # fmt: skip


def in_registry(c: Candidate, fit: BodyFit, was: Reference, radii: dict[int, float]) -> dict[str, Any]:
    """A candidate that was found, as the JSON has it: in the ring that shows it most, and in all `rings`."""
    if c.effect in ("local_friction", "gate_loss"):
        term = c.free[0].partition(".")[0]
        low, high = (_term(fit.model, f"{term}.{key}") for key in ("inner", "outer"))
        radii = {ring: radius for ring, radius in radii.items() if low < radius < high} or radii
    if c.effect == "surface_bump":
        away = math.hypot(*(_term(fit.model, f"floor_bump.{key}") for key in "xy"))
        radii = dict(sorted(radii.items(), key=lambda pair: abs(pair[1] - away)))
    by_ring = {
        ring: (_numbers(c, fit.model, was, radius), _numbers(c, was.model, was, radius))
        for ring, radius in radii.items()
    }
    values, before = next(iter(by_ring.values()))
    spread = _spread(c, fit, was, next(iter(radii.values())), values)
    units = {key: p.unit for key, p in _parameters(c, fit).items()}
    if c.effect == "surface_bump":
        least = EFFECTS[c.effect].parameters["height"].smallest
        by_ring = {ring: both for ring, both in by_ring.items() if abs(both[0]["height"]) > least} or by_ring
    return {
        "name": c.effect,
        "parameters": {k: {"value": v, "stderr": spread[k], "unit": units[k]} for k, v in values.items()},
        "known_before": before,
        "rings": {str(ring): {"after": now, "before": was_} for ring, (now, was_) in by_ring.items()},
    }


def _parameters(c: Candidate, fit: BodyFit) -> Mapping[str, Parameter]:
    """Of an effect of the registry, or of a user's own."""
    own = (term.effect for term in fit.model.terms if term.name == c.effect)
    return (EFFECTS.get(c.effect) or next(own)).parameters


def _spread(c: Candidate, fit: BodyFit, was: Reference, radius: float, at: Values) -> Values:
    """Standard errors, by differences, ROUGH times what the fit says."""
    out = dict.fromkeys(at, 0.0)
    for name in c.free:
        sigma = ROUGH * fit.stderr[name]
        kind = number_of(fit.model, name)
        up = min(value_of(fit.model, name) + sigma, kind.high)
        there = _numbers(c, with_values(fit.model, {name: up}), was, radius)
        out = {key: math.hypot(out[key], there[key] - at[key]) for key in at}
    return out


def _numbers(c: Candidate, model: BodyModel, was: Reference, radius: float) -> Values:
    """Parameters of the registry's effect, on a ring of a radius, m."""
    f = 1.0 / (1.0 + model.ball.inertia)
    if c.effect == "surface_profile":
        a, b = (_term(model, f"floor_warp.{key}") for key in "ab")
        waves = dict.fromkeys(EFFECTS[c.effect].parameters, 0.0)
        return waves | {"cos2": -2.0 * f * GRAVITY * b, "sin2": 2.0 * f * GRAVITY * a}
    if c.effect == "surface_bump":
        x, y, depth, width = (_term(model, f"floor_bump.{key}") for key in ("x", "y", "depth", "width"))
        aside = (math.hypot(x, y) - radius) / width if width else 0.0
        height = -f * GRAVITY * depth * math.exp(-0.5 * aside * aside) / radius
        return {"centre": math.atan2(y, x), "width": width / radius, "height": height}
    if c.effect == "constant_torque":
        return {"acceleration": _term(model, "ring_push.turn") + _term(model, "ring_push.force") / radius}
    if c.effect == "friction_drift":
        return {key: _term(model, f"drag_drift.{key}") for key in ("rate", "start")}
    if c.effect == "gate_loss":
        return {"angle": _term(model, "floor_kerb.centre"), "loss": 1.0 - math.exp(-_term(model, "floor_kerb.size"))}
    if c.effect == "surface_ripple":
        waves = dict.fromkeys(EFFECTS[c.effect].parameters, 0.0)
        for kind, key in (("cos", "c"), ("sin", "s")):
            waves[f"{kind}{int(_term(model, 'floor_ripple.waves') or 4)}"] = (
                _term(model, f"floor_ripple.{key}") / radius
            )
        return waves
    if c.effect == "local_friction":
        centre, half, size = (_term(model, f"floor_dirt.{key}") for key in ("centre", "half", "coefficient"))
        return {"start": centre - half, "end": centre + half, "coefficient": size / radius}
    if c.effect == "table_rocking":
        keys = ("frequency", "bs", "bc", "gs", "gc")
        frequency, bs, bc, gs, gc = (_term(model, f"table_swing.{key}") for key in keys)
        phase = math.atan2(bc, bs) if math.hypot(bs, bc) > math.hypot(gs, gc) else math.atan2(gc, gs)
        s, c_ = math.cos(phase), math.sin(phase)
        return {"frequency": frequency, "beta": bs * s + bc * c_, "gamma": gs * s + gc * c_, "phase": phase}
    out = {}
    for name in c.free:
        try:
            number, value = number_of(model, name), value_of(model, name)
        except KeyError:  # a term that was not there
            out[name.partition(".")[2]] = 0.0
            continue
        key = number.effect.partition(".")[2]
        if number.part == "terms":
            out[key] = value
        elif number.how == SAME:
            out[key] = value * radius ** number.origin[1] * (f if name in FRICTION else 1.0)
        else:
            out[key] = 1.0 / (value + 1.0) if number.how == INERTIA else value_of(was.model, name) / value
    return out


def _term(model: BodyModel, name: str) -> float:
    """A number of a term, 0 without it."""
    try:
        return value_of(model, name)
    except KeyError:
        return 0.0


SHOWN = {"rad": (180.0 / math.pi, "degrees"), "m": (1e3, "mm"), "s": (1e3, "ms")}  # how a person reads a unit
SQUARES = {"rad/s^2": "rad/s²", "1/s^2": "1/s²", "m/s^2": "m/s²", "1": ""}
CERTAIN, SURE, BARELY = 8.0, 4.0, 0.5  # standard errors
DEG = 180.0 / math.pi
PLACES = ("centre", "start", "end", "angle")  # rad, where on a ring an effect is


def sentence(done: BodyVerdict) -> str:
    """What differs, how much, how sure that is, and what it does to the prediction."""
    before, after = (errors["rollout40"] for errors in (done.before, done.after))
    left = f"What remains is {done.remaining:.1f} times the noise of the camera"
    if done.was.remaining > REMAINS and done.remaining > REMAINS:
        left += f"; it was {done.was.remaining:.1f} times when the model was right"
    if done.verdict == "nothing_missing":
        return f"Nothing is missing: the rig agrees with {done.was.source}. {left}."
    parts = [_change(effect) for effect in done.effects]
    if done.unknown is not None:
        parts.append(f"something without a name ({done.unknown['description']})")
    doubt = "".join(f" But this record cannot tell {' from '.join(map(_plain, group))}." for group in done.alike)
    error = ""
    if after != before:
        ahead = 40 * done.body.pictures.dt
        error = f" {ahead:.1f} s ahead, the error of the predicted angle goes from {DEG * before:.1f} to " \
                f"{DEG * after:.1f} degrees on held-out parts."  # fmt: skip
    return f"The rig differs from {done.was.source}: {'; '.join(parts)}.{_surely(done)}{error}{doubt} {left}."


def _surely(done: BodyVerdict) -> str:
    """How sure the finding is, in words and a number; nothing where nobody can say."""
    if math.isfinite(done.held.likelier):
        size, why = done.held.likelier, "predicts held-out parts better by {} standard errors"
    else:
        sizes = [ratio for effect in done.effects if (ratio := _ratio(effect))]
        size, why = min(sizes, default=0.0), "is a change of {} standard errors"
    if size < BARELY:
        return ""
    word = "certain" if size > CERTAIN else "sure" if size > SURE else "likely"
    return f" The finding is {word}: it {why.format(f'{size:.0f}' if size < 1000.0 else 'over 1000')}."


def _ratio(effect: Mapping[str, Any]) -> float:
    """The largest change of an effect's numbers over its standard error."""
    before = effect["known_before"]
    ratios = [
        abs(p["value"] - before.get(key, 0.0)) / p["stderr"] for key, p in effect["parameters"].items() if p["stderr"]
    ]
    return max((r for r in ratios if math.isfinite(r)), default=0.0)


def _change(effect: dict[str, Any]) -> str:
    """An effect, from what to what; where it is stands without what it was."""
    before, parts = effect["known_before"], []
    places = EFFECTS[effect["name"]].places if effect["name"] in EFFECTS else ()
    for key, number in effect["parameters"].items():
        old, error = before.get(key, 0.0) or 0.0, number["stderr"]
        if abs(number["value"] - old) <= 3.0 * error and len(effect["parameters"]) > 1:
            continue
        factor, unit = SHOWN.get(number["unit"], (1.0, SQUARES.get(number["unit"], number["unit"])))
        if key in places:
            parts.append(f"{_called(effect['name'], key)} {factor * number['value']:.3g} {unit}".rstrip())
            continue
        digits = _digits(factor * error, factor * number["value"])
        was = f"{factor * old:.{digits}f}" if old else "0"
        change = f"from {was} to {factor * number['value']:.{digits}f} ± {factor * error:.{digits}f} {unit}".rstrip()
        parts.append(f"{_called(effect['name'], key)} {change}")
    return f"{_plain(effect['name'])} ({', '.join(parts)})" if parts else _plain(effect["name"])


def _digits(error: float, value: float) -> int:
    """Decimal places that a standard error leaves meaningful; three figures of a value without one."""
    size = error if math.isfinite(error) and error > 0.0 else abs(value) / 10.0
    return min(max(0, 1 - math.floor(math.log10(size))), 9) if size > 0.0 else 2


def _called(effect: str, key: str) -> str:
    """What a number of an effect is called."""
    known = EFFECTS[effect].parameters.get(key) if effect in EFFECTS else None
    return known.words if known is not None and known.words else _plain(key)


def _plain(name: str) -> str:
    return name.replace("_", " ")


def _place(effect: Mapping[str, Any]) -> str:
    """Where to look, for what has a place."""
    places = EFFECTS[effect["name"]].places if effect["name"] in EFFECTS else ()
    at = {key: DEG * p["value"] for key, p in effect["parameters"].items() if key in PLACES and key in places}
    if not at:
        return ""
    ring = next(iter(effect["rings"]), "")
    angles = " to ".join(f"{(angle + 180.0) % 360.0 - 180.0:.0f}" for angle in at.values())
    return f" at {angles} degrees" + (f" in ring {ring}" if ring else "")


def advice(done: BodyVerdict, model: str | None = None) -> list[str]:
    """What to do next, a command behind a colon; model: the folder of the new one, where it was written."""
    repairs = [(e, f"{REPAIRS[e['name']]}{_place(e)}") for e in done.effects if e["name"] in REPAIRS]
    out = list(dict.fromkeys(f"{repair}." for e, repair in repairs if e.get("planned", True)))
    out += [
        f"{repair}. No plan can allow for it: {e['why_not']}." for e, repair in repairs if not e.get("planned", True)
    ]
    if any(e.get("planned", True) for e in done.effects):
        way = (f"plan with the new model: mazeplan navigate --rig RIG --model {model}" if model
               else "write a new model: add --model MODEL -o FOLDER to this command")  # fmt: skip
        out.append(f"Or leave the rig as it is, and {way}.")
    if any(e["name"] == "tilt_offset" for e in done.effects):
        out.append("A steady draught looks the same. Turn the maze by 90 degrees and record again to tell them apart.")
    if done.alike:
        out.append("Record longer, in all rings, to tell the causes apart: "
                   "mazeplan collect --rings --seconds 900 -o LOG.")  # fmt: skip
    if done.unknown is not None:
        out.append("One cause has no name yet. Look at the rig, then learn the model again: "
                   "mazeplan learn LOG -o FOLDER.")  # fmt: skip
    elif done.verdict == "nothing_missing" and done.remaining > TWICE:
        out.append("More remains than noise explains, as when the model was right. Learn the model again with terms "
                   "and a Gaussian process: mazeplan learn LOG --kind sp -o FOLDER.")  # fmt: skip
    elif done.verdict == "nothing_missing":
        out.append("Nothing needs to be done. Go on with the same model.")
    return out
