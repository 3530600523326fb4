"""The result of a diagnosis along one coordinate, as a document and in words: the same for every system."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from mazeplan.diagnosis.coordinate.evidence import Evidence
from mazeplan.diagnosis.coordinate.search import Finding
from mazeplan.diagnosis.effect_entry import Entry, lacking, why_not_planned
from mazeplan.physics.effect import Effect
from mazeplan.physics.registry import EFFECTS

LISTED = 6  # maximum number of amplitudes that a sentence lists one by one
KEYS = (  # of the document, in this order
    "verdict", "sentence", "effects", "fitted", "ambiguous_with", "separate_by", "unknown", "before", "after",
    "noise_floor", "held_out", "held_out_rows", "remainder", "tilt", "notes", "test",
)  # fmt: skip


class Score(ABC):
    """Errors of a model on some rows.

    digits: decimal places in the document"""

    digits: ClassVar[int]
    floor: float  # noise floor of the error by which a reader judges, NaN if unknown

    @property
    @abstractmethod
    def labels(self) -> dict[str, str]:
        """Words with the unit for each error, by its name."""

    @property
    @abstractmethod
    def axes(self) -> tuple[str, str]:
        """Words with the unit for position and speed."""

    @abstractmethod
    def nothing_found(self) -> str:
        """The sentence of a record in which no effect was found."""

    @abstractmethod
    def both(self, after: Any) -> str:
        """These errors and those after the effects were found, in words."""

    def change(self, after: Any) -> str:
        """As `both`, and what follows from these errors."""
        return self.both(after)

    def document(self) -> dict[str, float | None]:
        """The errors, rounded; None if not finite."""
        return {name: rounded(getattr(self, name), self.digits) for name in self.labels}


def rounded(value: float, digits: int = 5) -> float | None:
    """A number of a document; None if not finite."""
    return round(value, digits) if math.isfinite(value) else None


@dataclass(frozen=True, kw_only=True)
class Diagnosis(ABC):
    """What was found.

    verdict: nothing_missing, effect_found, ambiguous or unknown_effect
    effects: entries of the document
    description: words for a term without a name, empty if none was found
    before, after: scores on the held-out rows, without and with what was found
    share: held-out share of the record
    evidence: residuals before and after
    notes: anything odd about the record and the fits
    test: scores before and after on a further record"""

    verdict: str
    effects: tuple[Entry, ...]
    finding: Finding
    description: str
    before: Score
    after: Score
    share: float
    evidence: tuple[Evidence, Evidence]
    notes: tuple[str, ...]
    test: tuple[Score, Score] | None = None

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a reader of the numbers should know."""
        return self.notes

    def document(self) -> dict[str, Any]:
        """The JSON document."""
        unknown = None
        if self.finding.unknown is not None:
            depends = list(self.finding.unknown.candidate.depends_on)
            unknown = {"depends_on": depends, "description": self.description}
        out = {
            "verdict": self.verdict, "sentence": self.sentence(), "effects": list(self.effects),
            "ambiguous_with": [list(group) for group in self.finding.alike], "unknown": unknown,
            "before": self.before.document(), "after": self.after.document(),
            "noise_floor": rounded(self.after.floor), "held_out": round(self.share, 3), "notes": list(self.notes),
        }  # fmt: skip
        if self.test is not None:
            out["test"] = dict(zip(("before", "after"), (score.document() for score in self.test), strict=True))
        out |= self.own_document()
        return {key: out[key] for key in KEYS if key in out}

    @abstractmethod
    def own_document(self) -> dict[str, Any]:
        """Further keys of the document."""

    def evidence_document(self, title: str, notes: Sequence[str] = ()) -> dict[str, Any]:
        """What a report draws beside the document (`evidence.json`). notes: in addition to those of the diagnosis"""
        scores, trials = self.after, [t for t in self.finding.ranked if math.isfinite(t.gain)]
        return {
            "title": title, "notes": [*self.remarks, *notes], "labels": dict(scores.labels),
            "axes": list(scores.axes),
            "candidates": [
                {"name": t.candidate.name, "gain": round(t.gain, 2), "named": t.candidate.named,
                 "placebo": t.candidate.placebo}
                for t in trials
            ],
            **dict(zip(("before", "after"), (part.document() for part in self.evidence), strict=True)),
        }  # fmt: skip

    def sentence(self) -> str:
        """The finding in one sentence."""
        if self.verdict == "nothing_missing":
            return self.before.nothing_found()
        names, change = ", ".join(map(effect_words, self.effects)), self.before.change(self.after)
        return lacking(self.verdict, names, self.description, self.finding.alike, change)


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


def describe_unknown(finding: Finding, unit: str = "rad/s^2", times: float = 1.0) -> str:
    """What a term without a name looks like, in words.

    unit: of a force
    times: force over acceleration"""
    trial = finding.unknown
    if trial is None:
        return ""
    if trial.candidate.name == "oscillation":
        values = trial.fit.values["oscillation"]
        size = times * math.hypot(values["cos"], values["sin"])
        return f"a force that swings at {values['frequency']:.3f} Hz, {size:.3g} {unit}"
    return f"a force that depends on {', '.join(trial.candidate.depends_on)} ({trial.candidate.name})"


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
