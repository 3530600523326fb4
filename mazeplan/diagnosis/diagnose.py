"""Diagnose a record of a ball in one ring: stage, camera, ball, one after the other; a verdict that can be checked.

The search and every fit see 70 % of the samples only; before and after are measured on the rest (`holdout`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mazeplan.diagnosis.ambiguity import experiment_for, twins
from mazeplan.diagnosis.candidates import STAGE_ERRORS, ring_library, stage_errors
from mazeplan.diagnosis.evidence import Evidence, evidence_of
from mazeplan.diagnosis.excess import TOO_SELDOM, more_than_noise
from mazeplan.diagnosis.fit import Fit, Likelihood, fit
from mazeplan.diagnosis.geometry import Circle, fit_circle, straightened
from mazeplan.diagnosis.holdout import INNER, SEEN, inner_folds, seen_and_held
from mazeplan.diagnosis.parts import Known, gain_effect, stage_effects
from mazeplan.diagnosis.platemotion import Stage, commanded, fit_stage, plate_motion
from mazeplan.diagnosis.record import Record
from mazeplan.diagnosis.remainder import Remainder, remainder
from mazeplan.diagnosis.ringsystem import RingSystem, Tilt, Values
from mazeplan.diagnosis.scores import Score, matched_target, ring_of, score
from mazeplan.diagnosis.search import Finding, search
from mazeplan.diagnosis.windows import by_windows
from mazeplan.diagnosis.wording import describe_unknown, what_is_missing, with_plan
from mazeplan.physics.effect import STAGE, Effect
from mazeplan.physics.nameless import NAMELESS, PLACEBOS
from mazeplan.physics.openings import Openings, closer_library, finer_library, wall_library
from mazeplan.physics.registry import EFFECTS
from mazeplan.physics.stage import StageModel

OF_THE_STAGE = tuple(name for name, effect in EFFECTS.items() if effect.acts == STAGE)
GAP = 30  # samples; a ball that was away for longer begins anew


@dataclass(frozen=True)
class Diagnosis:
    """What was found. verdict: nothing_missing, effect_found, ambiguous or unknown_effect; effects: as in the report's
    JSON; before, after: scores on the rows held out; stage: fits of both axes, None without commands; evidence:
    residuals before and after; apart: for each group that cannot be told apart, what would."""

    verdict: str
    effects: tuple[dict[str, Any], ...]
    finding: Finding
    circle: Circle | None
    stage: Stage | None
    before: Score
    after: Score
    tilt_source: str
    notes: tuple[str, ...]
    evidence: tuple[Evidence, Evidence]
    apart: tuple[dict[str, str], ...] = ()
    test: tuple[Score, Score] | None = None
    held: str = ""
    share: float = 1.0 - SEEN
    remainder: Remainder | None = None

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a reader of the numbers should know."""
        learned = ()
        if self.remainder is not None:
            learned = (
                f"nRMSE of theta_dd with what is left learned by a Gaussian process, without a name: "
                f"{self.remainder.nrmse:.4f}.",
            )
        scored = f"Scores are of {self.held}, which search and fits did not see."
        return (scored, f"Tilt: {self.tilt_source}.", *learned, *self.notes)

    def document(self) -> dict[str, Any]:
        """The JSON of it."""
        unknown = None
        if self.finding.unknown is not None:
            c = self.finding.unknown.candidate
            unknown = {"depends_on": list(c.depends_on), "description": describe_unknown(self.finding)}
        return {
            "verdict": self.verdict,
            "sentence": self.sentence(),
            "effects": [with_plan(effect) for effect in self.effects],
            "ambiguous_with": [list(group) for group in self.finding.alike],
            "separate_by": list(self.apart),
            "unknown": unknown,
            "before": self.before.document(),
            "after": self.after.document(),
            "noise_floor": round(self.after.floor, 5) if math.isfinite(self.after.floor) else None,
            "held_out": round(self.share, 3),
            "held_out_rows": self.held,
            **({"remainder": self.remainder.document()} if self.remainder is not None else {}),
            "tilt": self.tilt_source,
            "notes": list(self.notes),
            **(
                {"test": {"before": self.test[0].document(), "after": self.test[1].document()}}
                if self.test is not None
                else {}
            ),
        }

    def sentence(self) -> str:
        """The finding in one sentence."""
        before, after = self.before, self.after
        if math.isfinite(before.rollout40):
            change = f"40-step error {before.rollout40:.4f} -> {after.rollout40:.4f} rad"
            if after.rollout40 > before.rollout40:
                change += " where it was held out, which is no better: a longer record would tell more"
            same = f"40-step error {before.rollout40:.4f} rad, noise alone would cause {before.floor:.4f}"
        else:  # no stretch is long enough
            change = f"nRMSE of theta_dd {before.nrmse:.3f} -> {after.nrmse:.3f}"
            same = f"nRMSE of theta_dd {before.nrmse:.3f}; no stretch held out is long enough to look 40 samples ahead"
        if self.verdict == "nothing_missing":
            told, rest = "Nothing is missing", ""
            if not math.isfinite(before.rollout40):
                told = "Nothing was found, which may be the record"
            elif more_than_noise(before.rollout40, before.floor):
                told, rest = "Nothing that is missing was found", f"; {TOO_SELDOM}"
            return f"{told}: {same}{rest}."
        unknown = describe_unknown(self.finding)
        return what_is_missing(self.verdict, self.effects, self.finding, unknown, change)


def _chance(finding: Finding) -> tuple[str, ...]:
    """How placebos did."""
    placebos = [t for t in finding.ranked if t.candidate.placebo]
    if not placebos:
        return ()
    best, rest = max(placebos, key=lambda t: t.gain), [t.gain for t in finding.ranked if not t.candidate.placebo]
    lost = f"{best.candidate.name} explains {max(best.gain, 0.0):.0f} of -2 log L"
    if finding.final.candidates and rest and max(rest) > 0.0:
        lost += f", the best candidate {max(rest):.0f}"
    return (lost,)


def diagnose(
    record: Record,
    radius: float,
    declared: Values,
    *,
    ring: int | None = None,
    gates: Openings | None = None,
    more: Sequence[Effect] = (),
    without: Container[str] = (),
    test: Record | None = None,
    fold: int | None = None,
    known: Known | None = None,
    camera: Sequence[dict[str, Any]] | None = None,
    as_model: Record | None = None,
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Find what the declared effects lack at a track radius (m); ring: its number, for proposals; gates: those of the
    ring by the map, where one is known; more: effects beyond the library's; without: names of effects that are not
    looked for; test: a further record, for scores only; fold: what is held out (`holdout`), where not as usual; known:
    what the model says of the stage, None for what is declared; camera: what was found of it for all rings together
    (`picture`), None where that could not be looked at; as_model: the record as the model's camera has it, for the
    scores before, where that is another one."""
    tell = progress or (lambda text: None)
    rows, held, which = seen_and_held(record, fold)
    share = _share(record, rows, held)
    tell("stage")
    stage, known = fit_stage(record, rows), known or Known(declared, {})
    tilt = plate_motion(record, stage)
    effects = [*stage_effects(stage, known), *(camera or [])]
    circle = fit_circle(record.theta, record.r, rows) if record.r is not None and camera is None else None
    if circle is not None and circle.shifted:
        effects.append(_camera_effect(circle))
    along = [] if stage is None else [stage_errors(stage.directions)]
    library, closely, finer = _libraries(declared, record.r is not None, gates or Openings(), more, without)
    everything = [*library, *closely, *finer, *along]
    whole, (record, (rows, held)) = record, _with_ball(record, rows, held)
    straight = _likelihood(record, tilt, radius, declared, everything, rows, circle)
    gain, either = gain_effect(stage, known, straight)
    if gain is not None:
        effects.append(gain)
        if gain["name"] == "tilt_gain":
            library = [c for c in library if c.name != "tilt_gain"]
            straight = _likelihood(record, tilt, radius, declared | _values_of(gain), everything, rows, circle)
    if record.u is None and matched_target(ring_of(straight)) is not None:
        folds = list(inner_folds(record, rows, range(INNER)))
        finding, judge = by_windows(straight, library, rows, tell, closely, finer, folds)
    else:
        finding, judge = search(straight, library, tell, along=along), straight
    alike = (*finding.alike, *((either,) if either else ()))
    if "rolling_inertia" not in without:
        alike += tuple(twins(finding.final.values, finding.final.stderr))
    finding = replace(finding, alike=alike)
    tell("scores on what was held out")
    effects += [_entry(straight, judge, finding, c, held) for c in finding.final.candidates if c.named]
    own = model_motion(whole, stage, known) if any(e["name"] in OF_THE_STAGE for e in effects) else None
    plain, base, scored = _as_it_was(as_model or whole, own or tilt, radius, declared, everything, own is None, fold)
    done = Diagnosis(
        verdict_of(finding, effects, everything), tuple(effects), finding, circle, stage, scored,
        score(straight, finding.final, held), tilt.source, (*record.notes, *_chance(finding)),
        (evidence_of(plain, base), evidence_of(straight, finding.final)),
        tuple(experiment_for(group, ring) for group in finding.alike), held=which, share=share,
        remainder=_remainder(straight, finding, record, rows, held, tell),
    )  # fmt: skip
    return done if test is None else replace(done, test=_on_test(test, done, straight, plain, base, circle))


def _share(record: Record, rows: np.ndarray, held: np.ndarray) -> float:
    """Share of the samples of the ball that is held out."""
    seen = np.isfinite(record.theta)
    return float((held & seen).sum() / max(((held | rows) & seen).sum(), 1))


def _as_it_was(
    record: Record, tilt: Tilt, radius: float, declared: Values, library: Sequence[Effect], loose: bool,
    fold: int | None,
) -> tuple[Likelihood, Fit, Score]:  # fmt: skip
    """The model as it was, on the record as its own camera has it: likelihood, fit of the noise, and scores. loose:
    whether what the tilt sensor leaves open of the stage is fitted along."""
    rows, held, _ = seen_and_held(record, fold)
    record, (rows, held) = _with_ball(record, rows, held)
    plain = _likelihood(record, tilt, radius, declared, library, rows, None)
    along = [c for c in library if c.acts == STAGE_ERRORS] if loose else []
    base = fit(plain, along, {c.name: dict.fromkeys(c.parameters, 0.0) for c in along})
    return plain, base, score(plain, base, held)


def _libraries(
    declared: Values, measured: bool, gates: Openings, more: Sequence[Effect], without: Container[str]
) -> tuple[list[Effect], list[Effect], list[Effect]]:
    """What is looked for; openings looked at more closely; the same in finer words. measured: whether radii show where
    the camera is."""
    named = [_from_declared(c, declared) for c in ring_library() if not (measured and c.name == "camera_offset")]
    named = [*named, *wall_library(gates), *more]
    plain, closely, finer = (
        [c for c in some if c.name not in without] for some in (named, closer_library(gates), finer_library(gates))
    )
    return [*plain, *NAMELESS, *PLACEBOS], closely, finer


def _values_of(effect: dict[str, Any]) -> Values:
    """An effect of the JSON as values."""
    return {effect["name"]: {name: number["value"] for name, number in effect["parameters"].items()}}


def model_motion(record: Record, stage: Stage | None, known: Known) -> Tilt | None:
    """How the plate would have moved if the model's stage were right, with the offsets of the record's tilt sensor."""
    axes = known.axes()
    if axes is None or stage is None:
        return None
    offsets = (
        replace(axis, offset=found.offset) for axis, found in zip((axes.beta, axes.gamma), stage.axes, strict=True)
    )
    return commanded(record, StageModel(*offsets))


def _on_test(
    test: Record, done: Diagnosis, straight: Likelihood, plain: Likelihood, base: Fit, circle: Circle | None
) -> tuple[Score, Score]:
    """Scores before and after on a further record."""
    moved = plate_motion(test, done.stage)
    test, (every,) = _with_ball(test, np.ones(len(test), dtype=bool))
    declared, radius = plain.system.declared, ring_of(plain).radius
    before = _likelihood(test, moved, radius, declared, straight.library, every, None)
    after = _likelihood(test, moved, radius, straight.system.declared, straight.library, every, circle)
    return score(before, base, every), score(after, done.finding.final, every)


def _remainder(
    likelihood: Likelihood,
    finding: Finding,
    record: Record,
    rows: np.ndarray,
    held: np.ndarray,
    tell: Callable[[str], None],
) -> Remainder | None:
    """What is left, learned without a name, where something is left: an unknown, or blows that the record's own
    accelerations show."""
    if finding.unknown is None and matched_target(ring_of(likelihood)) is None:
        return None
    fits = [finding.final, *([finding.plainer] if finding.plainer is not None else [])]
    return remainder(likelihood, fits, record, rows, held, tell)


def _from_declared(candidate: Effect, declared: Values) -> Effect:
    """The candidate with the declared values as the start of its fits, where it says how large, not where: from far
    below a friction that is known already, the first linear look at it says nothing."""
    had = declared.get(candidate.name)
    if had is None or candidate.places or not any(had.values()):
        return candidate
    return replace(candidate, starts=(tuple(had[name] for name in candidate.parameters),))


def _with_ball(record: Record, *masks: np.ndarray) -> tuple[Record, tuple[np.ndarray, ...]]:
    """The record without the stretches in which the ball is elsewhere, and what is left of masks (N,): they would only
    take time. Gaps of a few samples stay."""
    gone = ~np.isfinite(record.theta)
    edges = np.flatnonzero(np.diff(np.r_[False, gone, False].astype(np.int8)))
    keep, first = np.ones(len(record), dtype=bool), record.first.copy()
    for a, b in zip(edges[::2], edges[1::2], strict=True):
        if b - a > GAP or first[a : b + 1].any():
            keep[a:b] = False
            if b < len(record):
                first[b] = True
    parts = {name: getattr(record, name)[keep] for name in ("t", "theta", "beta", "gamma", "segment")}
    r, u, own = (None if part is None else part[keep] for part in (record.r, record.u, record.theta_ddot))
    kept = replace(record, first=first[keep], r=r, u=u, theta_ddot=own, **parts)
    return kept, tuple(mask[keep] for mask in masks)


def _likelihood(
    record: Record,
    tilt: Tilt,
    radius: float,
    declared: Values,
    library: Sequence[Effect],
    rows: np.ndarray,
    circle: Circle | None,
) -> Likelihood:
    """On a record, its angles straightened where the camera was found to be off."""
    theta = record.theta
    if circle is not None and circle.shifted and record.r is not None:
        theta = straightened(theta, record.r, circle.offset)

    system = RingSystem(record.t, theta, record.first, radius, tilt, declared)
    system.target = record.theta_ddot
    return Likelihood(system, library, rows)


def _camera_effect(circle: Circle) -> dict[str, Any]:
    return {
        "name": "camera_offset",
        "parameters": {
            name: {"value": round(circle.offset[i], 6), "stderr": round(circle.stderr[i + 1], 6), "unit": "m"}
            for i, name in enumerate(("x", "y"))
        },
        "evidence": round(circle.evidence, 1),
        "before": round(circle.before, 6),
        "after": round(circle.after, 6),
    }


def _entry(likelihood: Likelihood, judge: Likelihood, finding: Finding, c: Effect, rows: np.ndarray) -> dict[str, Any]:
    """An effect for the JSON: sizes, evidence, 40-step error (rad) on some rows without it, all others fitted again (by
    `judge`), and with it."""
    final = finding.final
    rest = [other for other in final.candidates if other is not c]
    without = fit(judge, rest, {other.name: final.values[other.name] for other in rest}, final.q)
    before, after = (score(likelihood, found, rows).document()["rollout40"] for found in (without, final))
    return {
        "name": c.name,
        "parameters": {
            p: {"value": final.values[c.name][p], "stderr": final.stderr[c.name][p], "unit": spec.unit}
            for p, spec in c.parameters.items()
        },
        "evidence": round(finding.worth.get(c.name, math.nan), 1),
        "before": before,
        "after": after,
        **({"until_s": round(float(ring_of(likelihood).t[-1]), 3)} if c.name == "friction_drift" else {}),
    }


def verdict_of(finding: Finding, effects: Sequence[dict[str, Any]], library: Sequence[Effect]) -> str:
    """In a word. Of two effects that explain as well, the one with fewer parameters is taken; where none has fewer, the
    record cannot tell them apart."""
    if finding.unknown is not None:
        return "unknown_effect"
    counts = {c.name: len(c.parameters) for c in (*EFFECTS.values(), *library)}
    for chosen, *others in finding.alike:
        if any(counts[name] <= counts[chosen] for name in others):
            return "ambiguous"
    return "effect_found" if effects else "nothing_missing"


def model_error(record: Record, radius: float, declared: Values, motion: Tilt | None) -> Score:
    """How far a model is off on the rows of a record that search and fits of `diagnose` do not see; only the noise of
    the record is fitted. motion: of the plate by the model's own stage, None for that of the tilt sensor."""
    rows, held, _ = seen_and_held(record)
    tilt = motion or plate_motion(record, None)
    record, (rows, held) = _with_ball(record, rows, held)
    likelihood = _likelihood(record, tilt, radius, declared, ring_library(), rows, None)
    return score(likelihood, fit(likelihood, [], {}), held)
