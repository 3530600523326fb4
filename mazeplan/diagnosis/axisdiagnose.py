"""Diagnose a record of a drive axis: which effects a mass under the drive's force lacks; a verdict that can be checked.

The search and every fit see the first 70 % of the samples only; before and after are measured on the rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mazeplan.data.drivelog import DriveLog
from mazeplan.diagnosis.axislibrary import LOAD, axis_anonymous, axis_library
from mazeplan.diagnosis.axisscores import AxisScore, axis_score
from mazeplan.diagnosis.axissystem import scale_of, thinned
from mazeplan.diagnosis.diagnose import SEEN, verdict_of
from mazeplan.diagnosis.evidence import Evidence, evidence_of
from mazeplan.diagnosis.fit import Fit, Likelihood, fit
from mazeplan.diagnosis.library import Candidate
from mazeplan.diagnosis.search import Finding, search
from mazeplan.diagnosis.system import Values
from mazeplan.diagnosis.wording import describe_unknown, what_is_missing
from mazeplan.records import Array

MEMORY = 0.1  # s, over which what is left of the residual may be coloured
CERTAIN = 3.0  # standard errors


@dataclass(frozen=True)
class AxisDiagnosis:
    """What was found. verdict, effects: as in the report's JSON; fitted: what was known to be there and fitted along,
    likewise; before, after: scores on what was held out; test: those on a further record."""

    verdict: str
    effects: tuple[dict[str, Any], ...]
    fitted: tuple[dict[str, Any], ...]
    finding: Finding
    before: AxisScore
    after: AxisScore
    remarks: tuple[str, ...]
    evidence: tuple[Evidence, Evidence]
    apart: tuple[dict[str, str], ...] = ()
    test: tuple[AxisScore, AxisScore] | None = None

    def document(self) -> dict[str, Any]:
        """The JSON of it."""
        unknown = None
        if self.finding.unknown is not None:
            depends = list(self.finding.unknown.candidate.depends_on)
            unknown = {"depends_on": depends, "description": described(self.finding)}
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

    def sentence(self) -> str:
        """The finding in one sentence."""
        before, after = self.before, self.after
        run = f"{before.seconds:.1f} s of free run"
        if self.verdict == "nothing_missing":
            return f"Nothing is missing: force error {before.nrmse:.2%}, {run} {1e3 * before.free_run:.3g} mm off."
        change = (
            f"force error {before.nrmse:.2%} -> {after.nrmse:.2%}, "
            f"{run} {1e3 * before.free_run:.3g} -> {1e3 * after.free_run:.3g} mm off"
        )
        unknown = described(self.finding)
        return what_is_missing(self.verdict, self.effects, self.finding, unknown, change)


def described(finding: Finding) -> str:
    """What an unnamed term looks like, as a force."""
    mass = math.nan if finding.unknown is None else finding.unknown.fit.values.get(LOAD, {}).get("mass", math.nan)
    return describe_unknown(finding, "N", mass)


def diagnose_axis(
    log: DriveLog,
    declared: Values,
    along: Sequence[str] = (),
    *,
    test: DriveLog | None = None,
    progress: Callable[[str], None] | None = None,
) -> AxisDiagnosis:
    """Find what the axis lacks; declared: effects whose values are known; along: effects known to be there, whose
    values are fitted (the mass always, unless it is declared); test: a further record, for scores only."""
    tell = progress or (lambda text: None)
    scale = scale_of(log)
    named = axis_library(scale)
    own = [LOAD, *along] if LOAD not in declared else list(along)
    free = [c for c in named if c.name in own and c.name not in declared]
    library = [*(c for c in named if c not in free), *axis_anonymous(scale)]
    system = thinned(log, declared, scale)
    border = SEEN * system.t[-1]
    likelihood = Likelihood(system, [*library, *free], system.t <= border)
    finding = search(likelihood, library, tell, free=free)
    tell("scores on what was held out")
    base, final = finding.base, finding.final
    wide = coloured(likelihood, final)
    before, after = (axis_score(log, likelihood, found, border) for found in (base, final))
    effects = tuple(
        _lost(log, likelihood, finding, c, border) | _entry(final, c, wide)
        for c in final.candidates
        if c.named and c not in free
    )
    further = None
    if test is not None:
        every = thinned(test, declared, scale)
        whole = Likelihood(every, likelihood.library, np.ones(len(every), dtype=bool))
        further = (axis_score(test, whole, base, 0.0), axis_score(test, whole, final, 0.0))
    fitted = tuple(_entry(final, c, wide) for c in free)
    verdict = verdict_of(finding, effects, named)
    shown = (evidence_of(likelihood, base), evidence_of(likelihood, final))
    remarks = _remarks(final, wide)
    return AxisDiagnosis(verdict, effects, fitted, finding, before, after, remarks, shown, test=further)


def coloured(likelihood: Likelihood, found: Fit) -> float:
    """By what factor standard errors grow because what is left over is not white: sqrt(1 + 2 sum of its correlations
    over MEMORY) (Bartlett, 1946)."""
    e: Array = likelihood.whitened(found.values, found.q)[0]
    e = e - e.mean()
    lags = range(1, round(MEMORY / likelihood.system.dt) + 1)
    total = sum(float(e[lag:] @ e[:-lag]) for lag in lags) / max(float(e @ e), 1e-300)
    return math.sqrt(max(1.0 + 2.0 * total, 1.0))


def _entry(final: Fit, c: Candidate, wide: float) -> dict[str, Any]:
    found, sigma = final.values[c.name], final.stderr[c.name]
    numbers = {
        name: {"value": found[name], "stderr": wide * sigma[name], "unit": spec.unit}
        for name, spec in c.parameters.items()
    }
    return {"name": c.name, "parameters": numbers}


def _lost(log: DriveLog, likelihood: Likelihood, finding: Finding, c: Candidate, border: float) -> dict[str, Any]:
    """Relative force error on what was held out without one effect, all others fitted again, and with it; evidence:
    by how much -2 log L grows without it, penalty taken off."""
    final = finding.final
    rest = [other for other in final.candidates if other is not c]
    without = fit(likelihood, rest, {other.name: final.values[other.name] for other in rest}, final.q)
    before, after = (axis_score(log, likelihood, found, border).nrmse for found in (without, final))
    return {"before": before, "after": after, "evidence": round(finding.worth.get(c.name, math.nan), 1)}


def _remarks(final: Fit, wide: float) -> tuple[str, ...]:
    """What a reader of the numbers should know."""
    out = [f"standard errors are {wide:.2g} times those of a white residual"]
    values = final.values
    if "viscous_friction" in values and "viscous_asymmetry" in values:
        middle, half = values["viscous_friction"]["coefficient"], values["viscous_asymmetry"]["coefficient"]
        out.append(f"viscous friction: {middle + half:.4g} N s/m forwards, {middle - half:.4g} N s/m backwards")
    dry = values.get("dry_friction")
    if dry and abs(dry["asymmetry"]) > CERTAIN * wide * final.stderr["dry_friction"]["asymmetry"]:
        out.append("the asymmetry of dry friction is, while the axis moves, the same as a constant force against it")
    return tuple(out)
