"""The verdict on a record of a rig: what differs from the rig when its model was right.

1. Commands and measured tilt alone show what differs in the stage (`plate`).
2. The fitted stage moves the plate. The search finds what differs in ball, table and camera (`search`).
3. The findings have to predict: held-out blocks of time must be likelier with the findings than without.
4. The residual is compared with the camera's noise, and with the residual when the model was right.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mazeplan.control.estimation.rigid_body_filter import BodyModel, Filtered
from mazeplan.control.estimation.rigid_body_fit import value_of
from mazeplan.core.logs.table import Table
from mazeplan.diagnosis.document import Entry, with_plan
from mazeplan.diagnosis.record import record_of
from mazeplan.diagnosis.rig.candidates import CONTACT, Candidate
from mazeplan.diagnosis.rig.findings import by_zero, of_open_numbers, of_the_ball, of_the_stage, small, with_asymmetry
from mazeplan.diagnosis.rig.fitting import Reference
from mazeplan.diagnosis.rig.imbalance import BALANCED, Imbalance, also_in, imbalance_entry, unbalanced
from mazeplan.diagnosis.rig.plate import MovedPlate, as_it_was, felt, moved_plate, with_unseen_change
from mazeplan.diagnosis.rig.record import filter_on_stage, residual_summary, seconds_of
from mazeplan.diagnosis.rig.reference import SLIDES, RigReference, fit_reference
from mazeplan.diagnosis.rig.scores import BETTER, HeldOut, held_out, on_test
from mazeplan.diagnosis.rig.search import SearchResult, one_ball_instead, search_against
from mazeplan.diagnosis.rig.words import REMAINS, TWICE, advice, notes_on, plain, sentence
from mazeplan.diagnosis.stage.comparison import moved_zero
from mazeplan.diagnosis.stage.navigation import servos_look_changed
from mazeplan.learning.rig_model import FITS, kind_of_ball
from mazeplan.maze.geometry import Maze
from mazeplan.physics.dynamics.rigid_body import effects_of
from mazeplan.physics.effect import Effect
from mazeplan.physics.formulas.compiled import plane_functions

HELD_OUT = 0.5  # each half of a record is predicted from the other
NOT_PREDICTING = "held-out parts are predicted no better"
MEMORY = 0.1  # autocorrelation of innovations above which something is unexplained
LEAST_REMAINS = 1.1  # times the noise; in healthy records, small errors of the reference's numbers cause less
WORSE = 1.7  # minimum error over the error when the model was right, mean over rings, to report it
HEALTHY, SURE = 1.2, 3.5  # the same ratio in healthy records; standard errors by which it has to be higher
SURELY = 4.0  # standard errors of the gain in held-out blocks
LOUDER = 1.5  # times the camera's noise when the model was right
AS_BEFORE = 1.3  # residual over the residual when the model was right: up to this ratio, it is no news


@dataclass(frozen=True)
class Unknown:
    """Something without a name, or of unknown cause and size."""

    description: str = ""
    depends_on: tuple[str, ...] = ()
    look: tuple[str, ...] = ()  # where to look
    servos: tuple[str, ...] = ()  # what servos do that they did not do; the record shows neither cause nor size
    cause: bool = False  # whether the description says what differs, although no model has a number for it

    def document(self) -> dict[str, Any]:
        """As in the JSON document."""
        words = "; ".join(word for word in (self.description, *self.servos) if word)
        out: dict[str, Any] = {"depends_on": list(self.depends_on), "description": words}
        return out | ({"look": list(self.look)} if self.look else {})


@dataclass(frozen=True)
class RigVerdict:
    """What differs from the reference."""

    effects: tuple[Entry, ...]  # entries of the document
    alike: tuple[tuple[str, ...], ...]  # groups of names that the record cannot tell apart
    unknown: Unknown | None  # something without a name, None if there is nothing
    held: HeldOut  # predictions of the held-out halves
    memory: float  # autocorrelation of the innovations, and their size over the noise (`record.residual_summary`)
    remaining: float
    searched: SearchResult  # what differs in ball, table and camera
    plate: MovedPlate
    was: RigReference
    notes: tuple[str, ...] = ()  # what could not be compared or was refused
    test: HeldOut | None = None  # predictions of a further record
    imbalance: Imbalance = BALANCED  # of the ball

    @property
    def verdict(self) -> str:
        """nothing_missing, effect_found, ambiguous or unknown_effect."""
        if self.unknown is not None:
            return "unknown_effect"
        if not self.effects:
            return "nothing_missing"
        return "ambiguous" if self.alike else "effect_found"

    @property
    def before(self) -> dict[str, float]:
        """Errors of roll-outs on held-out halves without what was found, as `after` with it."""
        return self.held.errors("before")

    @property
    def after(self) -> dict[str, float]:
        """See `before`."""
        return self.held.errors("after") if self.effects or self.unknown is not None else self.before

    @property
    def zero(self) -> dict[str, float]:
        """By how much the tilt at zero command moved, as the tilt sensor shows it, rad, by axis; {} if it did not."""
        return moved_zero(self.plate.stage, self.was.stage)

    def sentences(self) -> list[str]:
        """What was found, and what to do."""
        return [sentence(self), *advice(self)]

    def document(self) -> dict[str, Any]:
        """The document of `diagnose --json`. Every effect has the errors of all effects together, at the samples ahead
        that decide."""
        before, after = self.before, self.after
        decides = f"rollout{self.held.ahead}"
        errors = {"before": before[decides], "after": after[decides]}
        numbers = sorted({int(ring) for effect in self.effects for ring in effect["rings"]})
        further = [] if self.test is None else [(which, self.test.errors(which)) for which in errors]
        test = {"test": {which: {"nrmse": None, **values} for which, values in further}} if further else {}
        return {
            "verdict": self.verdict, "sentence": sentence(self),
            "effects": [effect | errors for effect in self.effects],
            "ambiguous_with": [list(g) for g in self.alike],
            "unknown": None if self.unknown is None else self.unknown.document(),
            "before": {"nrmse": None, **before}, "after": {"nrmse": None, **after}, "noise_floor": None,
            "held_out": HELD_OUT, "remaining": round(self.remaining, 3), "advice": advice(self),
            "fits": {"reference": round(self.was.remaining, 3) or None, "record": round(self.remaining, 3)},
            "tried": self._tried(), "reference": self.was.source, "notes": list(self.notes), **test,
            "rings": {str(ring): self._in_ring(str(ring)) for ring in numbers},
        }  # fmt: skip

    def _tried(self) -> list[dict[str, Any]]:
        """What was looked for and not taken, the largest gain of -2 log L first."""
        names = {effect["name"] for effect in self.effects}
        names |= {"tilt_gain"} if "servo_gain" in names else set()  # as the ball sees it where nobody measures the tilt
        found = ((one.candidate, (one.gain, NOT_PREDICTING)) for one in self.searched.found)
        every = {**{c: one for c, one in found if c.effect not in names}, **self.searched.tried}
        known = "" if self.unknown is None else self.unknown.description
        tried = [(c.effect or c.words, *one) for c, one in every.items() if c.effect or c.words not in known]
        tried.sort(key=lambda one: -one[1])
        return [{"name": name, "gain": round(gain, 1), "why_not": why_not} for name, gain, why_not in tried]

    @property
    def misfit(self) -> str:
        """Which kind of thing the model lacks, if it does not fit the rig even when the model was right; else empty."""
        words, ball = ["a servo of another kind"] if self.was.stage.times_noise > FITS else [], self.was.body.model.ball
        words += [kind_of_ball(ball.inertia <= SLIDES, ball.wall)] if self.was.remaining > FITS else []
        return " and ".join(words)

    def _in_ring(self, ring: str) -> dict[str, Any]:
        """The verdict on all rings, with the sizes of the effects in one ring."""
        here = []
        for effect in self.effects:
            if ring in effect["rings"]:
                there, parameters = effect["rings"][ring]["after"], effect["parameters"]
                numbers = {key: {**parameters[key], "value": value} for key, value in there.items()}
                here.append({"name": effect["name"], "parameters": numbers})
        return {"verdict": self.verdict, "effects": here}


def verdict_on(
    table: Table, maze: Maze, was: RigReference, tell: Callable[[str], None] = lambda text: None,
    test: Table | None = None, own: Sequence[Effect] = (),
) -> RigVerdict:  # fmt: skip
    """What differs from a reference. Raises TableError.

    was: the reference
    tell: reports progress
    test: a further record, for errors before and after
    own: effects of a user, to look for as well"""
    own, refused = _for_a_rigid_body(own)
    was = replace(was, body=replace(was.body, misfit=max(was.remaining, 1.0)))
    tell("stage")
    plate, was = moved_plate(table, maze, was)
    plate, known, searched = _searched(plate, was, maze, tell, own)
    was = replace(was, body=replace(known, start=was.body.start))
    tell("held-out part")
    old = plate.measured  # the old model does not know of another scale of the sensor or of unseen play
    if plate.sensor is None and plate.unseen is None:
        old = as_it_was(table, maze, was, plate.stage, plate.body)
    held = held_out(plate.body, old, was.body.start or was.body.model, searched, maze)
    found = _predicting(searched, held)
    radii = _radii(maze, searched.fit.filtered)
    staged = of_the_stage(plate, was, radii, found)
    ball, alike = of_the_ball(plate, was, searched, found, radii)
    effects = with_asymmetry([*staged, *ball]) + of_open_numbers(plate.body, searched, was, radii)
    effects = [with_plan(effect) for effect in effects]
    for e in effects:
        if e["name"] == "friction_drift":
            e["until_s"] = round(seconds_of(plate.body), 3)
    memory, remaining = residual_summary(plate.body, searched.fit)
    unknown = _unknown(searched, found, memory, remaining, was)
    if unknown is None and not effects and not plate.overtaxed:
        unknown = _worse_than_before(held, was)
    # overtaxed servos: the measured tilt moves the plate, so roll-outs of the ball cannot judge the stage
    by_tilt = staged if plate.overtaxed else []
    judged = [e for e in effects if e["name"] not in {e["name"] for e in by_tilt}]
    if judged and not held.better:
        names = ", ".join(plain(e["name"]) for e in judged)
        looks = f"it looks like {names}, but predicts the ball no better"
        if all(small(e) for e in judged):
            refused.append(looks)
        else:
            unknown = Unknown(looks, ("tilt",))
        effects, alike, found = [e for e in effects if e not in judged], [], ()
    effects += by_zero(plate, was, effects, radii)
    unknown = _with_servos(unknown, plate, was)
    if effects and not found:  # effects of the stage alone stand: a new model is without the candidates
        searched = replace(searched, fit=searched.without)
        memory, remaining = residual_summary(plate.body, searched.fit)
    before, now = (1e3 * value_of(model, "noise") for model in (was.body.model, searched.fit.model))
    if now > LOUDER * before:
        refused.append(f"the noise of the camera grew from {before:.2g} to {now:.2g} mm")
    notes = (*notes_on(plate, was), *refused)
    done = RigVerdict(tuple(effects), tuple(alike), unknown, held, memory, remaining, searched, plate, was, notes)
    done = _with_imbalance(done, radii)
    return done if test is None else replace(done, test=_on_test(test, maze, done))


def _searched(
    plate: MovedPlate, was: RigReference, maze: Maze, tell: Callable[[str], None], own: Sequence[Effect]
) -> tuple[MovedPlate, Reference, SearchResult]:
    """What differs in ball, table and camera, on the plate that explains it best; and the reference."""
    begun, then = was.body, was.then
    if begun.start is not None:  # a textbook's numbers are far from those of any rig
        begun = replace(begun, start=fit_reference(plate.body, begun.start).model)
    if plate.overtaxed and then is not None and was.table is not None:  # as in this record, the measured tilt moves it
        then = filter_on_stage(was.table, maze, None, then)
    # without a tilt sensor, another ball looks like another gain of both servos, which nobody sees
    without = ("rolling_inertia",) if plate.blind else ()
    known, searched = search_against(plate.body, begun, then, maze, tell, own, without)
    if plate.stage is not None and not plate.overtaxed and plate.servo is None and plate.sensor is None:
        searched = one_ball_instead(plate.body, searched, known)
    if plate.stage is None or not (plate.overtaxed or plate.stage.differs):  # the tilt shows no change but of its gain
        unseen = with_unseen_change(plate, searched, known, maze)
        if unseen is not None:
            plate = unseen
            known, searched = search_against(plate.body, begun, then, maze, tell, own, without)
    return plate, known, searched


def _predicting(searched: SearchResult, held: HeldOut) -> tuple[Candidate, ...]:
    """The candidates if they predict held-out parts better, none otherwise.

    Roll-outs through impacts scatter: they refuse what acts at walls only if they are surely worse, so that the gain in
    held-out blocks has to be sure."""
    at_walls = all(CONTACT in c.depends_on for c in searched.candidates)
    sure = held.likelier and (held.z_score > SURELY or not at_walls)
    return searched.candidates if sure and held.ball_effects_not_worse(BETTER if at_walls else 1.0) else ()


def _with_servos(unknown: Unknown | None, plate: MovedPlate, was: RigReference) -> Unknown | None:
    """What is unknown, with what overtaxed servos do that they did not do before."""
    words = servos_look_changed(plate.stage, was.stage) if plate.stage is not None and plate.overtaxed else ()
    if not words:
        return unknown
    look = "Look at the servos and their linkage, or learn the model again from a record of mazeplan collect"
    other = unknown or Unknown()
    return Unknown(other.description, (*other.depends_on, "command"), (*other.look, look), tuple(words))


def _with_imbalance(done: RigVerdict, radii: Mapping[int, float]) -> RigVerdict:
    """The verdict with an unbalanced ball, if nothing else with a name differs.

    Neither predictions nor fit know the imbalance. More than twice the noise has another cause, too."""
    if done.effects or (done.unknown is not None and done.unknown.depends_on):
        return done
    imbalance = unbalanced(done.plate.body, done.searched.without)
    entry = imbalance_entry(imbalance, done.was.imbalance, radii)
    then = done.was.then
    if entry is None or (then is not None and also_in(then, done.was.body.model, imbalance)):
        return replace(done, imbalance=imbalance)
    searched = replace(done.searched, found=(), fit=done.searched.without)
    memory, remaining = residual_summary(done.plate.body, searched.fit)
    return replace(
        done, effects=(with_plan(entry),), unknown=done.unknown if remaining > TWICE else None, searched=searched,
        held=replace(done.held, after=done.held.before, gain=np.zeros_like(done.held.gain)), memory=memory,
        remaining=remaining, imbalance=imbalance,
    )  # fmt: skip


def _worse_than_before(held: HeldOut, was: RigReference) -> Unknown | None:
    """Something without a name, if the ball is predicted much worse than when the model was right, ring by ring."""
    rings = [ring for ring in held.by_ring if was.errors.get(ring)]
    if not rings:
        return None
    now, old = (np.array([held.by_ring[ring] for ring in rings]).T, np.array([was.errors[ring] for ring in rings]))
    worse, stderr = float(np.mean(now[0] / old)), math.sqrt(float(np.sum((now[1] / old) ** 2))) / len(rings)
    if worse < WORSE or worse - SURE * stderr < HEALTHY:
        return None
    what = f"the ball is predicted {worse:.1f} times as badly as when the model was right"
    return Unknown(what, look=("Look at the ball: is it round, clean and evenly heavy?",))


def _for_a_rigid_body(own: Sequence[Effect]) -> tuple[list[Effect], list[str]]:
    """The user's effects that can act on a rigid ball, and notes on the others."""
    good, notes = [], []
    for effect in own:
        try:
            effects_of([effect()])
            plane_functions([effect])
        except ValueError as problem:
            notes.append(f"{effect.name} was not looked for: {problem}")
        else:
            good.append(effect)
    return good, notes


def _on_test(test: Table, maze: Maze, done: RigVerdict) -> HeldOut:
    """Predictions of a further record, by the old model and by the new one."""
    new = filter_on_stage(test, maze, done.plate.moves, record=record_of(test))
    new = new if done.plate.sensor is None else felt(new, done.plate.sensor)
    old = as_it_was(test, maze, done.was, done.plate.stage, new)
    return on_test(old, done.was.body.start or done.was.body.model, new, done.searched.fit.model, maze)


def _radii(maze: Maze, filtered: Filtered) -> dict[int, float]:
    """Track radii (m) of the rings in which the ball was, the ring with most pictures first."""
    r = np.hypot(*filtered.state[np.isfinite(filtered.nu[:, 0]), :2].T)
    rings = [ring for ring in maze.rings if ring.track_radius]
    counts = {ring.number: int(np.sum((r > ring.inner_radius) & (r < ring.outer_radius))) for ring in rings}
    seen = sorted((n for n in counts if counts[n]), key=lambda n: -counts[n])
    return {number: maze.track_radius(number) for number in seen}


def _unknown(
    searched: SearchResult, found: Sequence[Candidate], memory: float, remaining: float, was: RigReference
) -> Unknown | None:
    """Something without a name: a candidate without a name, or innovations that are larger or more correlated than
    before. Otherwise None."""
    nameless = [c for c in found if not c.effect]
    if nameless:
        words = "; ".join(_description(c, searched.fit.model) for c in nameless)
        depends = tuple(sorted({on for c in nameless for on in c.depends_on}))
        return Unknown(words, depends, tuple(c.look for c in nameless if c.look), cause=True)
    alike = memory > max(MEMORY, AS_BEFORE * was.memory) and remaining > LEAST_REMAINS
    if alike or remaining > max(REMAINS, AS_BEFORE * was.remaining):
        return Unknown(f"what remains is {remaining:.1f} times the noise, and is alike from picture to picture")
    return None


def _description(c: Candidate, model: BodyModel) -> str:
    """The description of a candidate without a name, with period and frequency if it swings."""
    names = ("table_swing.frequency",) if c.after == "table_rocking" else c.free
    at = [value_of(model, name) for name in names if name.endswith(".frequency")]
    return f"{c.words}, every {1.0 / at[0]:.2f} s ({at[0]:.3f} Hz)" if at else c.words
