"""Diagnose a record of a mechanism: which effects its motion lacks.

The search and all fits see the first 70 % of the samples. The scores before and after use the held-out rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mazeplan.core.records import Array
from mazeplan.diagnosis.coordinate.diagnosis import Diagnosis, describe_unknown, verdict_of
from mazeplan.diagnosis.coordinate.evidence import evidence_of
from mazeplan.diagnosis.coordinate.fit import Fit, Likelihood, fit_without
from mazeplan.diagnosis.coordinate.search import SEEN, search
from mazeplan.diagnosis.coordinate.system import Values
from mazeplan.diagnosis.effect_entry import Entry, effect_entry
from mazeplan.diagnosis.mechanism.drive_log import MotionLog
from mazeplan.diagnosis.mechanism.mechanism import Mechanism
from mazeplan.diagnosis.mechanism.scores import MechanismScore, course_of, relative_error, score, sized
from mazeplan.diagnosis.mechanism.system import thinned
from mazeplan.physics.effect import Effect

MEMORY = 0.1  # s, maximum lag at which the residual is correlated
CERTAIN = 3.0  # standard errors


@dataclass(frozen=True, kw_only=True)
class MechanismDiagnosis(Diagnosis):
    """What was found. fitted: entries of effects that are known to exist and were part of every fit"""

    before: MechanismScore
    after: MechanismScore
    test: tuple[MechanismScore, MechanismScore] | None = None
    fitted: tuple[Entry, ...]

    def own_document(self) -> dict[str, Any]:
        """Keys of the document that other systems do not have."""
        return {"fitted": list(self.fitted)}


def diagnose_mechanism(
    mechanism: Mechanism,
    log: MotionLog,
    declared: Values,
    along: Sequence[str] = (),
    *,
    test: MotionLog | None = None,
    progress: Callable[[str], None] | None = None,
) -> MechanismDiagnosis:
    """Find what a mechanism lacks.

    declared: known effects with values; for the motion, some parameters may be missing
    along: effects that exist and are fitted; undeclared parameters of the motion are fitted, too
    test: a further record, for scores only
    progress: reports progress"""
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
    inflation = stderr_inflation(likelihood, final)
    before, after = (score(course, likelihood, found, border) for found in (base, final))

    def lost(c: Effect) -> Entry:
        """The effect as an entry of the document, with the relative errors on held-out rows without it and with it."""
        fits = (fit_without(likelihood, final, c), final)
        errors = dict(
            zip(("before", "after"), (relative_error(course, likelihood, f, border) for f in fits), strict=True)
        )
        return errors | {"evidence": round(finding.worth.get(c.name, math.nan), 1)} | _entry(final, c, inflation)

    effects = tuple(lost(c) for c in final.candidates if c.named and c.name not in names)
    further = None
    if test is not None:
        there, whole = course_of(mechanism, test, declared), thinned(mechanism, test, declared, weakest)
        every = Likelihood(whole, likelihood.library, np.ones(len(whole), dtype=bool))
        further = (score(there, every, base, 0.0), score(there, every, final, 0.0))
    return MechanismDiagnosis(
        verdict=verdict_of(finding, effects, named), effects=effects, finding=finding, before=before, after=after,
        description=describe_unknown(finding, mechanism.strength, system.inertia(final.values)), share=1.0 - SEEN,
        evidence=(evidence_of(likelihood, base), evidence_of(likelihood, final)), notes=_notes(final, inflation),
        test=further, fitted=tuple(_entry(final, c, inflation) for c in free),
    )  # fmt: skip


def stderr_inflation(likelihood: Likelihood, found: Fit) -> float:
    """Factor by which standard errors grow because the residual is not white: sqrt(1 + 2 sum of its correlations over
    MEMORY) (Bartlett, 1946)."""
    e: Array = likelihood.whitened(found.values, found.q)[0]
    e = e - e.mean()
    lags = range(1, round(MEMORY / likelihood.system.dt) + 1)
    total = sum(float(e[lag:] @ e[:-lag]) for lag in lags) / max(float(e @ e), 1e-300)
    return math.sqrt(max(1.0 + 2.0 * total, 1.0))


def _entry(final: Fit, c: Effect, inflation: float) -> Entry:
    values, sigma = final.values[c.name], final.stderr[c.name]
    return effect_entry(c, {n: values[n] for n in c.parameters}, {n: inflation * sigma[n] for n in c.parameters})


def _notes(final: Fit, inflation: float) -> tuple[str, ...]:
    """What a reader of the numbers should know."""
    out = [f"standard errors are {inflation:.2g} times those of a white residual"]
    values = final.values
    if "viscous_friction" in values and "viscous_asymmetry" in values:
        middle, half = values["viscous_friction"]["coefficient"], values["viscous_asymmetry"]["coefficient"]
        (unit,) = (c.parameters["coefficient"].unit for c in final.candidates if c.name == "viscous_friction")
        out.append(f"viscous friction: {middle + half:.4g} {unit} forwards, {middle - half:.4g} {unit} backwards")
    dry = values.get("dry_friction")
    if dry and abs(dry["asymmetry"]) > CERTAIN * inflation * final.stderr["dry_friction"]["asymmetry"]:
        out.append("the asymmetry of dry friction is, while it moves, the same as a constant force against it")
    return tuple(out)
