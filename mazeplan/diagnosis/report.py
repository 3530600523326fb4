"""report.html: the finding in one sentence, then the evidence as pictures."""

from __future__ import annotations

import base64
import html
import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np

from mazeplan.diagnosis.evidence import LAGS, Evidence
from mazeplan.diagnosis.search import Finding

PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title><style>
body {{ font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; color: #222 }}
h1 {{ font-size: 1.3rem }} .first {{ font-size: 1.15rem; border-left: 4px solid #0072b2; padding-left: 1rem }}
table {{ border-collapse: collapse; margin: 1rem 0 }}
td, th {{ border: 1px solid #ccc; padding: .25rem .6rem; text-align: left }}
img {{ max-width: 100% }} .note {{ color: #666 }}
</style></head><body><h1>{title}</h1><p class="first">{sentence}</p>{tables}
<img alt="candidates ranked, and error before and after" src="data:image/png;base64,{image}">
<p class="note">{notes}</p></body></html>
"""


COLOURS = {"before": "#d55e00", "after": "#009e73"}


class Scores(Protocol):
    """Numbers before or after. labels: attribute -> words with its unit; drawn: which is drawn; floor: what noise alone
    would cause of that one, NaN where nobody knows; axes: words for position and speed."""

    labels: ClassVar[dict[str, str]]
    drawn: ClassVar[str]
    axes: ClassVar[tuple[str, str]]

    @property
    def floor(self) -> float:
        """See above."""
        ...


class Diagnosed(Protocol):
    """What a report shows."""

    @property
    def effects(self) -> tuple[dict[str, Any], ...]:
        """As in the JSON."""
        ...

    @property
    def finding(self) -> Finding:
        """What the search returned."""
        ...

    @property
    def before(self) -> Scores:
        """Without what was found."""
        ...

    @property
    def after(self) -> Scores:
        """With what was found."""
        ...

    @property
    def evidence(self) -> tuple[Evidence, Evidence] | None:
        """Residuals before and after."""
        ...

    @property
    def apart(self) -> tuple[dict[str, str], ...]:
        """For each group that cannot be told apart, what would."""
        ...

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a reader of the numbers should know."""
        ...

    def sentence(self) -> str:
        """The finding in one sentence."""
        ...


def write_report(done: Diagnosed, path: Path, title: str, further: Sequence[str] = ()) -> None:
    """Write the page: one file, nothing loaded from elsewhere. further: notes that are not the diagnosis's own."""
    notes = [*done.remarks, *further]
    path.write_text(
        PAGE.format(
            title=html.escape(title),
            sentence=html.escape(done.sentence()),
            tables=_tables(done),
            image=base64.b64encode(_picture(done)).decode(),
            notes="<br>".join(html.escape(note) for note in notes),
        )
    )


def _tables(done: Diagnosed) -> str:
    rows = ["<table><tr><th>on what was held out</th><th>before</th><th>after</th></tr>"]
    for name, label in done.after.labels.items():
        before, after = (f"{getattr(part, name):.4f}" for part in (done.before, done.after))
        rows.append(f"<tr><td>{label}</td><td>{before}</td><td>{after}</td></tr>")
    if math.isfinite(done.after.floor):
        words = f"{done.after.labels[done.after.drawn]}, by noise alone"
        rows.append(f"<tr><td>{words}</td><td></td><td>{done.after.floor:.4f}</td></tr>")
    rows.append("</table>")
    if done.effects:
        rows.append("<table><tr><th>effect</th><th>parameter</th><th>value</th><th>standard error</th></tr>")
        for effect in done.effects:
            for name, p in effect["parameters"].items():
                cells = [effect["name"], name, f"{p['value']:.5g} {p['unit']}", f"{p['stderr']:.2g}"]
                rows.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
        rows.append("</table>")
    for i, group in enumerate(done.finding.alike):
        rows.append(f"<p>Hard to tell apart in this record: {html.escape(', '.join(group))}.{_apart(done, i)}</p>")
    return "".join(rows)


def _apart(done: Diagnosed, i: int) -> str:
    """What would tell a group apart."""
    if i >= len(done.apart):
        return ""
    way = done.apart[i]
    first = f" {way['first'][:1].upper()}{way['first'][1:]}, then:" if way["first"] else ""
    why = way["why"][:1].upper() + way["why"][1:]
    return f" {html.escape(why)}.{html.escape(first)} <code>{html.escape(way['command'])}</code>"


def _picture(done: Diagnosed) -> bytes:
    """Candidates ranked; scores against the noise floor; the residual against what it may depend on."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 6.6), layout="constrained")
    (ranks, bars, white), below = figure.subplots(2, 3)
    trials: list[Any] = [t for t in done.finding.ranked if math.isfinite(t.gain)][:8][::-1]
    colours = ["#0072b2" if t.candidate.named else "#999999" for t in trials]
    ranks.barh(np.arange(len(trials)), [max(t.gain, 0.0) for t in trials], color=colours)
    ranks.set_yticks(np.arange(len(trials)), [t.candidate.name.replace("_", " ") for t in trials])
    ranks.set_xlabel("-2 log L falls by, penalty taken off (grey: no name)")
    ranks.set_xscale("symlog", linthresh=15)
    ranks.axvline(15.0, color="#d55e00", lw=1)
    ranks.set_title("one effect added, each by itself", fontsize=10)
    name = done.after.drawn
    shown = {"before": getattr(done.before, name), "after": getattr(done.after, name), "noise alone": done.after.floor}
    shown = {key: value for key, value in shown.items() if math.isfinite(value)}
    bars.bar(list(shown), list(shown.values()), color=["#d55e00", "#009e73", "#bbbbbb"][: len(shown)])
    for i, value in enumerate(shown.values()):
        bars.text(i, value, f"{value:.4f}", ha="center", va="bottom", fontsize=9)
    bars.set_ylabel(done.after.labels[name])
    bars.margins(y=0.1)
    bars.set_title("rows held out", fontsize=10)
    if done.evidence is not None:
        _correlations(white, done.evidence)
        _residuals(below, done.evidence, done.after.axes)
    out = io.BytesIO()
    figure.savefig(out, dpi=130)
    return out.getvalue()


def _correlations(axes: Any, evidence: tuple[Evidence, Evidence]) -> None:
    """Whiteness of the innovations."""
    lags = np.arange(1, LAGS + 1)
    for part, (label, colour) in zip(evidence, COLOURS.items(), strict=True):
        axes.plot(lags, part.correlations(), ".-", color=colour, label=label, lw=1)
    axes.axhspan(-evidence[1].white, evidence[1].white, color="#dddddd", zorder=0)
    axes.set_xlabel("samples apart")
    axes.set_ylabel("correlation of innovations")
    axes.set_title("white if inside the band", fontsize=10)
    axes.legend(fontsize=8)


def _residuals(panels: Any, evidence: tuple[Evidence, Evidence], words: tuple[str, str]) -> None:
    """The residual against position, speed and, counted against the motion, time."""
    for panel, (label, name) in zip(
        panels, zip((*words, "t, s"), ("position", "speed", "time"), strict=True), strict=True
    ):
        for part, (when, colour) in zip(evidence, COLOURS.items(), strict=True):
            curve = part.against(getattr(part, name), braking=name == "time")
            panel.plot(curve.at, curve.mean, color=colour, label=when, lw=1.2)
            panel.fill_between(
                curve.at, curve.mean - 2 * curve.stderr, curve.mean + 2 * curve.stderr, color=colour, alpha=0.2
            )
        panel.axhline(0.0, color="#888888", lw=0.6)
        panel.set_xlabel(label)
    panels[0].set_ylabel("mean innovation, standard deviations")
    panels[2].set_ylabel("what brakes, standard deviations")
