"""How sure models are of roll-outs, by the documents of `compare --json`: bands of 90 %, and how often they hold."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.models.enough import TOO_FEW, enough
from mazeplan.models.rollout import CHECKED
from mazeplan.palette import COLOURS
from mazeplan.records import Array
from mazeplan.report.drawing import line, points
from mazeplan.report.models import Document, best_kind, blocks_of, kinds, known, rings
from mazeplan.report.models_pictures import STYLES
from mazeplan.report.page import Picture, Table
from mazeplan.report.words import DEG, KINDS, MISSING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LAST = 40  # samples


def confidence_parts(document: Document) -> list[Any]:
    """Table and picture; nothing where the document does not tell."""
    numbers = [ring for ring in rings(document) if document[f"ring{ring}"].get("confidence")]
    if not numbers:
        return []
    size = (min(12.0, 1.4 + 2.7 * len(numbers)), 5.2)
    return [
        _table(document, numbers),
        Picture(
            "confidence",
            "What a roll-out may be off by: a window of middle width with its band of 90 %, and how often bands hold",
            "predicted band and measured angle of one window, and share of windows in the band, by ring",
            lambda figure: _draw(figure, document, numbers), size,
        ),
    ]  # fmt: skip


def _table(document: Document, numbers: list[int]) -> Table:
    columns, rows = kinds(document, "confidence"), []
    for ring in numbers:
        scores = document[f"ring{ring}"]
        some = next(iter(scores["confidence"].values()))
        of = f"{some['windows']} window{'' if some['windows'] == 1 else 's'}"
        row = [f"ring {ring}: {some['rollouts']} roll-outs of {of}"]
        for kind in columns:
            told = scores["confidence"].get(kind)
            if told is None:
                row.append(MISSING)
                continue
            interval = scores.get("interval95", {}).get(str(LAST), {}).get(kind)
            low, high = (known(v) for v in interval or (None, None))
            give = f" ± {0.5 * DEG * (high - low):.1f}" if math.isfinite(high - low) else ""
            if interval is not None and not enough(scores.get("windows"), blocks_of(scores, "windows")):
                give = f" ({TOO_FEW})"
            width = 0.5 * DEG * (told["above"][LAST] - told["below"][LAST])
            mean = DEG * known(scores["rollout"][kind][str(LAST)])
            row.append(f"{mean:.1f}{give}\n± {width:.1f}; {_share(told)}")
        rows.append(row)
    title = (
        f"After {LAST} samples: mean error and half of its 95 % interval, deg; below, half the band of 90 %, deg, and "
        f"how often the measured angle lay in it after {' / '.join(map(str, CHECKED))} samples"
    )
    return Table(title, ("", *(KINDS[k] for k in columns)), rows)


def _share(told: Document) -> str:
    """How often the measured angle lay in the band, as `compare` prints it, where windows are enough."""
    if not enough(told["windows"]):
        return TOO_FEW
    return " / ".join(f"{100.0 * told[f'coverage{n}']:.0f}" for n in CHECKED) + " %"


def _draw(figure: Figure, document: Document, numbers: list[int]) -> None:
    panels = figure.subplots(2, len(numbers), sharex=True, squeeze=False, height_ratios=(3, 2))
    best = best_kind({f"ring{ring}": document[f"ring{ring}"] for ring in numbers})
    for i, ring in enumerate(numbers):
        told = document[f"ring{ring}"]["confidence"]
        kind = best if best in told else list(told)[-1]
        _window(panels[0, i], told[kind]["window"], kind)
        panels[0, i].set_title(f"ring {ring}: {KINDS.get(kind, kind)}")
        for name, one in told.items():
            if not enough(one["windows"]):
                panels[1, i].text(
                    0.5, 0.5, f"{TOO_FEW} windows ({one['windows']})", ha="center", transform=panels[1, i].transAxes
                )
                break
            k, share = np.arange(len(one["coverage"])), 100.0 * np.array([known(v) for v in one["coverage"]])
            style = STYLES.get(name, "neutral")
            panels[1, i].plot(k, share, **line(style), label=KINDS.get(name, name))
            panels[1, i].plot(k[10::10], share[10::10], **points(style))
        panels[1, i].axhline(90.0, color=COLOURS["neutral"], lw=0.8)
        panels[1, i].set_ylim(0.0, 103.0)
        panels[1, i].set_xlabel("samples rolled out")
        panels[1, i].grid()
    panels[0, 0].set_ylabel("angle, deg")
    panels[1, 0].set_ylabel("windows in the band, %")
    for row in panels:
        labelled = [told for told in (panel.get_legend_handles_labels() for panel in row) if told[0]]
        if labelled:  # the last panel may have too few windows
            row[-1].legend(*labelled[-1], loc="upper left", bbox_to_anchor=(1.0, 1.0))


def _window(axes: Any, window: dict[str, list[float]], kind: str) -> None:
    """Band, middle, and what was measured."""
    low, middle, high, measured = (_degrees(window[name]) for name in ("low", "middle", "high", "measured"))
    k, name = np.arange(len(low)), STYLES.get(kind, "neutral")
    axes.fill_between(k, low, high, color=COLOURS[name], alpha=0.2, lw=0, label="90 % of roll-outs")
    axes.plot(k, middle, **line(name), label="their middle")
    axes.plot(k, measured, **points("real", markersize=3.0), label="measured")
    axes.grid()


def _degrees(values: list[float]) -> Array:
    return DEG * np.array([known(v) for v in values])
