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
from mazeplan.diagnosis.anonymous import anonymous_library, placebos
from mazeplan.diagnosis.evidence import Evidence, evidence_of
from mazeplan.diagnosis.excess import TOO_SELDOM, more_than_noise
from mazeplan.diagnosis.fit import Likelihood, fit
from mazeplan.diagnosis.gears import SMALLEST as SMALLEST_PLAY
from mazeplan.diagnosis.gears import SMALLEST_BAND
from mazeplan.diagnosis.geometry import Circle, fit_circle, straightened
from mazeplan.diagnosis.holdout import INNER, SEEN, inner_folds, seen_and_held
from mazeplan.diagnosis.library import (
    CAMERA,
    Candidate,
    Gates,
    closer_library,
    finer_library,
    ring_library,
    stage_errors,
    wall_library,
)
from mazeplan.diagnosis.platemotion import Stage, fit_stage, plate_motion
from mazeplan.diagnosis.record import Record
from mazeplan.diagnosis.remainder import Remainder, remainder
from mazeplan.diagnosis.ringsystem import RingSystem, Tilt, Values
from mazeplan.diagnosis.scores import Score, matched_target, ring_of, score
from mazeplan.diagnosis.search import Finding, search
from mazeplan.diagnosis.windows import by_windows
from mazeplan.diagnosis.wording import describe_unknown, what_is_missing

GAP = 30  # samples; a ball that was away for longer begins anew
DELAY = 0.005  # s; a command delay worth a word


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
            "effects": list(self.effects),
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
    gates: Gates | None = None,
    more: Sequence[Candidate] = (),
    without: Container[str] = (),
    test: Record | None = None,
    fold: int | None = None,
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Find what the declared effects lack at a track radius (m); ring: its number, for proposals; gates: those of the
    ring by the map, where one is known; more: effects beyond the library's; without: names of effects that are not
    looked for; test: a further record, for scores only; fold: what is held out (`holdout`), where not as usual."""
    tell = progress or (lambda text: None)
    rows, held, which = seen_and_held(record, fold)
    known = np.isfinite(record.theta)
    share = float((held & known).sum() / max(((held | rows) & known).sum(), 1))
    tell("stage")
    stage = fit_stage(record, rows)
    tilt = plate_motion(record, stage)
    effects: list[dict[str, Any]] = _stage_effects(stage, declared)
    circle = fit_circle(record.theta, record.r, rows) if record.r is not None else None
    if circle is not None and circle.shifted:
        effects.append(_camera_effect(circle))
    named = [_from_declared(c, declared) for c in ring_library() if circle is None or c.acts != CAMERA]
    named = [c for c in (*named, *wall_library(gates or Gates()), *more) if c.name not in without]
    closely = [c for c in closer_library(gates or Gates()) if c.name not in without]
    library = [*named, *anonymous_library(), *placebos()]
    along = [] if stage is None else [stage_errors(stage.directions)]
    finer = [c for c in finer_library(gates or Gates()) if c.name not in without]
    everything = [*library, *closely, *finer, *along]
    record, (rows, held) = _with_ball(record, rows, held)
    plain, straight = (_likelihood(record, tilt, radius, declared, everything, rows, c) for c in (None, circle))
    if record.u is None and matched_target(ring_of(straight)) is not None:
        folds = list(inner_folds(record, rows, range(INNER)))
        finding, judge = by_windows(straight, library, rows, tell, closely, finer, folds)
    else:
        finding, judge = search(straight, library, tell, along=along), straight
    if "rolling_inertia" not in without:
        finding = replace(finding, alike=(*finding.alike, *twins(finding.final.values, finding.final.stderr)))
    tell("scores on what was held out")
    effects += [_entry(straight, judge, finding, c, held) for c in finding.final.candidates if c.named]
    base = fit(plain, along, {c.name: dict.fromkeys(c.parameters, 0.0) for c in along})
    done = Diagnosis(
        verdict_of(finding, effects, everything), tuple(effects), finding, circle, stage, score(plain, base, held),
        score(straight, finding.final, held), tilt.source, (*record.notes, *_chance(finding)),
        (evidence_of(plain, base), evidence_of(straight, finding.final)),
        tuple(experiment_for(group, ring) for group in finding.alike), held=which, share=share,
        remainder=_remainder(straight, finding, record, rows, held, tell),
    )  # fmt: skip
    if test is None:
        return done
    moved = plate_motion(test, stage)
    test, (every,) = _with_ball(test, np.ones(len(test), dtype=bool))
    before, after = (_likelihood(test, moved, radius, declared, straight.library, every, c) for c in (None, circle))
    return replace(done, test=(score(before, base, every), score(after, finding.final, every)))


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


def _from_declared(candidate: Candidate, declared: Values) -> Candidate:
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
    library: Sequence[Candidate],
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


def _stage_effects(stage: Stage | None, declared: Values) -> list[dict[str, Any]]:
    """Delay of commands, play of gears and dead bands, where they are not what was declared."""
    if stage is None:
        return []
    found: list[dict[str, Any]] = []
    late = [(axis.dead_time, axis.stderr.get("dead_time", math.inf)) for axis in stage.axes]
    delay = sum(d for d, _ in late) / 2.0
    sigma = math.hypot(*(s for _, s in late)) / 2.0
    known = declared.get("command_delay", {}).get("delay", 0.0)
    if abs(delay - known) > max(DELAY, 5.0 * sigma):
        entry = {"name": "command_delay", "parameters": {"delay": {"value": delay, "stderr": sigma, "unit": "s"}}}
        found.append(entry)
    axes: dict[str, Any] = dict(zip(("beta", "gamma"), stage.axes, strict=True))
    for effect, smallest in (("backlash", SMALLEST_PLAY), ("deadband", SMALLEST_BAND)):
        sizes: dict[str, float] = {name: getattr(axis, effect) for name, axis in axes.items()}
        had = declared.get(effect, {})
        if all(abs(size - had.get(name, 0.0)) < smallest for name, size in sizes.items()):
            continue
        numbers = {
            name: {"value": size, "stderr": axes[name].stderr.get(effect, 0.0), "unit": "rad"}
            for name, size in sizes.items()
        }
        found.append({"name": effect, "parameters": numbers})
    return found


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


def _entry(
    likelihood: Likelihood, judge: Likelihood, finding: Finding, c: Candidate, rows: np.ndarray
) -> dict[str, Any]:
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
    }


def verdict_of(finding: Finding, effects: Sequence[dict[str, Any]], library: Sequence[Candidate]) -> str:
    """In a word. Of two effects that explain as well, the one with fewer parameters is taken; where none has fewer, the
    record cannot tell them apart."""
    if finding.unknown is not None:
        return "unknown_effect"
    counts = {c.name: len(c.parameters) for c in library}
    for chosen, *others in finding.alike:
        if any(counts[name] <= counts[chosen] for name in others):
            return "ambiguous"
    return "effect_found" if effects else "nothing_missing"


def model_error(record: Record, radius: float, declared: Values, stage: Stage | None) -> Score:
    """How far a model is off on the rows of a record that search and fits of `diagnose` do not see; only the noise of
    the record is fitted, and what the tilt sensor leaves open of the stage (as `fit_stage` has it)."""
    rows, held, _ = seen_and_held(record)
    tilt = plate_motion(record, stage)
    along = [] if stage is None else [stage_errors(stage.directions)]
    record, (rows, held) = _with_ball(record, rows, held)
    likelihood = _likelihood(record, tilt, radius, declared, [*ring_library(), *along], rows, None)
    base = fit(likelihood, along, {c.name: dict.fromkeys(c.parameters, 0.0) for c in along})
    return score(likelihood, base, held)
