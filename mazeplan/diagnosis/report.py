"""What a report of a diagnosis shows beside its document: candidates, and residuals against what they may depend on.

Plain data, as a file (evidence.json) beside the document (report.json); mazeplan/report draws it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar, Protocol

import numpy as np

from mazeplan.diagnosis.evidence import Curve, Evidence
from mazeplan.diagnosis.screening import ACCEPT, PEAK
from mazeplan.diagnosis.search import Finding

BANDS = 150  # of the spectrum that are told


class Scores(Protocol):
    """Numbers before or after. labels: attribute -> words with its unit; drawn: which is drawn; floor: what noise alone
    would cause of that one, NaN where nobody knows; axes: words for position and speed."""

    drawn: ClassVar[str]

    @property
    def labels(self) -> dict[str, str]:
        """See above."""
        ...

    @property
    def axes(self) -> tuple[str, str]:
        """See above."""
        ...

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
    def remarks(self) -> tuple[str, ...]:
        """What a reader of the numbers should know."""
        ...

    def sentence(self) -> str:
        """The finding in one sentence."""
        ...


def evidence_document(done: Diagnosed, title: str, notes: Sequence[str] = ()) -> dict[str, Any]:
    """The JSON of what pictures show; notes: beyond the diagnosis's own."""
    scores = done.after
    trials = [t for t in done.finding.ranked if math.isfinite(t.gain)]
    found: dict[str, Any] = {
        "title": title,
        "notes": [*done.remarks, *notes],
        "labels": dict(scores.labels),
        "drawn": scores.drawn,
        "floor": _number(scores.floor),
        "accept": ACCEPT,
        "peak": PEAK,
        "axes": list(scores.axes),
        "candidates": [
            {"name": t.candidate.name, "gain": round(t.gain, 2), "named": t.candidate.named,
             "placebo": t.candidate.placebo}
            for t in trials
        ],
    }  # fmt: skip
    if done.evidence is not None:
        found |= dict(zip(("before", "after"), map(_part, done.evidence), strict=True))
    return found


def _part(evidence: Evidence) -> dict[str, Any]:
    curves = {
        "position": evidence.against(evidence.position),
        "speed": evidence.against(evidence.speed),
        "time": evidence.against(evidence.time, braking=True),
    }
    hz, highest, mean = spectrum(evidence)
    return {
        "correlations": [_number(value) for value in evidence.correlations()],
        "white": _number(evidence.white),
        **{name: _curve(curve) for name, curve in curves.items()},
        "spectrum": {name: [_number(v) for v in part] for name, part in
                     (("hz", hz), ("highest", highest), ("mean", mean))},
    }  # fmt: skip


def spectrum(evidence: Evidence) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Periodogram of the innovations over its mean, in up to BANDS bands: middle frequency in Hz, highest and mean
    power. White innovations have 1 everywhere, and seldom a peak as high as `screening.PEAK`."""
    e, t = evidence.residual, evidence.time
    good = np.isfinite(e)
    e = np.where(good, e - np.mean(e[good]), 0.0) if good.any() else np.zeros(len(e))
    if len(e) < 4 or not e.any():
        return np.empty(0), np.empty(0), np.empty(0)
    power = np.abs(np.fft.rfft(e))[1:] ** 2
    power /= power.mean()
    hz = np.fft.rfftfreq(len(e), float(t[1] - t[0]))[1:]
    bands = [part for part in np.array_split(np.arange(len(hz)), min(BANDS, len(hz))) if len(part)]
    parts = [(hz[b].mean(), power[b].max(), power[b].mean()) for b in bands]
    middle, highest, mean = np.array(parts).T
    return middle, highest, mean


def _curve(curve: Curve) -> dict[str, list[float | None]]:
    return {name: [_number(v) for v in getattr(curve, name)] for name in ("at", "mean", "stderr")}


def _number(value: float) -> float | None:
    value = float(value)
    return float(f"{value:.5g}") if math.isfinite(value) else None
