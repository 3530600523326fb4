"""Diagnose a record of a mechanism: which effects its motion lacks; a verdict that can be checked.

The search and every fit see the first 70 % of the samples only; before and after are measured on the rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mazeplan.data.drivelog import MotionLog
from mazeplan.diagnosis.diagnose import SEEN, verdict_of
from mazeplan.diagnosis.evidence import Evidence, evidence_of
from mazeplan.diagnosis.fit import Fit, Likelihood, fit
from mazeplan.diagnosis.mechanism import Mechanism
from mazeplan.diagnosis.mechanismscores import Course, MechanismScore, course_of, relative_error, score, sized
from mazeplan.diagnosis.mechanismsystem import thinned
from mazeplan.diagnosis.search import Finding, search
from mazeplan.diagnosis.system import Values
from mazeplan.diagnosis.wording import describe_unknown, what_is_missing
from mazeplan.physics.effect import Effect
from mazeplan.records import Array

MEMORY = 0.1  # s, over which what is left of the residual may be coloured
CERTAIN = 3.0  # standard errors


@dataclass(frozen=True)
class MechanismDiagnosis:
    """What was found. verdict, effects: as in the report's JSON; fitted: what was known to be there and fitted along,
    likewise; before, after: scores on what was held out; test: those on a further record."""

    mechanism: Mechanism
    verdict: str
    effects: tuple[dict[str, Any], ...]
    fitted: tuple[dict[str, Any], ...]
    finding: Finding
    before: MechanismScore
    after: MechanismScore
    remarks: tuple[str, ...]
    evidence: tuple[Evidence, Evidence]
    inertia: float
    test: tuple[MechanismScore, MechanismScore] | None = None

    def document(self) -> dict[str, Any]:
        """The JSON of it."""
        unknown = None
        if self.finding.unknown is not None:
            depends = list(self.finding.unknown.candidate.depends_on)
            unknown = {"depends_on": depends, "description": self._described()}
        out = {
            "verdict": self.verdict,
            "sentence": self.sentence(),
            "effects": list(self.effects),
            "fitted": list(self.fitted),
            "ambiguous_with": [list(group) for group in self.finding.alike],
            "unknown": unknown,
            "before": self.before.document(),
            "after": self.after.document(),
            "noise_floor": None,
            "held_out": round(1.0 - SEEN, 3),
            "notes": list(self.remarks),
        }
        if self.test is not None:
            out["test"] = {"before": self.test[0].document(), "after": self.test[1].document()}
        return out

    def _described(self) -> str:
        """What an unnamed term looks like."""
        return describe_unknown(self.finding, self.mechanism.strength, self.inertia)

    def sentence(self) -> str:
        """The finding in one sentence."""
        before, after, (times, unit) = self.before, self.after, self.mechanism.shown
        error, run = f"{self.mechanism.scored} error", f"{before.seconds:.1f} s of free run"
        off = f"{times * before.free_run:.3g}"
        if self.verdict == "nothing_missing":
            return f"Nothing is missing: {error} {before.nrmse:.2%}, {run} {off} {unit} off."
        change = (
            f"{error} {before.nrmse:.2%} -> {after.nrmse:.2%}, {run} {off} -> {times * after.free_run:.3g} {unit} off"
        )
        return what_is_missing(self.verdict, self.effects, self.finding, self._described(), change)


def diagnose_mechanism(
    mechanism: Mechanism,
    log: MotionLog,
    declared: Values,
    along: Sequence[str] = (),
    *,
    test: MotionLog | None = None,
    progress: Callable[[str], None] | None = None,
) -> MechanismDiagnosis:
    """Find what a mechanism lacks; declared: effects whose values are known, of the motion some of them perhaps; along:
    effects known to be there, whose values are fitted (what is not declared of the motion always); test: a further
    record, for scores only."""
    tell = progress or (lambda text: None)
    declared = {mechanism.motion.name: {}, **declared}
    course = course_of(mechanism, log, declared)
    named, nameless, weakest = sized(course)
    motion, *others = named
    open_ = {name: p for name, p in motion.parameters.items() if name not in declared[motion.name]}
    known = [c for c in others if c.name in along and c.name not in declared]
    free = [*([replace(motion, parameters=open_)] if open_ else []), *known]
    names = {c.name for c in free}
    library = [*(c for c in named if c.parameters and c.name not in names), *nameless]
    system = thinned(mechanism, log, declared, weakest)
    border = SEEN * float(system.t[-1])
    likelihood = Likelihood(system, [*named, *nameless], system.t <= border)
    finding = search(likelihood, library, tell, free=free)
    tell("scores on what was held out")
    base, final = finding.base, finding.final
    wide = coloured(likelihood, final)
    before, after = (score(course, likelihood, found, border) for found in (base, final))
    effects = tuple(
        _lost(course, likelihood, finding, c, border) | _entry(final, c, wide)
        for c in final.candidates
        if c.named and c.name not in names
    )
    further = None
    if test is not None:
        there, whole = course_of(mechanism, test, declared), thinned(mechanism, test, declared, weakest)
        every = Likelihood(whole, likelihood.library, np.ones(len(whole), dtype=bool))
        further = (score(there, every, base, 0.0), score(there, every, final, 0.0))
    return MechanismDiagnosis(
        mechanism, verdict_of(finding, effects, named), effects, tuple(_entry(final, c, wide) for c in free), finding,
        before, after, _remarks(final, wide), (evidence_of(likelihood, base), evidence_of(likelihood, final)),
        system.inertia(final.values), further,
    )  # fmt: skip


def coloured(likelihood: Likelihood, found: Fit) -> float:
    """By what factor standard errors grow because what is left over is not white: sqrt(1 + 2 sum of its correlations
    over MEMORY) (Bartlett, 1946)."""
    e: Array = likelihood.whitened(found.values, found.q)[0]
    e = e - e.mean()
    lags = range(1, round(MEMORY / likelihood.system.dt) + 1)
    total = sum(float(e[lag:] @ e[:-lag]) for lag in lags) / max(float(e @ e), 1e-300)
    return math.sqrt(max(1.0 + 2.0 * total, 1.0))


def _entry(final: Fit, c: Effect, wide: float) -> dict[str, Any]:
    found, sigma = final.values[c.name], final.stderr[c.name]
    numbers = {
        name: {"value": found[name], "stderr": wide * sigma[name], "unit": spec.unit}
        for name, spec in c.parameters.items()
    }
    return {"name": c.name, "parameters": numbers}


def _lost(course: Course, likelihood: Likelihood, finding: Finding, c: Effect, border: float) -> dict[str, Any]:
    """Relative error on what was held out without one effect, all others fitted again, and with it; evidence: by how
    much -2 log L grows without it, penalty taken off."""
    final = finding.final
    rest = [other for other in final.candidates if other is not c]
    without = fit(likelihood, rest, {other.name: final.values[other.name] for other in rest}, final.q)
    before, after = (relative_error(course, likelihood, found, border) for found in (without, final))
    return {"before": before, "after": after, "evidence": round(finding.worth.get(c.name, math.nan), 1)}


def _remarks(final: Fit, wide: float) -> tuple[str, ...]:
    """What a reader of the numbers should know."""
    out = [f"standard errors are {wide:.2g} times those of a white residual"]
    values = final.values
    if "viscous_friction" in values and "viscous_asymmetry" in values:
        middle, half = values["viscous_friction"]["coefficient"], values["viscous_asymmetry"]["coefficient"]
        (unit,) = (c.parameters["coefficient"].unit for c in final.candidates if c.name == "viscous_friction")
        out.append(f"viscous friction: {middle + half:.4g} {unit} forwards, {middle - half:.4g} {unit} backwards")
    dry = values.get("dry_friction")
    if dry and abs(dry["asymmetry"]) > CERTAIN * wide * final.stderr["dry_friction"]["asymmetry"]:
        out.append("the asymmetry of dry friction is, while it moves, the same as a constant force against it")
    return tuple(out)
