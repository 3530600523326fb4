"""What differs about a ball with a body, in the registry's names and units, and in words with what to do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from mazeplan.constants import GRAVITY
from mazeplan.diagnosis.bodysearch import ROUGH, Candidate, Reference
from mazeplan.estimation.bodyfilter import BodyModel
from mazeplan.estimation.bodyfit import BodyFit
from mazeplan.estimation.bodynumbers import FRICTION, number_of, value_of, with_values
from mazeplan.models.bodyentries import INERTIA, SAME
from mazeplan.physics.registry import PACKAGED

Values = dict[str, float]
REPAIRS = {
    "tilt_offset": "level the table", "axis_misalignment": "turn the camera back", "camera_offset": "centre the camera",
    "sensor_delay": "look for what delays the camera's pictures", "servo_gain": "check the linkage of the servo",
    "servo_lag": "check the servo's supply and load", "backlash": "tighten the linkage",
    "tilt_gain": "calibrate the tilt sensor", "dry_friction": "clean ball and floor",
    "surface_bump": "look for a magnet or a dent there", "surface_profile": "check that the floor is flat",
    "table_rocking": "stop the table from rocking; no plan can allow for it", "camera_scale": "calibrate the camera",
    "axis_coupling": "align the axes of the plate", "rolling_inertia": "check that it is the same ball",
}  # fmt: skip


def in_registry(c: Candidate, fit: BodyFit, was: Reference, radii: dict[int, float]) -> dict[str, Any]:
    """A candidate that was found, as the JSON has it: in the ring with most pictures, and in all `rings`."""
    by_ring = {
        ring: (_numbers(c, fit.model, was, radius), _numbers(c, was.model, was, radius))
        for ring, radius in radii.items()
    }
    values, before = next(iter(by_ring.values()))
    spread = _spread(c, fit, was, next(iter(radii.values())), values)
    units = {key: p.unit for key, p in PACKAGED[c.effect].parameters.items()}
    return {
        "name": c.effect,
        "parameters": {k: {"value": v, "stderr": spread[k], "unit": units[k]} for k, v in values.items()},
        "known_before": before,
        "rings": {str(ring): {"after": now, "before": was_} for ring, (now, was_) in by_ring.items()},
    }


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
        waves = dict.fromkeys(PACKAGED[c.effect].parameters, 0.0)
        return waves | {"cos2": -2.0 * f * GRAVITY * b, "sin2": 2.0 * f * GRAVITY * a}
    if c.effect == "surface_bump":
        x, y, depth, width = (_term(model, f"floor_bump.{key}") for key in ("x", "y", "depth", "width"))
        aside = (math.hypot(x, y) - radius) / width if width else 0.0
        height = -f * GRAVITY * depth * math.exp(-0.5 * aside * aside) / radius
        return {"centre": math.atan2(y, x), "width": width / radius, "height": height}
    if c.effect == "table_rocking":
        keys = ("frequency", "bs", "bc", "gs", "gc")
        frequency, bs, bc, gs, gc = (_term(model, f"table_swing.{key}") for key in keys)
        phase = math.atan2(bc, bs) if math.hypot(bs, bc) > math.hypot(gs, gc) else math.atan2(gc, gs)
        s, c_ = math.cos(phase), math.sin(phase)
        return {"frequency": frequency, "beta": bs * s + bc * c_, "gamma": gs * s + gc * c_, "phase": phase}
    out = {}
    for name in c.free:
        number = number_of(model, name)
        key = number.effect.partition(".")[2]
        value = value_of(model, name)
        if number.how == SAME:
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


def sentence(
    verdict: str, effects: Sequence[dict[str, Any]], alike: Sequence[Sequence[str]], unknown: dict[str, Any] | None,
    before: Values, after: Values, remaining: float,
) -> str:  # fmt: skip
    """What was found, how much, how sure, and what it does to the prediction."""
    left = f"What remains is {remaining:.1f} times the noise of the camera."
    if verdict == "nothing_missing":
        return f"Nothing differs from the reference. {left}"
    parts = [_change(effect) for effect in effects]
    end = "; ".join(parts)
    if unknown is not None:
        end = "; ".join([*parts, f"something without a name: {unknown['description']}"])
    doubt = "".join(f" This record cannot tell {' from '.join(map(_plain, group))}." for group in alike)
    error = ""
    if after != before:
        was, now = (f"{e['rollout40']:.3f}" for e in (before, after))
        error = f" Error 40 samples ahead, on the part that was held out: {was} rad without it, {now} rad with it."
    return f"Differs from the reference: {end}.{doubt}{error} {left}"


def _change(effect: dict[str, Any]) -> str:
    """An effect, from what to what."""
    before, parts = effect["known_before"], []
    places = PACKAGED[effect["name"]].places
    for key, number in effect["parameters"].items():
        old, error = before.get(key, 0.0) or 0.0, number["stderr"]
        if abs(number["value"] - old) <= 3.0 * error and len(effect["parameters"]) > 1:
            continue
        unit = "" if number["unit"] == "1" else f" {number['unit']}"
        change = f"{number['value']:.4g}" if key in places else f"{old + 0.0:.4g} -> {number['value']:.4g}"
        parts.append(f"{key} {change} +- {error:.2g}{unit}")
    return f"{_plain(effect['name'])} ({', '.join(parts)})"


def _plain(name: str) -> str:
    return name.replace("_", " ")


def advice(
    effects: Sequence[dict[str, Any]], alike: Sequence[Sequence[str]], unknown: dict[str, Any] | None
) -> list[str]:
    """What to do."""
    out = [f"Either {REPAIRS[e['name']]}, or learn a new model (`mazeplan learn`)." for e in effects
           if e["name"] in REPAIRS]  # fmt: skip
    if alike:
        out.append("Collect a longer record in all rings (`mazeplan collect --rings`) to tell them apart.")
    if unknown is not None and not effects:
        out.append("Look at the rig: the record alone does not say what changed.")
    return out
