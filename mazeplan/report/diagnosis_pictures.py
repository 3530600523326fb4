"""Pictures of a diagnosis."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.palette import COLOURS
from mazeplan.records import Array
from mazeplan.report import words
from mazeplan.report.diagnosis import Document, drawn, explained_by, labels
from mazeplan.report.drawing import INK, beside, line, nothing
from mazeplan.report.models import known
from mazeplan.report.page import Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WHEN = {"before": "bad", "after": "good"}
CANDIDATES = 10
LONG = 34  # characters of a label on a side
LEAST = 1.0  # of a gain that has a bar


def diagnosis_pictures(document: Document, evidence: Document) -> list[Picture]:
    """Those for which there is evidence."""
    count = len(shown_candidates(evidence))
    found = [
        Picture(
            "candidates", "Candidates, each added by itself; and the error before and after",
            "by how much each candidate lowers the misfit; the error before and after",
            lambda figure: _first(figure, document, evidence), (9.4, 1.5 + 0.27 * max(count, 6)),
        )
    ]  # fmt: skip
    if "before" in evidence and "after" in evidence:
        found += [
            Picture(
                "residual", "What is left, against what it may depend on; band: two standard errors",
                "mean residual against position, speed and time, before and after",
                lambda figure: _residuals(figure, evidence), (9.0, 3.2),
            ),
            Picture(
                "spectrum", "Whether what is left is white: its spectrum, and its correlation from sample to sample",
                "power spectrum and autocorrelation of the residual, before and after",
                lambda figure: _white(figure, evidence), (9.0, 3.2),
            ),
        ]  # fmt: skip
    return found


def shown_candidates(evidence: Document) -> list[Document]:
    """The best, and the best placebo among them or behind them."""
    ranked = sorted(evidence["candidates"], key=lambda c: -c["gain"])
    best = ranked[:CANDIDATES]
    placebo = next((c for c in ranked if c.get("placebo")), None)
    return best if placebo is None or placebo in best else [*best, placebo]


def _first(figure: Figure, document: Document, evidence: Document) -> None:
    ranks, bars = beside(figure, (1.9, 1.0))
    shown = shown_candidates(evidence)[::-1]
    if not shown:
        nothing(ranks, "nothing was tried")
    found = {effect["name"]: known(effect.get("evidence")) for effect in document.get("effects", [])}
    accept = float(evidence.get("accept", 15.0))
    top = max([accept, *(c["gain"] for c in shown)])
    for i, c in enumerate(shown):
        gain = max(c["gain"], 0.0)
        name = "good" if c["name"] in found else "neutral" if not c.get("named", True) else "real"
        hatch = "" if name == "good" else "...." if c.get("placebo") else "///" if name == "neutral" else ""
        if gain > LEAST:
            ranks.barh(
                i, gain - LEAST, left=LEAST, color=COLOURS[name], hatch=hatch, edgecolor="white", linewidth=0
            )  # fmt: skip
        told = f" {gain:.0f}"
        if name == "good":
            beside_others = f" beside the others: {found[c['name']]:.0f}" if gain < accept <= found[c["name"]] else ""
            told += f", found{beside_others}"
        ranks.text(max(gain, LEAST), i, told, va="center", fontsize=7.5)
    ranks.set_yticks(range(len(shown)), [words.candidate(str(c["name"])) for c in shown], fontsize=8)
    ranks.set_ylim(-0.7, len(shown) - 0.4)
    _readable_log(ranks, LEAST, 2.5 * top)
    ranks.axvline(accept, **line("bad", linewidth=1.0))
    ranks.text(accept, len(shown) - 0.4, f" {accept:g}: counts from here", fontsize=7.5, va="bottom")
    ranks.set_xlabel(
        "fall of the misfit (-2 log L) with it alone, penalty taken off; log scale\n"
        "hatched: has no name; dotted: placebo"
    )
    _bars(bars, document, evidence)


def _readable_log(axes: Axes, least: float, most: float) -> None:
    """A logarithmic axis with a line and a plain number at 1, 3, 10, 30 ..."""
    axes.set_xscale("log")
    axes.set_xlim(least, most)
    ticks = [m * 10.0**n for n in range(-3, 9) for m in (1.0, 3.0) if least <= m * 10.0**n <= most]
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.grid(axis="x")


def _bars(axes: Axes, document: Document, evidence: Document) -> None:
    name = drawn(evidence)
    label = labels(evidence).get(name, name)
    values = {when: words.labelled(known(document.get(when, {}).get(name)), label) for when in WHEN}
    values["noise alone"] = words.labelled(known(document.get("noise_floor")), label)
    shown = {when: value for when, value in values.items() if np.isfinite(value)}
    if not shown:
        return nothing(axes, "no stretch is long enough")
    for i, (when, value) in enumerate(shown.items()):
        role = WHEN.get(when, "neutral")
        hatch = {"bad": "xxx", "neutral": "...."}.get(role, "")
        axes.bar(i, value, 0.65, color=COLOURS[role], hatch=hatch, edgecolor="white", linewidth=0)
        axes.text(i, value, f"{value:.3g}", ha="center", va="bottom", fontsize=8)
    axes.set_xticks(range(len(shown)), list(shown))
    axes.set_ylabel(_wrapped(words.relabelled(label)))
    axes.set_title("on samples held out")
    axes.margins(y=0.12)
    return None


def _values(part: Document, name: str) -> Array:
    return np.array([known(v) for v in part[name]])


def _residuals(figure: Figure, evidence: Document) -> None:
    from matplotlib.ticker import MultipleLocator

    panels: Any = figure.subplots(1, 3, sharey=True)
    most = explained_by(evidence)
    told = (*(str(axis) for axis in evidence["axes"][:2]), "time, s")
    for axes, name, label in zip(panels, ("position", "speed", "time"), told, strict=True):
        for when, role in WHEN.items():
            curve = evidence[when][name]
            at, mean, error = (_values(curve, part) for part in ("at", "mean", "stderr"))
            at = at * words.labelled(1.0, label)
            axes.plot(at, mean, **line(role), label=when)
            axes.fill_between(at, mean - 2 * error, mean + 2 * error, color=COLOURS[role], alpha=0.22, lw=0)
        axes.axhline(0.0, color=INK, lw=0.6)
        axes.set_xlabel(words.relabelled(label) + ("\n(counted against the motion)" if name == "time" else ""))
        if label == "theta, rad":
            axes.xaxis.set_major_locator(MultipleLocator(90))
        axes.grid()
        if name == most:
            axes.set_title("what was found explains most here")
            for side in axes.spines.values():
                side.set(visible=True, linewidth=1.4)
    panels[0].set_ylabel("mean of what is left,\nin standard deviations")
    panels[2].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))


def _wrapped(text: str) -> str:
    """In two lines where it is long."""
    if len(text) <= LONG:
        return text
    at = text.rfind(" ", 0, LONG)
    return f"{text[:at]}\n{text[at + 1 :]}"


def _white(figure: Figure, evidence: Document) -> None:
    spectrum, lags = beside(figure, (1.7, 1.0))
    for when, role in WHEN.items():
        part = evidence[when]["spectrum"]
        spectrum.plot(_values(part, "hz"), _values(part, "highest"), **line(role, linewidth=1.0), label=when)
        found = evidence[when]["correlations"]
        lags.plot(range(1, len(found) + 1), [known(v) for v in found], **line(role, linewidth=1.2), label=when)
    peak = float(evidence.get("peak", 18.0))
    spectrum.axhline(peak, **line("neutral"))
    spectrum.text(0.99, peak, "seldom by chance above", fontsize=7.5, ha="right", va="bottom",
                  transform=spectrum.get_yaxis_transform())  # fmt: skip
    spectrum.set_yscale("log")
    spectrum.yaxis.set_major_formatter("{x:g}")
    spectrum.margins(x=0.01)
    spectrum.set_xlabel("frequency, Hz")
    spectrum.set_ylabel("highest power in a band,\nmean of all: 1 (log scale)")
    white = known(evidence["after"]["white"])
    if np.isfinite(white):
        lags.axhspan(-white, white, color="#dddddd", zorder=0, label="white: inside")
    lags.set_xlabel("how far apart, samples")
    lags.set_ylabel("correlation, 1: alike")
    for axes in (spectrum, lags):
        axes.grid(axis="y")
    lags.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
