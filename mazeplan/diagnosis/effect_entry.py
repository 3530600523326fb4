"""Entries of the JSON document for effects that a diagnosis found. All diagnoses build their entries here."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from mazeplan.physics.effect import Effect, Parameter
from mazeplan.physics.registry import EFFECTS

NEAR = 1e-6  # share of its range by which a parameter is at its bound
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


def why_not_planned(name: str) -> str:
    """Why a planner cannot use an effect; empty if it can."""
    return EFFECTS[name].why_not if name in EFFECTS else ""


def with_plan(entry: Entry) -> Entry:
    """The entry, and whether a planner can use the effect."""
    why = why_not_planned(entry["name"])
    return entry | {"planned": not why} | ({"why_not": why} if why else {})


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
