"""What was found, in words: the same for every system."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from mazeplan.diagnosis.search import Finding
from mazeplan.physics.registry import EFFECTS

LISTED = 6  # amplitudes that a sentence lists


def effect_words(effect: dict[str, Any]) -> str:
    """An effect with its sizes; of many amplitudes only how large they are together."""
    parameters = effect["parameters"]
    waves = [p for name, p in parameters.items() if name.startswith(("cos", "sin"))]
    if len(waves) > LISTED:
        rms = math.sqrt(0.5 * sum(p["value"] ** 2 for p in waves))
        numbers = f"{len(waves)} amplitudes, {rms:.2g} {waves[0]['unit']} root mean square"
    else:
        numbers = ", ".join(f"{name} {_size(p)}" for name, p in parameters.items())
    why = why_not(effect["name"])
    return f"{effect['name'].replace('_', ' ')} ({numbers}" + (f"; no plan can use it: {why})" if why else ")")


def why_not(name: str) -> str:
    """Why a planner cannot use an effect, empty where it can."""
    return EFFECTS[name].why_not if name in EFFECTS else ""


def with_plan(effect: dict[str, Any]) -> dict[str, Any]:
    """An effect of the JSON, and whether a plan can use it."""
    why = why_not(effect["name"])
    return {**effect, "planned": not why, **({"why_not": why} if why else {})}


def _size(parameter: dict[str, Any]) -> str:
    """A value with its standard error, where the record tells one, and its unit, where it has one."""
    error, unit = parameter["stderr"], parameter["unit"]
    known = error is not None and math.isfinite(error)
    return f"{parameter['value']:.4g}" + (f" +- {error:.2g}" if known else "") + (f" {unit}" if unit != "1" else "")


def describe_unknown(finding: Finding, unit: str = "rad/s^2", times: float = 1.0) -> str:
    """What an unnamed term looks like; the size of an oscillation `times` what it is as an acceleration, in `unit`."""
    trial = finding.unknown
    if trial is None:
        return ""
    if trial.candidate.name == "oscillation":
        values = trial.fit.values["oscillation"]
        size = times * math.hypot(values["cos"], values["sin"])
        return f"a force that swings at {values['frequency']:.3f} Hz, {size:.3g} {unit}"
    return f"a force that depends on {', '.join(trial.candidate.depends_on)} ({trial.candidate.name})"


def what_is_missing(
    verdict: str, effects: Sequence[dict[str, Any]], finding: Finding, unknown: str, change: str
) -> str:
    """The sentence where something was found; unknown: its description; change: the error before and after."""
    names = [effect_words(effect) for effect in effects]
    if verdict == "unknown_effect":
        also = f" besides {', '.join(names)}" if names else ""
        return f"Something is there that has no name{also}: {unknown}; {change}."
    tail = ""
    if verdict == "ambiguous":
        tail = " (this record cannot tell " + "; ".join(" from ".join(g) for g in finding.alike) + ")"
    return f"The model lacks {', '.join(names)}{tail}: {change}."
