"""The result of the diagnosis of one ring, as a document and in words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mazeplan.core.maths.angles import wrap
from mazeplan.diagnosis.effect_entry import Entry, lacking, why_not_planned, with_plan
from mazeplan.diagnosis.evidence import Evidence, both_documents, rounded
from mazeplan.diagnosis.ring.fit import Fit, Likelihood
from mazeplan.diagnosis.ring.scores import LABELS, RingScore
from mazeplan.diagnosis.ring.search import Finding
from mazeplan.diagnosis.stage.plate_motion import Stage
from mazeplan.physics.effect import Effect
from mazeplan.physics.registry import EFFECTS

LISTED = 6  # maximum number of amplitudes that a sentence lists one by one


@dataclass(frozen=True, kw_only=True)
class RingDiagnosis:
    """What was found in one ring.

    verdict: nothing_missing, effect_found, ambiguous or unknown_effect
    effects: entries of the document
    before, after: scores on the held-out rows, without and with what was found
    share: held-out share of the record
    held: which rows are held out, in words
    evidence: residuals before and after
    notes: anything odd about the record and the fits
    stage: fits of both axes, None without commands
    tilt_source: where the plate's motion comes from, in words
    test: scores before and after on a further record"""

    verdict: str
    effects: tuple[Entry, ...]
    finding: Finding
    before: RingScore
    after: RingScore
    share: float
    held: str
    evidence: tuple[Evidence, Evidence]
    notes: tuple[str, ...]
    stage: Stage | None
    tilt_source: str
    test: tuple[RingScore, RingScore] | None = None

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a reader of the numbers should know."""
        said = [f"Scores are of {self.held}, which search and fits did not see.", f"Tilt: {self.tilt_source}."]
        return (*said, *self.notes)

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
            out["test"] = both_documents(self.test)
        return out

    def evidence_document(self, title: str, notes: Sequence[str] = ()) -> dict[str, Any]:
        """What a report draws beside the document (`evidence.json`). notes: in addition to those of the diagnosis"""
        return {
            "title": title, "notes": [*self.remarks, *notes], "labels": LABELS,
            "axes": ["theta, rad", "theta_dot, rad/s"],
            "candidates": [
                {"name": t.candidate.name, "gain": round(t.gain, 2), "named": t.candidate.named,
                 "placebo": t.candidate.placebo}
                for t in self.finding.ranked if math.isfinite(t.gain)
            ],
            **both_documents(self.evidence),
        }  # fmt: skip

    def sentence(self) -> str:
        """The finding in one sentence."""
        if self.verdict == "nothing_missing":
            return self.before.nothing_found()
        names, change = ", ".join(map(effect_words, self.effects)), self.before.both(self.after)
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


def effect_words(effect: Entry) -> str:
    """An effect with its sizes, in words. Many amplitudes appear as their root mean square."""
    parameters = effect["parameters"]
    waves = [p for name, p in parameters.items() if name.startswith(("cos", "sin"))]
    if len(waves) > LISTED:
        rms = math.sqrt(0.5 * sum(p["value"] ** 2 for p in waves))
        numbers = f"{len(waves)} amplitudes, {rms:.2g} {waves[0]['unit']} root mean square"
    else:
        numbers = ", ".join(f"{name} {_size(p)}" for name, p in parameters.items())
    why = why_not_planned(effect["name"])
    return f"{effect['name'].replace('_', ' ')} ({numbers}" + (f"; no plan can use it: {why})" if why else ")")


def _size(parameter: dict[str, Any]) -> str:
    """A value with its standard error, if known, and its unit, if it has one."""
    error, unit = parameter["stderr"], parameter["unit"]
    known = error is not None and math.isfinite(error)
    return f"{parameter['value']:.4g}" + (f" +- {error:.2g}" if known else "") + (f" {unit}" if unit != "1" else "")


def verdict_of(finding: Finding, effects: Sequence[Entry], library: Sequence[Effect]) -> str:
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


def evidence_of(likelihood: Likelihood, found: Fit) -> Evidence:
    """The residual of a fit on all rows of its record, the held-out rows included."""
    residual, states = likelihood.everywhere(found.values, found.q)
    time = np.asarray(likelihood.system.dt * np.arange(len(states)), dtype=np.float64)
    return Evidence(np.asarray(residual / max(found.noise, 1e-300)), wrap(states[:, 0]), states[:, 1].copy(), time)
