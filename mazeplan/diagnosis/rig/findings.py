"""Found differences of a rig as entries of the document: of the stage, of ball, table and camera, and open numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mazeplan.control.estimation.rigid_body_filter import BodyFilter
from mazeplan.control.estimation.rigid_body_fit import fit_body
from mazeplan.control.estimation.rigid_body_parameters import value_of, with_values
from mazeplan.diagnosis.effect_entry import Entry, effect_entry, values_of, with_plan
from mazeplan.diagnosis.rig.candidates import CANDIDATES, Candidate
from mazeplan.diagnosis.rig.entry_words import BY_SENSOR
from mazeplan.diagnosis.rig.fitting import ENOUGH, NOISE, POLISH
from mazeplan.diagnosis.rig.moved_plate import MovedPlate
from mazeplan.diagnosis.rig.reference import RigReference
from mazeplan.diagnosis.rig.registry import registry_entry
from mazeplan.diagnosis.rig.search import NEEDED, SearchResult, surely_differs
from mazeplan.diagnosis.stage.comparison import AXES, moved_zero, stage_effects
from mazeplan.diagnosis.stage.navigation import coupling_in_navigation
from mazeplan.diagnosis.stage.plate_motion import Stage
from mazeplan.physics.registry import PACKAGED

HARDLY = 3.0  # maximum change of a small effect, in smallest sizes
SURE = 3.5  # standard errors by which two gains differ


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
    effects += [] if plate.unseen is None else [plate.unseen.entry]
    for e in effects:
        e["rings"] = {str(ring): {"after": values_of(e), "before": e["known_before"]} for ring in radii}
    return effects


def of_the_ball(
    plate: MovedPlate, was: RigReference, searched: SearchResult, found: Sequence[Candidate], radii: dict[int, float]
) -> tuple[list[Entry], list[tuple[str, ...]]]:
    """Effects of ball, table and camera, and names that the record cannot tell apart. found: those that predict"""
    effects, alike, others = list[Entry](), list[tuple[str, ...]](), {name for c in found for name in c.instead}
    for c, rivals in zip(searched.found, searched.rivals, strict=True):
        by_sensor = c.effect == "tilt_gain" and plate.sensor is not None
        if c not in found or not c.effect or c.effect in others or by_sensor:
            continue
        if any(e["name"] == c.effect for e in effects):  # sliding and rolling at walls: two numbers of one effect
            continue
        entry = registry_entry(c, searched.fit, was.body, radii)
        if small(entry, 1.0):  # a number of the rigid ball changed with another one, and what it does hardly changed
            continue
        effects.append(entry)
        names = tuple(r.effect for r in rivals if r.effect)
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


def by_zero(stage: Stage | None, was: RigReference, effects: Sequence[Entry], radii: dict[int, float]) -> list[Entry]:
    """The table against a tilt sensor whose zero moved, and the ball does not feel it."""
    moved = moved_zero(stage, was.stage)
    if stage is None or not moved or any(e["name"] == "tilt_offset" for e in effects):
        return []
    had = {axis: value_of(was.body.model, f"tilt_{axis}") for axis in AXES}
    now = {axis: had[axis] - moved[axis] for axis in AXES}
    stderr = {axis: seen.stderr["offset"] for axis, seen in zip(AXES, stage.axes, strict=True)}
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
