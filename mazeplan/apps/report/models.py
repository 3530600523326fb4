"""The report of a comparison of kinds of models (`compare --json`)."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.apps.report import words
from mazeplan.apps.report.drawing import KIND_STYLES, legend_beside, line, points
from mazeplan.apps.report.inputs import Input, number, read_as_printed, row
from mazeplan.apps.report.page import PagePicture, PageSection, PageTable
from mazeplan.apps.report.words import DEG, KINDS, MISSING
from mazeplan.core.errors import InputError
from mazeplan.core.palette import COLOURS
from mazeplan.learning.split import TOO_FEW, enough

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SLASH = f"{words.HARD}/{words.HARD}"
Comparison = dict[int, dict[str, Any]]  # {ring: its scores}


def models_section(given: Input) -> PageSection:
    """The section of a page about a comparison. Raises InputError."""
    with read_as_printed(given):
        document = {int(key.removeprefix("ring")): given.document[key] for key in given.document}
        document = dict(sorted(document.items()))
        parts: list[Any] = [_accelerations(document), _rollouts(document)]
        if any(scores.get("bands") for scores in document.values()):
            parts.append(
                PagePicture(
                    "rollouts", "How far roll-outs are off: mean, and from 10 to 90 % of the windows",
                    "absolute error of the angle against the number of samples rolled out, by ring",
                    partial(_rollout_errors, document=document), (min(12.0, 1.4 + 2.7 * len(document)), 3.2),
                )
            )  # fmt: skip
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
        return SLASH.join(words.number(DEG * number(errors[n]), 1) for n in ("20", "40")) if errors else MISSING

    labels = {ring: f"ring {ring}: {s.get('windows')} windows" for ring, s in document.items() if s["rollout"]}
    return _scores_table(
        "Mean absolute error of the angle after 20 / 40 samples, degrees", kinds(document, "rollout"), labels,
        lambda ring, kind: number(document[ring]["rollout"].get(kind, {}).get("40")), text,
    )  # fmt: skip


def _rollout_errors(figure: Figure, document: Comparison) -> None:
    bands = {ring: scores["bands"] for ring, scores in document.items() if scores.get("bands")}
    panels, top = figure.subplots(1, len(bands), sharey=True, squeeze=False)[0], 0.0
    for axes, (ring, by_kind) in zip(panels, bands.items(), strict=True):
        for kind in (kind for kind in kinds(document, "bands") if kind in by_kind):
            mean, low, high = (DEG * row(by_kind[kind][name]) for name in ("mean", "p10", "p90"))
            k, name = np.arange(len(mean)), KIND_STYLES.get(kind, "neutral")
            axes.plot(k, mean, **line(name), label=KINDS.get(kind, kind))
            axes.plot(k[10::10], mean[10::10], **points(name))
            if kind != "npd":  # the errors of npd are too large for the picture
                axes.fill_between(k, low, high, color=COLOURS[name], alpha=0.16, lw=0)
                top = max(top, float(np.nanmax(high)))
        axes.set_title(f"ring {ring}")
        axes.set_xlabel("samples rolled out")
        axes.grid()
    panels[0].set_ylabel("error of the angle, degrees")
    panels[0].set_ylim(0.0, 1.05 * top if top > 0.0 else None)
    legend_beside(panels[-1])
