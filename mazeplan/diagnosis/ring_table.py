"""Diagnose a table of a ball in one ring: stage, camera and ball, one after the other.

The search and all fits see 70 % of the samples. The scores before and after use the held-out rest (`held_out`).
"""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mazeplan.diagnosis.ambiguity import confounded_effects, experiment_for
from mazeplan.diagnosis.camera_circle import Circle, fit_circle, true_angle_at_radius
from mazeplan.diagnosis.effect_entry import Entry, Values, values_of, with_plan
from mazeplan.diagnosis.engine import diagnosis as engine
from mazeplan.diagnosis.engine.record import noise_of
from mazeplan.diagnosis.engine.ring import STAGE, from_declared, ring_library, ring_record, ring_system
from mazeplan.diagnosis.engine.ring_scores import RingScore, RingScores
from mazeplan.diagnosis.engine.search import Finding, Search
from mazeplan.diagnosis.engine.sizes import scales
from mazeplan.diagnosis.engine.windows import Fit, Model, Windows
from mazeplan.diagnosis.held_out import seen_and_held
from mazeplan.diagnosis.record import RingRecord, runs
from mazeplan.diagnosis.stage.comparison import DECISIVE, Known, changed_gain, stage_effects
from mazeplan.diagnosis.stage.plate_motion import Stage, Tilt, commanded, fit_stage, plate_motion
from mazeplan.physics.effect import STAGE as ON_STAGE
from mazeplan.physics.effect import Effect
from mazeplan.physics.effects import rig
from mazeplan.physics.effects.openings import Openings, wall_library
from mazeplan.physics.registry import EFFECTS
from mazeplan.physics.rig.sensors import Camera

OF_THE_STAGE = tuple(name for name, effect in EFFECTS.items() if effect.acts == ON_STAGE)
GAP = 30  # samples; stretches in which the ball is elsewhere for longer would only take time
MOST, MANY = 5, 10  # effects; in a record without commands, which is one of a real rig, many act at once


@dataclass(frozen=True, kw_only=True)
class RingDiagnosis(engine.MotionDiagnosis):
    """What was found in one ring. stage: fits of both axes, None without commands"""

    before: RingScore
    after: RingScore
    stage: Stage | None


@dataclass(frozen=True)
class _Ring:
    """What all models of a ring have in common. radius: of the track, m; library: candidates"""

    radius: float
    declared: Values
    library: tuple[Effect, ...]

    @property
    def given(self) -> Values:
        """Declared values, and that of the motion's own parameter."""
        return {rig.axis_misalignment.name: {"angle": 0.0}, **self.declared}

    def model(self, record: RingRecord, tilt: Tilt, rows: np.ndarray | None = None) -> Model:
        """The model of some rows (N,) of a record; None: all of them."""
        system = ring_system(record, self.radius, tilt, self.library, self.given)
        seen = ring_record(record, rows)
        noise = noise_of(seen)
        return Model(system, seen, noise, scales(system, seen, noise))


def diagnose(
    record: RingRecord,
    radius: float,
    declared: Values,
    *,
    ring: int | None = None,
    openings: Openings | None = None,
    more: Sequence[Effect] = (),
    without: Container[str] = (),
    test: RingRecord | None = None,
    known: Known | None = None,
    camera: Sequence[Entry] | None = None,
    as_model: RingRecord | None = None,
    corrected: Camera | None = None,
    test_as_model: RingRecord | None = None,
    progress: Callable[[str], None] | None = None,
) -> RingDiagnosis:
    """Find what the declared effects lack.

    radius: of the track, m
    declared: known effects
    ring: number of the ring, for proposed commands
    openings: openings of the ring in the map, if a map is known
    more: effects to look for beside the library
    without: names of effects to leave out
    test: a further record, for scores only
    known: the model's stage; None: the declared one
    camera: effects of the camera that all rings together show (`maze_camera`); None: look for an offset in this ring
    as_model: the record with the model's camera, for the scores before; None: `record`
    corrected: camera by which the positions of `record` are corrected already; None: they are as measured
    test_as_model: `test` with the model's camera, for its scores before; None: `test`
    progress: reports progress"""
    tell = progress or (lambda text: None)
    rows, held, which = seen_and_held(record)
    seen = np.isfinite(record.theta)
    share = float((held & seen).sum() / max(((held | rows) & seen).sum(), 1))
    tell("stage")
    known = known or Known(declared, {})
    stage = fit_stage(record, rows, known.kind)
    tilt = plate_motion(record, stage)
    effects = [*stage_effects(stage, known), *(camera or [])]
    circle = fit_circle(record.theta, record.r, rows) if record.r is not None and camera is None else None
    if circle is not None and circle.shifted:
        effects.append(circle.entry(corrected or Camera()))
    bead = _Ring(radius, declared, _library(declared, record.r is not None, openings, more, without))
    whole, (record, (rows, held)) = record, _with_ball(record, rows, held)
    record = _straight(record, circle)
    model = bead.model(record, tilt, rows)
    gain, either = _gain_effect(stage, known, bead, model)
    given = dict(bead.given)
    if gain is not None:
        effects.append(gain)
        if gain["name"] == rig.tilt_gain.name:
            given[rig.tilt_gain.name] = values_of(gain)
    fixed = {rig.tilt_gain.name: given[rig.tilt_gain.name]} if gain and gain["name"] == rig.tilt_gain.name else {}
    search = Search(model, fixed, (), tell, {name: v for name, v in given.items() if name not in fixed})
    finding = search.run(MANY if record.u is None else MOST)
    tell("scores on what was held out")
    level = engine.judged_level(search, finding)
    base, final = (engine.whole_fit(search, trial, level) for trial in (finding.base, finding.final))
    final = _with_stage(model, final, tilt)
    alike = (*finding.alike, *((either,) if either else ()))
    if rig.tilt_gain.name in finding.found and "rolling_inertia" not in without:
        errors = {n: {key: final.stderr(n, key) for key in v} for n, v in final.values.items()}
        alike += tuple(confounded_effects({n: final.values[n] for n in finding.found}, errors))
    finding = replace(finding, alike=alike)
    straight = RingScores(bead.model(record, tilt), record, held)
    own = _model_motion(whole, stage, known) if any(e["name"] in OF_THE_STAGE for e in effects) else None
    plain = _as_it_was(bead, as_model or whole, own or tilt)
    before, after = plain.score(bead.given), straight.score(final.values)
    effects += [_entry(search, finding, straight, final, level, name, after) for name in finding.found]
    remaining = finding.final.rms(level)
    verdict = engine.verdict_of(search, finding, remaining, (), effects)
    unknown = engine.unknown_of(search, finding, final, remaining, ()) if verdict == "unknown_effect" else None
    scored = f"Scores are of {which}, which search and fits did not see."
    done = RingDiagnosis(
        verdict=verdict, effects=tuple(with_plan(e) for e in effects), fitted=(), finding=finding, before=before,
        after=after, remaining=remaining, unknown=unknown,
        notes=(scored, f"Tilt: {tilt.source}.", *record.notes, *engine.notes_of(search, finding, final, remaining, ())),
        evidence=(engine.evidence_of(model, base), engine.evidence_of(model, final)), noise_floor=after.floor,
        fits=(base, final), held_out=round(share, 3), stage=stage,
        more={
            "separate_by": [experiment_for(group, ring) for group in alike], "held_out_rows": which,
            "tilt": tilt.source,
        },
    )  # fmt: skip
    if test is None:
        return done
    was = None if own is None else _model_motion(test, stage, known)
    moved = plate_motion(test, stage)
    scores = (
        _as_it_was(bead, test_as_model or test, was or moved, every=True).score(bead.given),
        _as_it_was(bead, _straight(test, circle), moved, every=True).score(final.values),
    )
    return replace(done, test=scores)


def _library(
    declared: Values, measured: bool, openings: Openings | None, more: Sequence[Effect], without: Container[str]
) -> tuple[Effect, ...]:
    """Effects to look for. measured: whether the record has radii, which show the camera's offset"""
    named = [c for c in ring_library() if not (measured and c.name == "camera_offset")]
    named = [*named, *wall_library(openings or Openings()), *more]
    return tuple(from_declared(c, declared) for c in named if c.name not in without)


def _gain_effect(stage: Stage | None, known: Known, bead: _Ring, model: Model) -> tuple[Entry | None, tuple[str, ...]]:
    """The cause of a changed gain, and the names that this record cannot tell apart.

    The cause is the servo or the tilt sensor, None if nothing changed. The likelier scale of the tilt decides."""
    servo, sensor = changed_gain(stage, known)
    if servo is None or sensor is None:
        return None, ()
    allowed = rig.tilt_gain.parameters
    scale = {axis: min(max(v, allowed[axis].low), allowed[axis].high) for axis, v in values_of(sensor).items()}
    for axis, value in scale.items():
        sensor["parameters"][axis]["value"] = value
    (level, *_) = Search(model, {}, (), lambda text: None, bead.given).levels[1:]
    fits = [level.folds[0].held_out({**bead.given, **more}) for more in ({}, {rig.tilt_gain.name: scale})]
    by_servo, by_sensor = (fit.total / min(f.rms() for f in fits) ** 2 for fit in fits)
    found, other = (servo, sensor) if by_sensor >= by_servo else (sensor, servo)
    return found, (found["name"], other["name"]) if abs(by_servo - by_sensor) < DECISIVE else ()


def _with_stage(model: Model, fit: Fit, tilt: Tilt) -> Fit:
    """The fit with the uncertainty of the stage in its standard errors: the ball feels errors of the stage."""
    free = tuple(key for key in fit.free if key not in fit.at_bound)
    if not free or not tilt.by_stage:
        return fit
    rows = fit.windows
    windows = Windows(model, rows)
    values = {**fit.values, STAGE: dict.fromkeys(tilt.by_stage, 0.0)}
    r = windows.residual(values, fit.states)
    by_p, by_s = windows.columns(values, fit.states, r, (*free, *((STAGE, name) for name in tilt.by_stage)))
    (s_p,) = windows.eliminated(by_s, by_p)
    clean = by_p - np.einsum("ks,ksp->kp", by_s, s_p[windows.which])
    shift = np.linalg.lstsq(clean[:, : len(free)], clean[:, len(free) :], rcond=1e-10)[0]
    wide = fit.covariance.copy()
    at = [fit.free.index(key) for key in free]
    wide[np.ix_(at, at)] += shift @ shift.T
    return replace(fit, covariance=wide)


def _entry(
    search: Search, finding: Finding, scores: RingScores, final: Fit, level: int, name: str, after: RingScore
) -> Entry:
    """The effect as an entry of the document, with the 40-step errors (rad) without and with it."""
    rest = tuple(n for n in finding.final.names if n != name)
    without = engine.whole_fit(search, search.trial(rest, finding.final), level)
    entry = engine.found_entry(search, finding, final, name)
    entry |= {"before": engine.rounded(scores.far(without.values), 5), "after": engine.rounded(after.rollout40, 5)}
    if name == "friction_drift":
        entry["until_s"] = round(float(scores.record.t[-1]), 3)
    return entry


def _model_motion(record: RingRecord, stage: Stage | None, known: Known) -> Tilt | None:
    """The plate's motion by the model's stage, with the offsets of the record's tilt sensor; None if unknown."""
    axes = known.axes()
    return None if axes is None or stage is None else commanded(record, stage.offsets_on(axes))


def _straight(record: RingRecord, circle: Circle | None) -> RingRecord:
    """The record with angles about the ring's centre, if the camera is off."""
    if circle is None or not circle.shifted or record.r is None:
        return record
    return replace(record, theta=true_angle_at_radius(record.theta, record.r, circle.offset))


def _as_it_was(bead: _Ring, record: RingRecord, tilt: Tilt, *, every: bool = False) -> RingScores:
    """Scores on a record as it is. every: on all rows"""
    held = np.ones(len(record), dtype=bool) if every else seen_and_held(record)[1]
    record, (held,) = _with_ball(record, held)
    return RingScores(bead.model(record, tilt), record, held)


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
