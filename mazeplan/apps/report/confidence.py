"""How sure models are of roll-outs, from the documents of `compare --json`: bands of 90 %, and how often they hold."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.apps.report.documents import ComparedRing, Comparison, ConfidenceEntry, best_kind, kinds
from mazeplan.apps.report.drawing import KIND_STYLES, legend_beside, line, points
from mazeplan.apps.report.page import PagePicture, PageTable
from mazeplan.apps.report.words import DEG, KINDS, MISSING
from mazeplan.core.palette import COLOURS
from mazeplan.core.records import Array
from mazeplan.learning.rollout import CHECKED
from mazeplan.learning.split import TOO_FEW, enough

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LAST = 40  # samples after which the table compares the errors


def confidence_parts(document: Comparison) -> list[Any]:
    """The table and the picture of a page; empty for a document without bands."""
    shown = {ring: scores for ring, scores in document.items() if scores.confidence}
    if not shown:
        return []
    picture = PagePicture(
        "confidence",
        "How far a roll-out may be off: a window of middle width with its band of 90 %, and how often bands hold",
        "predicted band and measured angle of one window, and share of windows in the band, by ring",
        lambda figure: _draw(figure, shown), (min(12.0, 1.4 + 2.7 * len(shown)), 5.2),
    )  # fmt: skip
    return [_table(shown), picture]


def _table(document: Comparison) -> PageTable:
    columns, rows = kinds(document, "confidence"), []
    for ring, scores in document.items():
        some = next(iter(scores.confidence.values()))
        label = f"ring {ring}: {some.rollouts} roll-outs of {some.windows} window{'' if some.windows == 1 else 's'}"
        rows.append([label, *(_cell(scores, kind) for kind in columns)])
    title = (
        f"After {LAST} samples: mean error and half of its 95 % interval, degrees; below, half the band of 90 %, "
        f"degrees, and how often the measured angle lay in it after {' / '.join(map(str, CHECKED))} samples"
    )
    return PageTable(title, ("", *(KINDS[k] for k in columns)), rows)


def _cell(scores: ComparedRing, kind: str) -> str:
    entry, interval = scores.confidence.get(kind), scores.interval(str(LAST), kind)
    if entry is None:
        return MISSING
    sure = ""
    if interval is not None and not enough(scores.windows, scores.blocks.get("windows")):
        sure = f" ({TOO_FEW})"
    elif interval is not None and np.isfinite(interval).all():
        sure = f" ± {0.5 * DEG * (interval[1] - interval[0]):.1f}"
    width = 0.5 * DEG * (entry.above[LAST] - entry.below[LAST])
    return f"{DEG * scores.rollout[kind][str(LAST)]:.1f}{sure}\n± {width:.1f}; {_share(entry)}"


def _share(entry: ConfidenceEntry) -> str:
    """How often the measured angle lay in the band, as `compare` prints it; TOO_FEW if there are too few windows."""
    if not enough(entry.windows):
        return TOO_FEW
    return " / ".join(f"{100.0 * getattr(entry, f'coverage{n}'):.0f}" for n in CHECKED) + " %"


def _draw(figure: Figure, document: Comparison) -> None:
    panels = figure.subplots(2, len(document), sharex=True, squeeze=False, height_ratios=(3, 2))
    best = best_kind(document)
    for (above, below), (ring, scores) in zip(panels.T, document.items(), strict=True):
        kind = best if best in scores.confidence else list(scores.confidence)[-1]
        _window(above, scores.confidence[kind].window, kind)
        above.set_title(f"ring {ring}: {KINDS.get(kind, kind)}")
        for name, entry in scores.confidence.items():
            if not enough(entry.windows):
                text = f"{TOO_FEW} windows ({entry.windows})"
                below.text(0.5, 0.5, text, ha="center", transform=below.transAxes)
                break
            k, share, style = np.arange(len(entry.coverage)), 100.0 * entry.coverage, KIND_STYLES.get(name, "neutral")
            below.plot(k, share, **line(style), label=KINDS.get(name, name))
            below.plot(k[10::10], share[10::10], **points(style))
        below.axhline(90.0, color=COLOURS["neutral"], lw=0.8)
        below.set_ylim(0.0, 103.0)
        below.set_xlabel("samples rolled out")
        below.grid()
    panels[0, 0].set_ylabel("angle, degrees")
    panels[1, 0].set_ylabel("windows in the band, %")
    for row in panels:
        labelled = [found for found in (panel.get_legend_handles_labels() for panel in row) if found[0]]
        if labelled:  # the last panel may have too few windows
            handles, labels = labelled[-1]
            legend_beside(row[-1], handles=handles, labels=labels)


def _window(axes: Any, window: dict[str, Array], kind: str) -> None:
    """Draw one window: the band, its middle, and the measured angle."""
    k, name = np.arange(len(window["low"])), KIND_STYLES.get(kind, "neutral")
    axes.fill_between(k, DEG * window["low"], DEG * window["high"], color=COLOURS[name], alpha=0.2, lw=0,
                      label="90 % of roll-outs")  # fmt: skip
    axes.plot(k, DEG * window["middle"], **line(name), label="their middle")
    axes.plot(k, DEG * window["measured"], **points("real", markersize=3.0), label="measured")
    axes.grid()
