"""The documents of a diagnosis: what `diagnose` and `improve` print, and the evidence that pictures show."""

# ruff: noqa: RUF012  pydantic copies defaults
from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from pydantic import Field, StrictBool, StrictInt, StrictStr, TypeAdapter, model_validator

from mazeplan.apps.report.documents import Document, Grid, NullIsEmpty, Number, Real, Row, Scores, alike, counted, wrong

BeforeAfter = Annotated[dict[str, Row], alike("before", "after")]
BinnedCurve = Annotated[dict[str, Row], alike("at", "mean", "stderr")]


class ParameterEntry(Document):
    """Size of a parameter."""

    value: Real
    stderr: Number = math.nan
    unit: StrictStr = "1"


class EffectEntry(Document):
    """An effect that was found. evidence: growth of -2 log L without it; known_before: sizes in the old model."""

    name: StrictStr
    parameters: dict[str, ParameterEntry]
    evidence: Number = math.nan
    rings: dict[str, Any] = {}
    known_before: Scores = {}
    planned: StrictBool = True
    why_not: StrictStr | None = None


class NavigationRuns(Document):
    """Runs with one model; time_s: mean, best, worst of those that arrived."""

    runs: StrictInt
    success: StrictInt
    time_s: Scores


class NavigationChange(Document):
    """Runs with the old model and with the new one."""

    before: NavigationRuns
    after: NavigationRuns


class DiagnosisDocument(Document):
    """Printed by `diagnose --json`. before, after: scores on held-out samples; test: on a further record."""

    verdict: StrictStr
    effects: list[EffectEntry] = []
    before: Scores = {}
    after: Scores = {}
    unknown: dict[str, Any] | None = None
    model: StrictStr | None = None
    notes: list[StrictStr] = []
    test: Annotated[dict[str, Any], NullIsEmpty] = {}
    navigation: NavigationChange | None = None

    def columns(self, before: str, after: str) -> dict[str, Scores]:
        """Scores by heading, with those on a further record if the document has one."""
        found = {before: self.before, after: self.after}
        for heading, when in ((before, "before"), (after, "after")):
            if isinstance(further := self.test.get(when), dict):
                found[f"{heading}, further record"] = TypeAdapter(Scores).validate_python(further)
        return found


class RingDocument(DiagnosisDocument):
    """A diagnosis of one ring or another system. separate_by: for each ambiguous group an experiment (why, first,
    note, command); declared: effects of the old model."""

    ring: StrictInt | None = None
    radius_m: Number = math.nan
    held_out: Number = math.nan
    noise_floor: Number = math.nan
    declared: Annotated[dict[str, Any], NullIsEmpty] = {}
    ambiguous_with: list[list[StrictStr]] = []
    separate_by: list[dict[str, Any]] = []


class RigDocument(DiagnosisDocument):
    """A diagnosis of a whole rig. remaining: residual in times the noise of the camera."""

    sentence: StrictStr
    reference: StrictStr
    advice: list[StrictStr]
    remaining: Number = math.nan

    @property
    def something_found(self) -> bool:
        """Whether the scores after differ from those before."""
        return bool(self.effects or self.unknown)


class ImproveRound(Document):
    """One round; its diagnosis is checked by itself."""

    diagnosis: dict[str, Any]
    navigation: NavigationChange | None = None


class ImproveDocument(Document):
    """Printed by `improve --json`."""

    rounds: list[ImproveRound] = Field(min_length=1)


# -- evidence.json -----------------------------------------------------------------------------------------------------


class CandidateEntry(Document):
    """A candidate of the search. gain: fall of -2 log L with it alone, less its penalty."""

    name: StrictStr
    gain: Real
    named: StrictBool = True
    placebo: StrictBool = False


class ResidualEvidence(Document):
    """The residual. correlations: by samples apart; white: bound of those of white noise; spectrum: by hz."""

    correlations: Row
    white: Number
    position: BinnedCurve
    speed: BinnedCurve
    time: BinnedCurve
    spectrum: Annotated[dict[str, Row], alike("hz", "highest", "mean")]


class EvidenceDocument(Document):
    """What pictures of the diagnosis of one ring or another system show."""

    title: StrictStr = ""
    notes: list[StrictStr] = []
    labels: dict[str, StrictStr] = {}
    drawn: StrictStr = "rollout40"
    accept: Real = 15.0
    peak: Real = 18.0
    axes: list[StrictStr]
    candidates: list[CandidateEntry]
    before: ResidualEvidence | None = None
    after: ResidualEvidence | None = None


class ErrorMap(Document):
    """Error of the prediction by ring (rows: inner and outer radius) and sector. ahead: samples."""

    ahead: StrictInt
    rings: Grid
    before: Grid
    after: Grid


class PlaceMark(Document):
    """A place that was found: a spot (x, y, width), or a sector (centre, half, inner, outer)."""

    x: Number = math.nan
    y: Number = math.nan
    width: Number = math.nan
    centre: Number = math.nan
    half: Number = 0.0
    inner: Number = math.nan
    outer: Number = math.nan

    @model_validator(mode="after")
    def _complete(self) -> PlaceMark:
        for name in ("y", "width") if math.isfinite(self.x) else ("centre", "inner", "outer"):
            if not math.isfinite(getattr(self, name)):
                raise wrong(name, "is not there")
        return self


class PredictionErrors(Document):
    """Error of the angle by time ahead: mean, and bounds of four of five."""

    ahead_s: Row
    error: BeforeAfter
    low: BeforeAfter
    high: BeforeAfter


class RigEvidenceDocument(PredictionErrors):
    """What pictures of the diagnosis of a whole rig show. gain: of -2 log L, for each block of time.

    remaining: residual in times the noise; its `then`: when the model was right, 0 if not known."""

    title: StrictStr
    map: StrictStr
    block_s: Real
    gain: Row
    gain_t: Row = np.empty(0)
    white: Real
    alike_from: Real
    places: ErrorMap
    marks: list[PlaceMark]
    correlation: BeforeAfter
    spectrum: Annotated[dict[str, Row], alike("hz", "before", "after")] | None = None
    remaining: Annotated[Scores, NullIsEmpty] = {}

    @model_validator(mode="after")
    def _lengths(self) -> RigEvidenceDocument:
        count, places = len(self.ahead_s), self.places
        counted((f"{k}.before", len(getattr(self, k)["before"]), count, "values") for k in ("error", "low", "high"))
        if len(self.gain):
            counted([("gain_t", len(self.gain_t), len(self.gain), "times")])
        counted((f"places.{k}", len(getattr(places, k)), len(places.rings), "rows") for k in ("before", "after"))
        if not 1 <= places.ahead <= count:
            raise wrong("places.ahead", f"got {places.ahead}, expected a number of samples from 1 to {count}")
        return self
