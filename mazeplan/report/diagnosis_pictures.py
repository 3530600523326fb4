"""Pictures of a diagnosis."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mazeplan.palette import COLOURS
from mazeplan.records import Array
from mazeplan.report.diagnosis import LABELS, Document, explained_by
from mazeplan.report.drawing import INK, beside, line, nothing
from mazeplan.report.models import known
from mazeplan.report.page import Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WHEN = {"before": "bad", "after": "good"}
CANDIDATES = 10


def diagnosis_pictures(document: Document, evidence: Document) -> list[Picture]:
    """Those for which there is evidence."""
    count = len(shown_candidates(evidence))
    found = [
        Picture(
            "candidates", "Candidates, each added by itself; and before and after",
            "by how much each candidate lowers -2 log L; the error before and after",
            lambda figure: _first(figure, document, evidence), (9.0, 1.3 + 0.27 * max(count, 6)),
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
    found = {effect["name"] for effect in document.get("effects", [])}
    for i, c in enumerate(shown):
        name = "good" if c["name"] in found else "neutral" if not c.get("named", True) else "real"
        hatch = "" if name == "good" else "...." if c.get("placebo") else "///" if name == "neutral" else ""
        ranks.barh(i, max(c["gain"], 0.0), color=COLOURS[name], hatch=hatch, edgecolor="white", linewidth=0)
        told = f" {max(c['gain'], 0.0):.0f}{', taken' if name == 'good' else ''}"
        ranks.text(max(c["gain"], 0.0), i, told, va="center", fontsize=7.5)
    ranks.set_yticks(range(len(shown)), [_called(c) for c in shown], fontsize=8)
    accept = float(evidence.get("accept", 15.0))
    ranks.set_xscale("symlog", linthresh=accept)
    ranks.xaxis.set_major_formatter("{x:g}")
    ranks.margins(x=0.2)
    ranks.axvline(accept, **line("bad", linewidth=1.0))
    ranks.text(accept, len(shown) - 0.4, " counts from here", fontsize=7.5, va="bottom")
    ranks.set_xlabel("-2 log L falls by, penalty taken off (hatched: no name)")
    _bars(bars, document, evidence)


def _called(candidate: Document) -> str:
    return str(candidate["name"]).replace("_", " ")


def _bars(axes: Axes, document: Document, evidence: Document) -> None:
    name = evidence.get("drawn", "rollout40")
    label = evidence.get("labels", {}).get(name, LABELS.get(name, name))
    values = {when: known(document.get(when, {}).get(name)) for when in WHEN}
    values["noise alone"] = known(document.get("noise_floor"))
    shown = {when: value for when, value in values.items() if np.isfinite(value)}
    if not shown:
        return nothing(axes, "no stretch is long enough")
    for i, (when, value) in enumerate(shown.items()):
        role = WHEN.get(when, "neutral")
        hatch = {"bad": "xxx", "neutral": "...."}.get(role, "")
        axes.bar(i, value, 0.65, color=COLOURS[role], hatch=hatch, edgecolor="white", linewidth=0)
        axes.text(i, value, f"{value:.4f}", ha="center", va="bottom", fontsize=8)
    axes.set_xticks(range(len(shown)), list(shown))
    axes.set_ylabel(label)
    axes.set_title("samples held out")
    axes.margins(y=0.12)
    return None


def _values(part: Document, name: str) -> Array:
    return np.array([known(v) for v in part[name]])


def _residuals(figure: Figure, evidence: Document) -> None:
    panels: Any = figure.subplots(1, 3, sharey=True)
    most = explained_by(evidence)
    words = (*(str(axis) for axis in evidence["axes"][:2]), "time, s")
    for axes, name, label in zip(panels, ("position", "speed", "time"), words, strict=True):
        for when, role in WHEN.items():
            curve = evidence[when][name]
            at, mean, error = (_values(curve, part) for part in ("at", "mean", "stderr"))
            axes.plot(at, mean, **line(role), label=when)
            axes.fill_between(at, mean - 2 * error, mean + 2 * error, color=COLOURS[role], alpha=0.22, lw=0)
        axes.axhline(0.0, color=INK, lw=0.6)
        axes.set_xlabel(_spelled(label))
        axes.grid()
        if name == most:
            axes.set_title("what was found explains most here")
            for side in axes.spines.values():
                side.set(visible=True, linewidth=1.4)
    panels[0].set_ylabel("mean innovation,\nstandard deviations")
    panels[2].annotate("counted against the motion", (0.5, 0.01), xycoords="axes fraction", ha="center", fontsize=7.5)
    panels[2].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))


def _spelled(label: str) -> str:
    return label.replace("_", " ").replace("theta dot", "theta_dot")


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
    spectrum.set_xlabel("frequency, Hz")
    spectrum.set_ylabel("highest power in a band,\nover the mean")
    white = known(evidence["after"]["white"])
    if np.isfinite(white):
        lags.axhspan(-white, white, color="#dddddd", zorder=0, label="white: inside")
    lags.set_xlabel("samples apart")
    lags.set_ylabel("correlation")
    for axes in (spectrum, lags):
        axes.grid(axis="y")
    lags.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
