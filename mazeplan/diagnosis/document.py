"""The JSON documents of a diagnosis: entries of effects, their words, and residuals (`evidence.json`, for a report)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from mazeplan.core.records import Array
from mazeplan.physics.effect import Effect, Parameter
from mazeplan.physics.registry import EFFECTS

NEAR = 1e-6  # share of its range by which a parameter is at its bound
BINS = 24  # of a residual
FEWEST = 12  # minimum number of samples in a bin that is shown
Entry = dict[str, Any]  # {"name", "parameters": {parameter: {"value", "stderr", "unit"}}, ...}
Values = dict[str, dict[str, float]]  # effect -> parameter -> value


def effect_entry(
    effect: Effect,
    values: Mapping[str, float],
    stderr: Mapping[str, float | None],
    known_before: Mapping[str, float] | None = None,
    **more: Any,
) -> Entry:
    """The entry of an effect with these values and standard errors.

    known_before: the values in the model; None leaves them out
    more: further keys of the entry"""
    parameters: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        p, error = effect.parameters[name], stderr[name]
        parameters[name] = {"value": value, "stderr": error, "unit": p.unit}
        if not determined(p, value, error):
            parameters[name]["determined"] = False
    before = {} if known_before is None else {"known_before": dict(known_before)}
    return {"name": effect.name, "parameters": parameters, **before, **more}


def determined(parameter: Parameter, value: float, stderr: float | None) -> bool:
    """Whether a record determines a parameter: it is not at its bound, nor as uncertain as its range."""
    low, high = parameter.low, parameter.high
    inside = min(value - low, high - value) > NEAR * (high - low) if math.isfinite(high - low) else True
    return inside and (stderr is None or stderr <= high - low)


def values_of(entry: Mapping[str, Any]) -> dict[str, float]:
    """The values of an entry, by parameter."""
    return {name: number["value"] for name, number in entry["parameters"].items()}


def changed(values: Values, effect: str, parameter: str, number: float) -> Values:
    """The values with one number changed."""
    return {**values, effect: {**values[effect], parameter: number}}


def with_plan(entry: Entry) -> Entry:
    """The entry, and whether a planner can use the effect."""
    why = EFFECTS[entry["name"]].why_not if entry["name"] in EFFECTS else ""
    return entry | {"planned": not why} | ({"why_not": why} if why else {})


def size_words(parameter: Mapping[str, Any]) -> str:
    """A value with its standard error, if known, and its unit, if it has one."""
    error = parameter["stderr"]
    sure = f" +- {error:.2g}" if error is not None and math.isfinite(error) else ""
    unit = "" if parameter["unit"] in ("", "1") else f" {parameter['unit']}"
    return f"{parameter['value']:.4g}{sure}{unit}"


def untold(group: Iterable[str]) -> str:
    """A group of names that a record cannot tell apart, in words."""
    *others, last = group
    return f"cannot tell {', '.join(others)} and {last} apart"


def lacking(verdict: str, names: str, description: str, alike: Sequence[Sequence[str]], change: str) -> str:
    """What a model lacks, in one sentence.

    names: of the found effects, in words; description: of a cause without a name; alike: names that a record cannot
    tell apart; change: of the errors, in words"""
    if verdict == "unknown_effect":
        also = f" besides {names}" if names else ""
        return f"Something is there that has no name{also}: {description}; {change}."
    doubt = f" (this record {'; '.join(map(untold, alike))})" if verdict == "ambiguous" else ""
    return f"The model lacks {names}{doubt}: {change}."


def rounded(value: float, digits: int) -> float | None:
    """A number of a document; None if not finite."""
    return round(float(value), digits) if math.isfinite(value) else None


def residual_means(residual: Array, position: Array, speed: Array, time: Array) -> dict[str, Any]:
    """Means of a residual against three variables (N,). residual: whitened innovations (N,), NaN where there is none"""
    against_motion = -residual * np.sign(speed)
    pairs = {"position": (position, residual), "speed": (speed, residual), "time": (time, against_motion)}
    return {name: _means(*pair) for name, pair in pairs.items()}


def _means(variable: Array, residual: Array) -> dict[str, list[float | None]]:
    """Mean of the residual, in standard deviations, in bins of a variable. All bins have equally many samples."""
    good = np.isfinite(residual) & np.isfinite(variable)
    e, x = residual[good], variable[good]
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, BINS + 1))) if len(x) else np.zeros(1)
    bins = np.digitize(x, edges[1:-1])
    parts = [(x[bins == i], e[bins == i]) for i in range(max(len(edges) - 1, 0))]
    parts = [(at, left) for at, left in parts if len(left) >= FEWEST]
    return {
        "at": [_number(at.mean()) for at, _ in parts],
        "mean": [_number(left.mean()) for _, left in parts],
        "stderr": [_number(left.std() / np.sqrt(len(left))) for _, left in parts],
    }


def _number(value: float) -> float | None:
    return float(f"{float(value):.5g}") if math.isfinite(value) else None
