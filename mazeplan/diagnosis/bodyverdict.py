"""The verdict on a record of a rig: what differs from what the rig was like when its model was right.

Stage first, from commands and measured tilt alone; then ball, table and camera by `bodysearch`, with the plate moving
as the fitted stage says. A changed gain of the stage belongs to the servo, unless the ball felt tilts of the old size:
then the sensor shows them larger than they are. What was found has to predict: on blocks of time that took no part in
the fit, the record has to be likelier with it than without. What then remains is compared with the camera's noise, and
with what remained when the model was right.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mazeplan.data.table import Table
from mazeplan.diagnosis.bodycamera import check_map
from mazeplan.diagnosis.bodyrecord import body_filter, filter_of, left_over
from mazeplan.diagnosis.bodyreference import RigReference
from mazeplan.diagnosis.bodyscores import HeldOut, held_out, on_test
from mazeplan.diagnosis.bodysearch import (
    CANDIDATES,
    ENOUGH,
    NEEDED,
    NOISE,
    POLISH,
    Candidate,
    Reference,
    Searched,
    moved,
    search_body,
)
from mazeplan.diagnosis.bodywords import advice, in_registry, sentence
from mazeplan.diagnosis.parts import AXES, TOLD, changed, entry, stage_effects
from mazeplan.diagnosis.platemotion import Stage
from mazeplan.diagnosis.record import record_of
from mazeplan.diagnosis.wording import with_plan
from mazeplan.estimation.bodyfilter import BodyFilter
from mazeplan.estimation.bodyfit import fit_body
from mazeplan.estimation.bodynumbers import value_of, with_values
from mazeplan.maze.geometry import Maze
from mazeplan.models.rollout import STEPS as AHEAD
from mazeplan.physics import rig
from mazeplan.physics.bodyeffects import effects_of
from mazeplan.physics.effect import Effect
from mazeplan.physics.stage import StageModel

HELD_OUT = 0.5  # each half of a record is predicted from the other
BETTER = 2.0  # standard errors by which held-out blocks have to be likelier
MEMORY = 0.1  # autocorrelation of innovations from which something is left
REMAINS = 1.5  # times the noise, from which something is left
CLEAR_GAIN = 0.05  # change of a gain that commands which overtax the servos do not make
AS_BEFORE = 1.3  # times what was left when the model was right: no more than that is no news


@dataclass(frozen=True)
class BodyVerdict:
    """What `document` tells as JSON. effects: as in the JSON; unknown: what has no name; held: how held-out pictures
    are predicted; memory, remaining: of the innovations, see `left_over`; test: errors before and after on a further
    record. The rest is what a report draws from."""

    effects: tuple[dict[str, Any], ...]
    alike: tuple[tuple[str, ...], ...]
    unknown: dict[str, Any] | None
    held: HeldOut
    memory: float
    remaining: float
    searched: Searched
    body: BodyFilter
    stage: Stage | None
    was: RigReference
    notes: tuple[str, ...] = ()
    test: HeldOut | None = None

    @property
    def verdict(self) -> str:
        """As the JSON has it."""
        if self.unknown is not None:
            return "unknown_effect"
        if not self.effects:
            return "nothing_missing"
        return "ambiguous" if self.alike else "effect_found"

    @property
    def before(self) -> dict[str, float]:
        """Errors of roll-outs on what was held out, without what was found."""
        return self.held.errors("before")

    @property
    def after(self) -> dict[str, float]:
        """The same with it."""
        return self.held.errors("after") if self.effects or self.unknown is not None else self.before

    def sentences(self) -> list[str]:
        """What was found, and what to do."""
        return [sentence(self), *advice(self)]

    def document(self) -> dict[str, Any]:
        """As `diagnose --json`. An effect's errors are those of 40 samples, of all that was found."""
        before, after = self.before, self.after
        errors = {"before": before[f"rollout{AHEAD}"], "after": after[f"rollout{AHEAD}"]}
        numbers = sorted({int(ring) for effect in self.effects for ring in effect["rings"]})
        test = {}
        if self.test is not None:
            test = {"test": {which: {"nrmse": None, **self.test.errors(which)} for which in ("before", "after")}}
        return {
            "verdict": self.verdict, "sentence": self.sentences()[0],
            "effects": [effect | errors for effect in self.effects],
            "ambiguous_with": [list(g) for g in self.alike], "unknown": self.unknown,
            "before": {"nrmse": None, **before}, "after": {"nrmse": None, **after}, "noise_floor": None,
            "held_out": HELD_OUT, "remaining": round(self.remaining, 3), "advice": self.sentences()[1:],
            "reference": self.was.source, "notes": list(self.notes), **test,
            "rings": {str(ring): self._in_ring(str(ring)) for ring in numbers},
        }  # fmt: skip

    def _in_ring(self, ring: str) -> dict[str, Any]:
        """The verdict is that of all rings; sizes are those of this one."""
        here = []
        for effect in self.effects:
            if ring in effect["rings"]:
                there, parameters = effect["rings"][ring]["after"], effect["parameters"]
                told = {key: {**parameters[key], "value": value} for key, value in there.items()}
                here.append({"name": effect["name"], "parameters": told})
        return {"verdict": self.verdict, "effects": here}


def verdict_on(
    table: Table, maze: Maze, was: RigReference, tell: Callable[[str], None] = lambda text: None,
    test: Table | None = None, own: Sequence[Effect] = (),
) -> BodyVerdict:  # fmt: skip
    """What differs from a reference. tell: progress; test: a further record, for errors before and after; own: effects
    of a user's own that are looked for, too. Raises TableError."""
    own, refused = _on_a_body(own)
    tell("stage")
    body, stage = body_filter(table, maze)
    check_map(body, maze, table.source.get("file"))
    sensor = _sensor(body, stage, was)
    searched = search_body(body, was.body if sensor is None else _felt(was, sensor), maze, tell, own)
    tell("held-out part")
    old = _as_it_was(table, maze, was, stage, body)
    held = held_out(body, old, was.body.start or was.body.model, searched, maze)
    found = searched.found if held.likelier > BETTER and held.nearer else ()
    radii = _radii(maze, searched.fit.filtered)
    effects, alike = _named(stage, was, searched, found, radii, sensor)
    effects += [with_plan(e) for e in _of_open_numbers(body, searched, was, radii)]
    for e in effects:
        if e["name"] == "friction_drift":
            e["until_s"] = round(float(table["t"][-1] - table["t"][0]), 3)
    memory, remaining = left_over(body, searched.fit)
    unknown = _unknown(searched, found, memory, remaining, was)
    done = BodyVerdict(
        tuple(effects),
        tuple(alike),
        unknown,
        held,
        memory,
        remaining,
        searched,
        body,
        stage,
        was,
        (*_notes(stage, was), *refused),
    )
    return done if test is None else replace(done, test=_on_test(test, maze, done))


def _on_a_body(own: Sequence[Effect]) -> tuple[list[Effect], list[str]]:
    """Effects that act on a ball with a body, and what is to be said of the others."""
    good, notes = [], []
    for effect in own:
        try:
            effects_of([effect()])
        except ValueError as problem:
            notes.append(f"{effect.name} was not looked for: {problem}")
        else:
            good.append(effect)
    return good, notes


def _as_it_was(table: Table, maze: Maze, was: RigReference, stage: Stage | None, body: BodyFilter) -> BodyFilter:
    """The filter with the plate as the old model's stage moves it; as it is where that is not known."""
    known = was.stage.axes()
    if known is None or stage is None or stage.hurried:
        return body
    pairs = zip((known.beta, known.gamma), stage.axes, strict=True)
    moves = StageModel(*(replace(axis, offset=found.offset) for axis, found in pairs))
    return filter_of(table, record_of(table, np.ones(len(table), dtype=bool)), maze, moves)


def _on_test(test: Table, maze: Maze, done: BodyVerdict) -> HeldOut:
    """Errors on a further record, by the old model and by the new one."""
    record = record_of(test, np.ones(len(test), dtype=bool))
    stage = None if done.stage is None or done.stage.hurried else StageModel(*done.stage.axes)
    new = filter_of(test, record, maze, stage)
    old = _as_it_was(test, maze, done.was, done.stage, new)
    return on_test(old, done.was.body.start or done.was.body.model, new, done.searched.fit.model, maze)


def _notes(stage: Stage | None, was: RigReference) -> tuple[str, ...]:
    """What could not be compared."""
    notes = []
    if stage is None:
        notes.append("no commands u_beta, u_gamma in this record: servos cannot be checked, and the tilt is smoothed")
    if stage is not None and stage.hurried:
        notes.append("commands changed faster than the servos can follow, as in navigation: lag, delay and play of the "
                     "servos were not compared; mazeplan collect makes a record that shows them")  # fmt: skip
    if was.body.open and was.friction is not None:
        notes.append("the model keeps no record of the rig as it was: walls were not compared, and friction only "
                     "roughly; name a log of that time with --reference, or learn the model again")  # fmt: skip
    return tuple(notes)


def _sensor(body: BodyFilter, stage: Stage | None, was: RigReference) -> dict[str, Any] | None:
    """The scale of the tilt sensor as the JSON has it, where a changed gain is the sensor's: the ball felt tilts of the
    old size."""
    gain = None if stage is None or stage.hurried else changed(stage, rig.servo_gain, was.stage)
    if gain is None or was.body.start is not None:
        return None
    had, scale = gain["known_before"], was.stage.values.get("tilt_gain", dict.fromkeys(AXES, 1.0))
    ratio = {axis: gain["parameters"][axis]["value"] / had[axis] for axis in AXES}
    values = {axis: scale[axis] * ratio[axis] for axis in AXES}
    errors = {axis: gain["parameters"][axis]["stderr"] / had[axis] * scale[axis] for axis in AXES}
    effect: dict[str, Any] = entry(rig.tilt_gain, values, errors, scale)
    by_servo, by_sensor = (body.run(model).minus2 for model in (was.body.model, _felt(was, effect).model))
    return effect if by_servo - by_sensor > TOLD else None


def _felt(was: RigReference, sensor: dict[str, Any]) -> Reference:
    """The reference with tilts that are as much smaller than measured as the sensor's scale has grown."""
    model, numbers = was.body.model, sensor["parameters"]
    grown = {axis: numbers[axis]["value"] / sensor["known_before"][axis] for axis in AXES}
    return replace(
        was.body,
        model=with_values(model, {f"gain_{axis}": value_of(model, f"gain_{axis}") / grown[axis] for axis in AXES}),
    )


def _named(
    stage: Stage | None,
    was: RigReference,
    searched: Searched,
    found: Sequence[Candidate],
    radii: dict[int, float],
    sensor: dict[str, Any] | None,
) -> tuple[list[dict[str, Any]], list[tuple[str, ...]]]:
    """Effects as in the JSON, and names between which the record cannot tell."""
    hurried = stage is not None and stage.hurried
    effects = stage_effects(None if hurried else stage, was.stage)
    gain = None if stage is None else changed(stage, rig.servo_gain, was.stage)
    if gain is not None and hurried:
        ratios = [p["value"] / gain["known_before"][key] for key, p in gain["parameters"].items()]
        gain = gain if max(abs(ratio - 1.0) for ratio in ratios) > CLEAR_GAIN else None
    if sensor is not None:
        effects.append(sensor)
    elif gain is not None and not any(c.effect == "tilt_gain" for c in found):
        effects.append(gain)
    for e in effects:
        values = {key: number["value"] for key, number in e["parameters"].items()}
        e["rings"] = {str(ring): {"after": values, "before": e["known_before"]} for ring in radii}
    alike = []
    for c, rivals in zip(searched.found, searched.rivals, strict=True):
        if c not in found or not c.effect or (c.effect == "tilt_gain" and sensor is not None):
            continue
        effects.append(in_registry(c, searched.fit, was.body, radii))
        names = tuple(r.effect for r in rivals if r.effect)
        if names:
            alike.append((c.effect, *names))
    return [with_plan(effect) for effect in _one_way(effects)], alike


def _one_way(effects: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Friction and a weaker push along the rings are friction that is larger one way round: a moving ball cannot tell
    them apart."""
    by_name = {effect["name"]: effect for effect in effects}
    friction, push = by_name.get("dry_friction"), by_name.get("constant_torque")
    if friction is None or push is None:
        return effects
    told, pushed = friction["parameters"], push["parameters"]["acceleration"]
    if abs(pushed["value"]) > told["coefficient"]["value"]:
        return effects
    told["asymmetry"] = {**pushed, "value": -pushed["value"]}
    friction["known_before"]["asymmetry"] = -push["known_before"]["acceleration"]
    for ring, both in friction["rings"].items():
        for when in ("before", "after"):
            both[when] = {**both[when], "asymmetry": -push["rings"][ring][when]["acceleration"]}
    return [effect for effect in effects if effect is not push]


def _of_open_numbers(
    body: BodyFilter, searched: Searched, was: RigReference, radii: dict[int, float]
) -> list[dict[str, Any]]:
    """Effects of numbers that were fitted along: all that differ from a textbook ball; with a model of beads the
    friction, where that is far from what the model says."""
    fit = searched.fit
    if was.body.start is not None:
        some = [c for c in CANDIDATES if c.effect and set(c.free) <= set(was.body.open)]
        return [in_registry(c, fit, was.body, radii) for c in some if moved(fit.model, fit.stderr, was.body, c.free)]
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
    return [in_registry(friction, fit, was.body, radii)]


def _radii(maze: Maze, filtered: Any) -> dict[int, float]:
    """Track radii of the rings that the ball was in, those with most pictures first, m."""
    r = np.hypot(*filtered.state[np.isfinite(filtered.nu[:, 0]), :2].T)
    rings = [ring for ring in maze.rings if ring.track_radius]
    counts = {ring.number: int(np.sum((r > ring.inner_radius) & (r < ring.outer_radius))) for ring in rings}
    seen = sorted((n for n in counts if counts[n]), key=lambda n: -counts[n])
    return {number: maze.track_radius(number) for number in seen}


def _unknown(
    searched: Searched, found: Sequence[Candidate], memory: float, remaining: float, was: RigReference
) -> dict[str, Any] | None:
    """What has no name: a candidate without one, or innovations that remember more than they did."""
    nameless = [c.told(searched.fit.model) for c in found if not c.effect]
    if nameless:
        on = sorted({on for c in found if not c.effect for on in c.depends_on})
        return {"depends_on": on, "description": "; ".join(nameless)}
    if memory > max(MEMORY, AS_BEFORE * was.memory) or remaining > max(REMAINS, AS_BEFORE * was.remaining):
        what = f"what remains is {remaining:.1f} times the noise, and is alike from picture to picture"
        return {"depends_on": [], "description": what}
    return None
