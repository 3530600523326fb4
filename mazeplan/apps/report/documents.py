"""The documents of evaluations and comparisons, as pydantic models. Also the base and the checks of all such models.

A missing number (null) is NaN in a model. Unknown keys are ignored. Units are SI, as in the files.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetPydanticSchema,
    StrictBool,
    StrictInt,
    StrictStr,
    TypeAdapter,
    ValidationError,
)  # fmt: skip
from pydantic_core import core_schema

from mazeplan.apps.report.words import KINDS
from mazeplan.core.errors import InputError
from mazeplan.core.records import Array
from mazeplan.maze.yamltree import key_path


def _through(kind: Any, convert: Any) -> Any:
    """An annotation: pydantic checks a value as `kind`, then converts it with `convert`."""

    def schema(_: Any, handler: Any) -> Any:
        return core_schema.no_info_after_validator_function(convert, handler.generate_schema(kind))

    return GetPydanticSchema(schema)


def _table(rows: list[list[float]]) -> Array:
    return np.array(rows, dtype=float) if rows else np.empty((0, 0))


Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Number = Annotated[float, _through(Real | None, lambda value: math.nan if value is None else value)]
Row = Annotated[Array, _through(list[Number], lambda values: np.array(values, dtype=float))]
Grid = Annotated[Array, _through(list[list[Number]], _table)]
Scores = dict[str, Number]
NullIsEmpty = BeforeValidator(lambda value: {} if value is None else value)


class Document(BaseModel):
    """Base of all models of documents."""

    model_config = ConfigDict(frozen=True, arbitrary_types_allowed=True)


# -- evaluate --json ---------------------------------------------------------------------------------------------------


class RingTime(Document):
    """Time of one visit of a ring."""

    ring: StrictInt
    time_s: Real


class FailureEntry(Document):
    """A failure, and where the ball was then, m."""

    kind: StrictStr
    x: Number = math.nan
    y: Number = math.nan


class RunEntry(Document):
    """One run of an evaluation."""

    success: StrictBool
    reason: StrictStr
    time_s: Real
    rings: list[RingTime]
    failures: list[FailureEntry]


class EvaluationSetup(Document):
    """What was evaluated. `dict(setup)` also has the keys that are not listed here."""

    model_config = ConfigDict(extra="allow")
    rig: StrictStr | None = None
    map: StrictStr | None = None
    model: StrictStr | None = None
    time_limit_s: Number = math.nan


class EvaluationDocument(Document):
    """The JSON of `evaluate`."""

    results: list[RunEntry] = Field(min_length=1)
    setup: Annotated[EvaluationSetup, NullIsEmpty] = EvaluationSetup()


# -- compare --json ----------------------------------------------------------------------------------------------------


class ResidualDocument(Document):
    """Residual of the angular acceleration in cells; a row for each rate, a column for each angle.

    rate: edges of the rows, rad/s.
    count: number of samples in each cell.
    mean, rms: {kind of model: mean or root mean square residual in each cell, rad/s^2}."""

    rate: Row
    count: Grid
    mean: dict[str, Grid]
    rms: dict[str, Grid]


class ComparedRing(Document):
    """Scores of kinds of models on one ring.

    n_train, n_test: numbers of rows.
    nrmse_train, nrmse_test: {kind: nRMSE}.
    rollout: {kind: {"20", "40": mean error after so many samples, rad}}.
    interval95: {score: {kind: ends of the 95 % interval}}.
    bands: {kind: mean error and percentiles of the errors, by sample, rad}."""

    n_train: StrictInt | None = None
    n_test: StrictInt | None = None
    rates: StrictStr | None = None
    delay_s: Number = math.nan
    windows: StrictInt | None = None
    windows_chosen: StrictStr = ""
    blocks: dict[str, StrictInt | None] = {}
    nrmse_train: Scores
    nrmse_test: Scores
    rollout: dict[str, Scores]
    interval95: dict[str, dict[str, tuple[Number, Number] | None]] = {}
    bands: dict[str, dict[str, Row]] = {}
    residual: ResidualDocument | None = None

    def interval(self, score: str, kind: str) -> tuple[float, float] | None:
        """Ends of the 95 % interval of a score; None if the document has none."""
        return self.interval95.get(score, {}).get(kind)


Comparison = Mapping[int, ComparedRing]  # by ring


def kinds(document: Comparison, part: str) -> list[str]:
    """Kinds of models that have scores in some ring, in the paper's order.

    part: the field of `ComparedRing` with the scores."""
    found = {kind for scores in document.values() for kind in getattr(scores, part)}
    return [kind for kind in KINDS if kind in found] + sorted(found - set(KINDS))


def best_kind(document: Comparison) -> str:
    """The kind with the smallest test nRMSE, as a mean over all rings; empty without scores."""
    rings = list(document.values())
    means = {
        kind: np.mean([scores.nrmse_test.get(kind, math.nan) for scores in rings])
        for kind in kinds(document, "nrmse_test")
    }
    finite = {kind: mean for kind, mean in means.items() if math.isfinite(mean)}
    return min(finite, key=lambda kind: finite[kind]) if finite else ""


# -- checks ------------------------------------------------------------------------------------------------------------

EXPECTED = {
    "model_type": "an object", "model_attributes_type": "an object", "dict_type": "an object", "list_type": "a list",
    "string_type": "text", "bool_type": "true or false", "int_type": "a whole number", "float_type": "a finite number",
    "finite_number": "a finite number",
}  # fmt: skip


def checked(model: Any, document: Any, path: Path, place: tuple[str | int, ...] = ()) -> Any:
    """The document as `model`. Raises InputError for the first problem.

    place: keys that lead to the document in its file."""
    try:
        return TypeAdapter(model).validate_python(document)
    except ValidationError as error:
        first = error.errors()[0]
    kind = first["type"]
    key = key_path((*place, *first["loc"]))
    if kind == "missing":
        problem = "is not there"
    elif kind == "too_short":
        problem = f"got no {'runs' if key == 'results' else key}, expected one or more"
    else:
        problem = f"got {json.dumps(first['input'], default=str)[:40]}, expected {EXPECTED.get(kind, first['msg'])}"
    raise InputError(problem, file=path, key=key)
