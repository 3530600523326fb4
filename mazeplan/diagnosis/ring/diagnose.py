"""Diagnose a record of a ball in one ring: stage, camera and ball, one after the other.

The search and all fits see 70 % of the samples. The scores before and after use the held-out rest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mazeplan.core.maths.angles import wrap
from mazeplan.core.progress import Words, no_words
from mazeplan.diagnosis.document import (
    Entry,
    Values,
    effect_entry,
    lacking,
    residual_means,
    rounded,
    size_words,
    values_of,
    with_plan,
)
from mazeplan.diagnosis.record import RingRecord, runs
from mazeplan.diagnosis.ring.camera import Offset, fit_circle, true_angle_at_radius
from mazeplan.diagnosis.ring.fit import Fit, Likelihood, best_q, fit, fit_without
from mazeplan.diagnosis.ring.scores import LABELS, RingScore, matched_target, score, seen_and_held
from mazeplan.diagnosis.ring.search import Finding, Search, confounded_effects
from mazeplan.diagnosis.ring.system import STAGE_ERRORS, RingSystem, ring_library, stage_errors
from mazeplan.diagnosis.ring.windows import by_windows
from mazeplan.diagnosis.stage.comparison import DECISIVE, Known, changed_gain, stage_effects
from mazeplan.diagnosis.stage.plate_motion import Stage, Tilt, commanded, fit_stage, plate_motion
from mazeplan.physics.effect import STAGE, Effect
from mazeplan.physics.effects import rig
from mazeplan.physics.effects.nameless import NAMELESS, PLACEBOS
from mazeplan.physics.effects.openings import Openings, closer_library, wall_library
from mazeplan.physics.registry import EFFECTS
from mazeplan.physics.rig.sensors import Camera

OF_THE_STAGE = tuple(name for name, effect in EFFECTS.items() if effect.acts == STAGE)
GAP = 30  # samples; the filter starts again if the ball was not seen for longer
LISTED = 6  # maximum number of amplitudes that a sentence lists one by one


@dataclass(frozen=True, kw_only=True)
class RingDiagnosis:
    """What was found in one ring."""

    verdict: str  # nothing_missing, effect_found, ambiguous or unknown_effect
    effects: tuple[Entry, ...]  # entries of the document
    finding: Finding
    before: RingScore  # on the held-out rows, without what was found
    after: RingScore  # and with it
    share: float  # held-out share of the record
    held: str  # which rows are held out, in words
    evidence: tuple[dict[str, Any], dict[str, Any]]  # residuals before and after (`residual_means`)
    notes: tuple[str, ...]  # anything odd about the record and the fits
    stage: Stage | None  # fits of both axes, None without commands
    tilt_source: str  # where the plate's motion comes from, in words
    test: tuple[RingScore, RingScore] | None = None  # scores before and after on a further record

    def document(self) -> dict[str, Any]:
        """The JSON document."""
        unknown = None
        if self.finding.unknown is not None:
            depends = list(self.finding.unknown.candidate.depends_on)
            unknown = {"depends_on": depends, "description": self._description()}
        out = {
            "verdict": self.verdict, "sentence": self.sentence(), "effects": list(map(with_plan, self.effects)),
            "ambiguous_with": [list(group) for group in self.finding.alike], "unknown": unknown,
            "before": self.before.document(), "after": self.after.document(),
            "noise_floor": rounded(self.after.floor, 5), "held_out": round(self.share, 3), "held_out_rows": self.held,
            "tilt": self.tilt_source, "notes": list(self.notes),
        }  # fmt: skip
        if self.test is not None:
            before, after = self.test
            out["test"] = {"before": before.document(), "after": after.document()}
        return out

    def evidence_document(self, title: str, notes: Sequence[str]) -> dict[str, Any]:
        """What a report draws beside the document (`evidence.json`). notes: those of the document"""
        said = [f"Scores are of {self.held}, which search and fits did not see.", f"Tilt: {self.tilt_source}."]
        return {
            "title": title, "notes": [*said, *notes], "labels": LABELS,
            "axes": ["theta, rad", "theta_dot, rad/s"],
            "candidates": [
                {"name": t.candidate.name, "gain": round(t.gain, 2), "named": t.candidate.named,
                 "placebo": t.candidate.placebo}
                for t in self.finding.ranked if math.isfinite(t.gain)
            ],
            "before": self.evidence[0], "after": self.evidence[1],
        }  # fmt: skip

    def sentence(self) -> str:
        """The finding in one sentence."""
        if self.verdict == "nothing_missing":
            return self.before.nothing_found()
        names, change = ", ".join(map(_words, self.effects)), self.before.both(self.after)
        return lacking(self.verdict, names, self._description(), self.finding.alike, change)

    def _description(self) -> str:
        """What the term without a name looks like, in words; empty if none was found."""
        trial = self.finding.unknown
        if trial is None:
            return ""
        if trial.candidate.name == "oscillation":
            values = trial.fit.values["oscillation"]
            size = math.hypot(values["cos"], values["sin"])
            return f"a force that swings at {values['frequency']:.3f} Hz, {size:.3g} rad/s^2"
        return f"a force that depends on {', '.join(trial.candidate.depends_on)} ({trial.candidate.name})"


def diagnose(
    record: RingRecord, radius: float, declared: Values, *, openings: Openings | None = None,
    more: Sequence[Effect] = (), test: RingRecord | None = None, known: Known | None = None,
    corrected: Camera | None = None, progress: Words = no_words,
) -> RingDiagnosis:  # fmt: skip
    """Find what the declared effects lack.

    radius: of the track, m
    declared: known effects
    openings: openings of the ring in the map, if a map is known
    more: effects to look for beside the library
    test: a further record, for scores only; progress: reports progress
    known: the model's stage; None: the declared one
    corrected: camera by which the positions of `record` are corrected already; None: they are as measured"""
    whole, (rows, held, which) = record, seen_and_held(record)
    seen = np.isfinite(record.theta)
    share = float((held & seen).sum() / max(((held | rows) & seen).sum(), 1))
    progress("stage")
    known, walls = known or Known(declared, {}), openings or Openings()
    stage = fit_stage(record, rows, known.kind)
    tilt = plate_motion(record, stage)
    effects = stage_effects(stage, known)
    circle = None if record.r is None else fit_circle(record.theta, record.r, rows, corrected or Camera())
    offset, entry = circle or (None, None)
    effects += [] if entry is None else [entry]
    nuisance = [] if stage is None else [stage_errors(stage.directions)]
    named = [c for c in ring_library() if record.r is None or c.name != "camera_offset"]  # r shows the offset
    library = [*(_from_declared(c, declared) for c in named), *wall_library(walls), *more, *NAMELESS, *PLACEBOS]
    closely = closer_library(walls)
    everything = [*library, *closely, *nuisance]
    record, (rows, held) = _with_ball(record, rows, held)
    record = _straight(record, offset)
    straight = _likelihood(record, tilt, radius, declared, everything, rows)
    gain, either = _gain_effect(stage, known, straight)
    if gain is not None:
        effects.append(gain)
        if gain["name"] == "tilt_gain":
            library = [c for c in library if c.name != "tilt_gain"]
            straight = _likelihood(record, tilt, radius, declared | {"tilt_gain": values_of(gain)}, everything, rows)
    if record.u is None and matched_target(straight.system) is not None:
        finding, judge = by_windows(straight, library, progress, closely)
    else:
        finding, judge = Search(straight, library, progress, nuisance=nuisance).run(), straight
    final = finding.final
    alike = (*finding.alike, *either, *confounded_effects(final.values, final.stderr))
    finding = replace(finding, alike=alike)
    progress("scores on what was held out")
    effects += [_entry(straight, judge, finding, c, held) for c in final.candidates if c.named]
    own = _model_motion(whole, stage, known) if any(e["name"] in OF_THE_STAGE for e in effects) else None
    plain, base, scored = _as_it_was(whole, own or tilt, radius, declared, everything, own is None)
    done = RingDiagnosis(
        verdict=_verdict(finding, effects, everything), effects=tuple(effects), finding=finding,
        before=scored, after=score(straight, final, held), share=share, held=which, notes=record.notes,
        evidence=(_evidence(plain, base), _evidence(straight, final)), stage=stage, tilt_source=tilt.source,
    )  # fmt: skip
    if test is None:
        return done
    was, moved = None if own is None else _model_motion(test, stage, known), plate_motion(test, stage)
    before = _on_test(test, was or moved, plain, base)
    return replace(done, test=(before, _on_test(test, moved, straight, final, offset)))


def _gain_effect(
    stage: Stage | None, known: Known, likelihood: Likelihood
) -> tuple[Entry | None, tuple[tuple[str, str], ...]]:
    """The cause of a changed gain, servo or tilt sensor, and a pair of names that this record cannot tell apart.

    The likelier scale of the tilt decides. (None, ()) if nothing changed."""
    servo, sensor = changed_gain(stage, known)
    if servo is None or sensor is None:
        return None, ()
    allowed = rig.tilt_gain.parameters
    scale = {axis: min(max(v, allowed[axis].low), allowed[axis].high) for axis, v in values_of(sensor).items()}
    for axis, value in scale.items():
        sensor["parameters"][axis]["value"] = value
    ways: tuple[Values, ...] = ({}, {"tilt_gain": scale})
    by_servo, by_sensor = (likelihood.minus2(values, best_q(likelihood, values)) for values in ways)
    found, other = (servo, sensor) if by_sensor >= by_servo else (sensor, servo)
    return found, ((found["name"], other["name"]),) if abs(by_servo - by_sensor) < DECISIVE else ()


def _model_motion(record: RingRecord, stage: Stage | None, known: Known) -> Tilt | None:
    """The plate's motion by the model's stage, with the offsets of the record's tilt sensor; None if unknown."""
    axes = known.axes()
    if axes is None or stage is None or record.u is None:
        return None
    return commanded(record.t, record.u, stage.offsets_on(axes))


def _straight(record: RingRecord, offset: Offset | None) -> RingRecord:
    """The record with angles about the ring's centre, if the camera is off."""
    if offset is None or record.r is None:
        return record
    return replace(record, theta=true_angle_at_radius(record.theta, record.r, offset))


def _likelihood(
    record: RingRecord, tilt: Tilt, radius: float, declared: Values, library: Sequence[Effect], rows: np.ndarray
) -> Likelihood:
    system = RingSystem(record.t, record.theta, record.begins, radius, tilt, declared, record.theta_ddot)
    return Likelihood(system, library, rows)


def _as_it_was(
    record: RingRecord, tilt: Tilt, radius: float, declared: Values, library: Sequence[Effect], loose: bool
) -> tuple[Likelihood, Fit, RingScore]:
    """Likelihood, fit of the noise and scores of the declared model, on the record with the model's camera.

    loose: whether to fit the errors of the stage as well"""
    rows, held, _ = seen_and_held(record)
    record, (rows, held) = _with_ball(record, rows, held)
    plain = _likelihood(record, tilt, radius, declared, library, rows)
    nuisance = [c for c in library if c.acts == STAGE_ERRORS] if loose else []
    base = fit(plain, nuisance, {c.name: dict.fromkeys(c.parameters, 0.0) for c in nuisance})
    return plain, base, score(plain, base, held)


def _from_declared(candidate: Effect, declared: Values) -> Effect:
    """The candidate, with fits that start at its declared sizes: a linear step from far below them says nothing."""
    had = declared.get(candidate.name)
    if had is None or candidate.places or not any(had.values()):
        return candidate
    return replace(candidate, starts=(tuple(had[name] for name in candidate.parameters),))


def _with_ball(record: RingRecord, *masks: np.ndarray) -> tuple[RingRecord, tuple[np.ndarray, ...]]:
    """The record without the stretches in which the ball is elsewhere, and the masks for the remaining rows.

    Such stretches would only take time. Gaps of up to GAP samples stay. masks: (N,)"""
    keep, begins = np.ones(len(record), dtype=bool), record.begins.copy()
    for a, b in runs(~np.isfinite(record.theta)):
        if b - a > GAP or begins[a : b + 1].any():
            keep[a:b] = False
            if b < len(record):
                begins[b] = True
    return replace(record, begins=begins).part(keep), tuple(mask[keep] for mask in masks)


def _entry(likelihood: Likelihood, judge: Likelihood, finding: Finding, c: Effect, rows: np.ndarray) -> Entry:
    """The effect as an entry of the document, with the 40-step errors (rad) on some rows.

    before: error without this effect; `judge` fits all others again
    after: error with it"""
    final, without = finding.final, fit_without(judge, finding.final, c)
    before, after = (score(likelihood, found, rows).document()["rollout40"] for found in (without, final))
    values = {name: final.values[c.name][name] for name in c.parameters}
    out = effect_entry(c, values, final.stderr[c.name], evidence=round(finding.worth.get(c.name, math.nan), 1))
    out |= {"before": before, "after": after}
    if c.name == "friction_drift":
        out["until_s"] = round(float(likelihood.system.t[-1]), 3)
    return out


def _on_test(test: RingRecord, tilt: Tilt, like: Likelihood, found: Fit, offset: Offset | None = None) -> RingScore:
    """Scores on a further record, of a fit to another likelihood."""
    record, (every,) = _with_ball(test, np.ones(len(test), dtype=bool))
    record, system = _straight(record, offset), like.system
    return score(_likelihood(record, tilt, system.radius, system.declared, like.library, every), found, every)


def _words(effect: Entry) -> str:
    """An effect with its sizes, in words. Many amplitudes appear as their root mean square."""
    parameters = effect["parameters"]
    waves = [p for name, p in parameters.items() if name.startswith(("cos", "sin"))]
    if len(waves) > LISTED:
        rms = math.sqrt(0.5 * sum(p["value"] ** 2 for p in waves))
        numbers = f"{len(waves)} amplitudes, {rms:.2g} {waves[0]['unit']} root mean square"
    else:
        numbers = ", ".join(f"{name} {size_words(p)}" for name, p in parameters.items())
    why = with_plan(effect).get("why_not")
    return f"{effect['name'].replace('_', ' ')} ({numbers}" + (f"; no plan can use it: {why})" if why else ")")


def _verdict(finding: Finding, effects: Sequence[Entry], library: Sequence[Effect]) -> str:
    """The verdict in one word.

    The search prefers the effect with fewer parameters. The verdict is ambiguous if another effect explains the record
    as well without more parameters."""
    if finding.unknown is not None:
        return "unknown_effect"
    counts = {c.name: len(c.parameters) for c in (*EFFECTS.values(), *library)}
    for chosen, *others in finding.alike:
        if any(counts[name] <= counts[chosen] for name in others):
            return "ambiguous"
    return "effect_found" if effects else "nothing_missing"


def _evidence(likelihood: Likelihood, found: Fit) -> dict[str, Any]:
    """The residual of a fit on all rows of its record, the held-out rows included."""
    residual, states = likelihood.everywhere(found.values, found.q)
    time = np.asarray(likelihood.system.dt * np.arange(len(states)), dtype=np.float64)
    return residual_means(np.asarray(residual / max(found.noise, 1e-300)), wrap(states[:, 0]), states[:, 1], time)
