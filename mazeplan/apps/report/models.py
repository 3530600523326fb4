"""The report of a comparison of kinds of models (`compare --json`): the tables of the paper, and what they tell."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from mazeplan.apps.report import words
from mazeplan.apps.report.inputs import Input, number, read_as_printed
from mazeplan.apps.report.page import Note, PageSection, PageTable
from mazeplan.apps.report.words import DEG, KINDS, MISSING
from mazeplan.core.errors import InputError
from mazeplan.learning.split import TOO_FEW, enough

SLASH = f"{words.HARD}/{words.HARD}"
Comparison = dict[int, dict[str, Any]]  # {ring: its scores}


def models_section(given: Input) -> PageSection:
    """The section of a page about a comparison. Raises InputError."""
    with read_as_printed(given):
        document = {int(key.removeprefix("ring")): given.document[key] for key in given.document}
        document = dict(sorted(document.items()))
        parts: list[Any] = [_accelerations(document), _rollouts(document)]
        parts += _of_the_data(document)
        first, facts = next(iter(document.values())), [("rings", ", ".join(map(str, document)))]
        if first.get("rates") is not None:
            facts.append(("rates", str(first["rates"])))
        if first.get("delay_s") is not None:
            facts.append(("ball behind the tilt", f"{first['delay_s']:g} s"))
        return PageSection(f"Models, {given.name}", _lead(document), facts, parts)
    raise InputError("no comparison", file=given.path)


def kinds(document: Comparison, part: str) -> list[str]:
    """Kinds of models that have scores in some ring, in the paper's order. part: the key of the scores"""
    found = {kind for scores in document.values() for kind in scores.get(part) or {}}
    return [kind for kind in KINDS if kind in found] + sorted(found - set(KINDS))


def best_kind(document: Comparison) -> str:
    """The kind with the smallest test nRMSE, as a mean over all rings; empty without scores."""
    means = {
        kind: float(np.mean([number(scores["nrmse_test"].get(kind)) for scores in document.values()]))
        for kind in kinds(document, "nrmse_test")
    }
    finite = {kind: mean for kind, mean in means.items() if math.isfinite(mean)}
    return min(finite, key=lambda kind: finite[kind]) if finite else ""


def _lead(document: Comparison) -> str:
    best = best_kind(document)
    if not best:
        return "No kind of model could be scored."
    scores = [f"{number(s['nrmse_test'].get(best)):.3f} in ring {ring}" for ring, s in document.items()]
    return (
        f"Predicts the acceleration best{'' if len(document) == 1 else ' on average'}: {KINDS.get(best, best)}. "
        f"Relative error on test rows (nRMSE): {', '.join(scores)}."
    )


def _scores_table(
    title: str, columns: list[str], labels: dict[int, str], value: Callable[[int, str], float],
    text: Callable[[int, str], str],
) -> PageTable:  # fmt: skip
    """A table with a row for each ring and a column for each kind. The smallest value of each row is bold.

    labels: {ring: label of its row}.
    value, text: the value of a ring and kind, and its text."""
    rows, strong = [], set()
    for i, (ring, label) in enumerate(labels.items()):
        values = [value(ring, kind) for kind in columns]
        rows.append([label, *(text(ring, kind) for kind in columns)])
        if np.isfinite(values).any():
            strong.add((i, 1 + int(np.nanargmin(values))))
    head = ("", *(words.kind(kind) for kind in columns))
    return PageTable(f"{title}; bold: least", head, rows, frozenset(strong))


def _accelerations(document: Comparison) -> PageTable:
    """The table of errors of the acceleration, as the first table of the paper."""

    def test(ring: int, kind: str) -> float:
        return number(document[ring]["nrmse_test"].get(kind))

    def text(ring: int, kind: str) -> str:
        scores = document[ring]
        train = number(scores["nrmse_train"].get(kind))
        interval = (scores.get("interval95") or {}).get("nrmse_test", {}).get(kind)
        band = ""
        if interval is not None and not enough(blocks=(scores.get("blocks") or {}).get("test")):
            band = f"\n{TOO_FEW}"
        elif interval is not None and None not in interval:
            band = f"\n[{interval[0]:.2f},{words.HARD}{interval[1]:.2f}]"
        return f"{words.number(train, 3)}{SLASH}{words.number(test(ring, kind), 3)}{band}"

    return _scores_table(
        "Relative error of the angular acceleration (nRMSE), train / test, [95 % interval]",
        kinds(document, "nrmse_test"),
        {ring: f"ring {ring}: {s['n_train']} rows, {s['n_test']} to test" for ring, s in document.items()}, test, text,
    )  # fmt: skip


def _rollouts(document: Comparison) -> PageTable:
    """The table of errors of roll-outs, as the second table of the paper."""

    def text(ring: int, kind: str) -> str:
        errors = document[ring]["rollout"].get(kind)
        return SLASH.join(_error(document[ring], kind, n) for n in ("20", "40")) if errors else MISSING

    labels = {ring: f"ring {ring}: {_windows(s)}" for ring, s in document.items() if s["rollout"]}
    title = "Mean absolute error of the angle after 20 / 40 samples, degrees ± half of the 95 % interval"
    return _scores_table(
        title, kinds(document, "rollout"), labels,
        lambda ring, kind: number(document[ring]["rollout"].get(kind, {}).get("40")), text,
    )  # fmt: skip


def _windows(scores: dict[str, Any]) -> str:
    """The number of windows of roll-outs, and whether they are too few for an interval."""
    few = "" if _enough(scores) else f" ({TOO_FEW} for ±)"
    return f"{scores.get('windows')} windows{few}, {scores.get('windows_chosen')}"


def _enough(scores: dict[str, Any]) -> bool:
    """Whether a ring has enough windows, in enough blocks of time, for an interval."""
    return enough(scores.get("windows") or 0, (scores.get("blocks") or {}).get("windows") or 0)


def _error(scores: dict[str, Any], kind: str, steps: str) -> str:
    """A roll-out error in degrees, with half of its 95 % interval, if there is one."""
    low, high = map(number, (scores.get("interval95") or {}).get(steps, {}).get(kind) or (None, None))
    half = f" ± {0.5 * DEG * (high - low):.2f}" if math.isfinite(high - low) and _enough(scores) else ""
    return f"{words.number(DEG * number(scores['rollout'][kind][steps]), 2)}{half}"


def _of_the_data(document: Comparison) -> list[Note]:
    """What the data have of their own: signs of the tilts, and the point about which the camera counts the angle."""
    notes = [
        Note(f"These data count {axis} the other way round (gravity would pull uphill); its sign was changed.")
        for axis in ("beta", "gamma")
        if any((scores.get("signs") or {}).get(axis, 1) < 0 for scores in document.values())
    ]
    centres = {ring: scores.get("centre_m") or (0.0, 0.0) for ring, scores in document.items()}
    off = [f"ring {ring} {1e3 * x:.1f}, {1e3 * y:.1f}" for ring, (x, y) in centres.items() if x or y]
    if off:
        about = "The camera counts the angle about another point than the rings' centre, in mm"
        notes.append(Note(f"{about}: {'; '.join(off)}."))
    return notes
