"""The documents of a diagnosis: the JSON that `diagnose` and `improve` print, and the evidence that pictures show."""

# ruff: noqa: RUF012  pydantic copies defaults
from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import Field, StrictBool, StrictInt, StrictStr

from mazeplan.apps.report.documents import Document, Grid, NullIsEmpty, Number, Real, Row, Scores

BeforeAfter = dict[str, Row]
BinnedCurve = dict[str, Row]


class ParameterEntry(Document):
    """Size of a parameter, with its standard error."""

    value: Real
    stderr: Number = math.nan
    unit: StrictStr = "1"


class EffectEntry(Document):
    """An effect that was found.

    name: name of the effect.
    parameters: {name of a parameter: its size}.
    evidence: growth of -2 log L if the effect is left out.
    rings: the rings in which it was found.
    known_before: {name of a parameter: its size in the old model}.
    planned: whether plans use the effect.
    why_not: reason if plans do not use it."""

    name: StrictStr
    parameters: dict[str, ParameterEntry]
    evidence: Number = math.nan
    rings: dict[str, Any] = {}
    known_before: Scores = {}
    planned: StrictBool = True
    why_not: StrictStr | None = None


class NavigationRuns(Document):
    """Runs with one model.

    runs, success: numbers of all runs and of runs that arrived.
    time_s: mean, best and worst time of the runs that arrived, s."""

    runs: StrictInt
    success: StrictInt
    time_s: Scores


class NavigationChange(Document):
    """Runs with the old model and with the new one."""

    before: NavigationRuns
    after: NavigationRuns


class FurtherScores(Document):
    """Scores on a further record, with the old and with the new model."""

    before: Annotated[Scores, NullIsEmpty] = {}
    after: Annotated[Scores, NullIsEmpty] = {}


class DiagnosisDocument(Document):
    """The JSON of `diagnose`: the keys that every diagnosis has.

    before, after: scores on held-out samples with the old and with the new model.
    unknown: an effect without a name.
    test: scores on a further record."""

    verdict: StrictStr
    effects: list[EffectEntry] = []
    before: Scores = {}
    after: Scores = {}
    unknown: dict[str, Any] | None = None
    model: StrictStr | None = None
    notes: list[StrictStr] = []
    test: Annotated[FurtherScores, NullIsEmpty] = FurtherScores()
    navigation: NavigationChange | None = None

    def columns(self, before: str, after: str) -> dict[str, Scores]:
        """{heading of a column: scores}. Has more columns if the document has scores on a further record."""
        found = {before: self.before, after: self.after}
        for heading, further in ((before, self.test.before), (after, self.test.after)):
            if further:
                found[f"{heading}, further record"] = further
        return found


class RingDocument(DiagnosisDocument):
    """A diagnosis of one ring of a maze, or of another system.

    held_out: share of the samples that were held out.
    noise_floor: error by the noise of the sensors alone.
    declared: effects of the old model.
    ambiguous_with: groups of effects that the record cannot tell apart.
    separate_by: for each group an experiment that can (why, first, note, command)."""

    ring: StrictInt | None = None
    radius_m: Number = math.nan
    held_out: Number = math.nan
    noise_floor: Number = math.nan
    declared: Annotated[dict[str, Any], NullIsEmpty] = {}
    ambiguous_with: list[list[StrictStr]] = []
    separate_by: list[dict[str, Any]] = []


class RigDocument(DiagnosisDocument):
    """A diagnosis of a whole rig.

    remaining: residual divided by the noise of the camera."""

    sentence: StrictStr
    reference: StrictStr
    advice: list[StrictStr]
    remaining: Number = math.nan

    @property
    def something_found(self) -> bool:
        """Whether the diagnosis found an effect, so that the scores after differ from those before."""
        return bool(self.effects or self.unknown)


class ImproveRound(Document):
    """One round of `improve`. Its diagnosis is checked later, as a document of its own."""

    diagnosis: dict[str, Any]
    navigation: NavigationChange | None = None


class ImproveDocument(Document):
    """The JSON of `improve`."""

    rounds: list[ImproveRound] = Field(min_length=1)


# -- evidence.json -----------------------------------------------------------------------------------------------------


class CandidateEntry(Document):
    """A candidate of the search.

    gain: fall of -2 log L with this candidate alone, minus its penalty.
    named: whether it has a name.
    placebo: whether it is a placebo."""

    name: StrictStr
    gain: Real
    named: StrictBool = True
    placebo: StrictBool = False


class ResidualEvidence(Document):
    """The residual of a model.

    position, speed, time: mean residual in bins of each."""

    position: BinnedCurve
    speed: BinnedCurve
    time: BinnedCurve


class EvidenceDocument(Document):
    """Evidence for the pictures of a `RingDocument`. axes: labels of position and speed."""

    title: StrictStr = ""
    notes: list[StrictStr] = []
    labels: dict[str, StrictStr] = {}
    drawn: StrictStr = "rollout40"
    accept: Real = 15.0
    axes: list[StrictStr]
    candidates: list[CandidateEntry]
    before: ResidualEvidence | None = None
    after: ResidualEvidence | None = None


class ErrorMap(Document):
    """Error of the prediction by ring and sector.

    ahead: how far the prediction looks ahead, samples.
    rings: inner and outer radius of each ring, m.
    before, after: errors along the ring, m; a row for each ring, a column for each sector."""

    ahead: StrictInt
    rings: Grid
    before: Grid
    after: Grid


class PlaceMark(Document):
    """A place that was found: a spot or a sector.

    x, y, width: middle and radius of a spot, m.
    centre, half: middle and half width of a sector, rad.
    inner, outer: radii of a sector, m."""

    x: Number = math.nan
    y: Number = math.nan
    width: Number = math.nan
    centre: Number = math.nan
    half: Number = 0.0
    inner: Number = math.nan
    outer: Number = math.nan


class PredictionErrors(Document):
    """Error of the predicted angle, by time ahead.

    ahead_s: times ahead, s.
    error: mean error, rad.
    low, high: bounds that four of five errors are between, rad."""

    ahead_s: Row
    error: BeforeAfter
    low: BeforeAfter
    high: BeforeAfter


class RigEvidenceDocument(PredictionErrors):
    """Evidence for the pictures of a `RigDocument`.

    map: text of the map.
    places: error of the prediction over the maze.
    marks: places that were found.
    remaining: residual divided by the noise; `then`: its value when the model was right, 0 if not known."""

    title: StrictStr
    map: StrictStr
    places: ErrorMap
    marks: list[PlaceMark]
    remaining: Annotated[Scores, NullIsEmpty] = {}
