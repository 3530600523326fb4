"""`reference.yaml` beside a model: the reference of the rig when that model was learned, for `diagnose` and `improve`.

format: 1
of: stamp of the model's rings; a model whose rings were edited has no reference any more
body: {rolling: {value, stderr, unit}, ...}
terms: {floor_bump: {x: .., y: .., depth: .., width: ..}, ...}
memory, remaining: of the innovations
imbalance: {value, stderr, unit}; left out for a balanced ball
stage: {beta: {gain: .., order: .., ...}, gamma: ..}; the stage that moved the plate, if the record was kept

`reference.npz` beside it keeps the record of that time: a record is compared with it under the same model, so that what
the model lacks in both cancels.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import yaml

from mazeplan.control.estimation.rigid_body_filter import BodyModel
from mazeplan.control.estimation.rigid_body_parameters import value_of, with_values
from mazeplan.core.errors import ModelError
from mazeplan.core.file_format import format_problem
from mazeplan.core.logs.table import Table
from mazeplan.core.name_hints import one_of
from mazeplan.core.whole_file import whole_file
from mazeplan.diagnosis.rig.fitting import Reference
from mazeplan.diagnosis.rig.imbalance import BALANCED
from mazeplan.diagnosis.rig.record import filter_on_stage
from mazeplan.diagnosis.rig.reference import RigReference, reference_by_model, textbook
from mazeplan.diagnosis.stage.comparison import Known
from mazeplan.learning.modelfile import PACKAGED, RigModel, is_packaged_model
from mazeplan.learning.rigid_body_entries import ABSENT, PARAMETERS, determined, stamp
from mazeplan.maze.geometry import Maze
from mazeplan.physics.dynamics.rigid_body_effects import idle
from mazeplan.physics.effect import Term
from mazeplan.physics.effects.local_forces import FAMILY
from mazeplan.physics.registry import PACKAGED as EFFECTS
from mazeplan.physics.rig.stage import StageAxis, StageModel

NAME, RECORD = "reference.yaml", "reference.npz"
KEPT = ("t", "x", "y", "beta", "gamma", "u_beta", "u_gamma", "segment")  # columns of the record
AXES = ("beta", "gamma")
FORMAT = 1
NEUTRAL = StageAxis()


def reference_path(source: str | Path) -> Path:
    """Path of the reference of a model: a folder, its model.yaml, or the name of a packaged model."""
    path = PACKAGED / source if is_packaged_model(source) else Path(source)
    return (path.parent if path.suffix == ".yaml" else path) / NAME


def save_reference(was: RigReference, model: RigModel, folder: str | Path) -> Path:
    """Write the reference beside its model, and return its path. Raises ModelError."""
    body, path = was.body.model, Path(folder) / NAME
    document = {
        "format": FORMAT, "of": stamp(model.balls),
        "body": {name: _entry(value_of(body, name), was.body.stderr.get(name), number.unit)
                 for name, number in PARAMETERS.items()
                 if determined(name, value_of(body, name), was.body.stderr.get(name))},
        "terms": {t.name: {k: float(f"{v:.6g}") for k, v in t.values().items()} for t in body.terms if not idle(t)},
        "memory": round(was.memory, 4), "remaining": round(was.remaining, 4),
        "errors": {ring: {"value": round(error, 4), "unit": "rad"} for ring, error in was.errors.items()},
    }  # fmt: skip
    if was.imbalance.size > 0.0 and math.isfinite(was.imbalance.stderr):
        document["imbalance"] = _entry(was.imbalance.size, was.imbalance.stderr, "m/s^2")
    if was.table is not None:
        document["stage"] = {axis: _axis_entry(getattr(was.stage.kind, axis)) for axis in AXES}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as beside:
            beside.write_text(yaml.safe_dump(document, sort_keys=False, width=120), encoding="utf-8")
        if was.table is not None:
            with whole_file(path.parent / RECORD) as beside, beside.open("wb") as file:
                columns: dict[str, Any] = {name: was.table[name] for name in KEPT}
                np.savez_compressed(file, **columns)
    except OSError as problem:
        raise ModelError(f"cannot be written: {problem.strerror}", file=path) from None
    return path


def _axis_entry(axis: StageAxis) -> dict[str, Any]:
    """The numbers of an axis that are not at their defaults, with their standard errors."""
    numbers = {
        key: kind(value)
        for key, value in asdict(axis).items()
        if key != "stderr" and value != getattr(NEUTRAL, key)
        for kind in [type(getattr(NEUTRAL, key))]
    }
    return {**numbers, "stderr": {key: float(f"{error:.3g}") for key, error in axis.stderr.items()}}


def _entry(value: float, stderr: float | None, unit: str) -> dict[str, Any]:
    node: dict[str, Any] = {"value": float(f"{value:.6g}")}
    if stderr is not None and math.isfinite(stderr):
        node["stderr"] = float(f"{stderr:.2g}")
    return {**node, "unit": unit}


def load_reference(source: str | Path, model: RigModel) -> RigReference | None:
    """The reference of a model, None if it has none for its rings. Raises ModelError with file and key."""
    path = reference_path(source)
    if not path.is_file():
        return None
    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as problem:
        raise ModelError(f"cannot be read: {str(problem).splitlines()[0]}", file=path) from None
    if not isinstance(document, Mapping):
        raise ModelError(f"expected a mapping with format: {FORMAT}", file=path)
    if problem := format_problem(document.get("format"), FORMAT, document.get("version")):
        raise ModelError(problem, file=path, key="format")
    if document.get("of") != stamp(model.balls):
        return None
    values, stderr = {}, {}
    for name, node in _section(document, "body", path).items():
        if name not in PARAMETERS:
            raise ModelError(f"got {name}, expected {one_of(PARAMETERS, name)}", file=path, key="body")
        number = PARAMETERS[name]
        values[name] = _number(node, "value", path, f"body.{name}", number.low, number.high)
        if "stderr" in node:
            stderr[name] = _number(node, "stderr", path, f"body.{name}", 0.0, math.inf)
    body = with_values(BodyModel(), {**ABSENT, **values})._replace(
        terms=_terms(_section(document, "terms", path), path)
    )
    memory, remaining = (_number(document, key, path, key, 0.0, math.inf) for key in ("memory", "remaining"))
    table, known = _kept_record(document, path, model)
    node = _section(document, "errors", path)
    errors = {int(ring): _number(node[ring], "value", path, f"errors.{ring}", 0.0, math.inf)
              for ring in node if str(ring).isdigit()}  # fmt: skip
    source, imbalance = "its model", BALANCED
    if "imbalance" in document:
        node = document["imbalance"]
        size, error = (_number(node, key, path, "imbalance", 0.0, math.inf) for key in ("value", "stderr"))
        imbalance = BALANCED._replace(size=size, stderr=error)
    return RigReference(
        Reference(body, stderr), known, memory, remaining, source, errors=errors, imbalance=imbalance, table=table
    )


def _kept_record(document: Mapping[str, Any], path: Path, model: RigModel) -> tuple[Table | None, Known]:
    """The record of that time, None without one, and the stage of that time. Raises ModelError."""
    if "stage" not in document or not (path.parent / RECORD).is_file():
        return None, Known.of_model(model)
    try:
        stage = StageModel(*(StageAxis(**_section(document["stage"], axis, path)) for axis in AXES))
        with np.load(path.parent / RECORD) as file:
            table = Table({name: file[name] for name in KEPT}, {"file": RECORD}, str(path.parent / RECORD))
    except (TypeError, ValueError, KeyError, OSError, BadZipFile) as problem:
        raise ModelError(str(problem), file=path, key="stage") from None
    return table, Known.of_model(replace(model, stage=stage)).seen_in(table)


def known_reference(source: str | Path | None, model: RigModel | None, maze: Maze) -> RigReference:
    """The reference without logs: the file of the model's folder, or else the model alone, or else a textbook ball.

    Raises ModelError."""
    if model is None:
        return textbook()
    kept = None if source is None else load_reference(source, model)
    if kept is None:
        return reference_by_model(model, maze)
    return kept if kept.table is None else replace(kept, then=filter_on_stage(kept.table, maze, kept.stage.kind))


def _terms(section: Mapping[str, Any], path: Path) -> tuple[Term, ...]:
    """Terms of the file."""
    out = []
    for name, node in section.items():
        effect = FAMILY.get(name) or EFFECTS.get(name)
        if effect is None:
            raise ModelError(f"got {name}, expected {one_of(FAMILY, name)}", file=path, key="terms")
        try:
            out.append(effect(**{key: float(value) for key, value in node.items()}))
        except (TypeError, ValueError, AttributeError) as problem:
            raise ModelError(str(problem), file=path, key=f"terms.{name}") from None
    return tuple(out)


def _section(document: Mapping[str, Any], key: str, path: Path) -> Mapping[str, Any]:
    section = document.get(key, {})
    if not isinstance(section, Mapping):
        raise ModelError(f"got {section!r}, expected a mapping", file=path, key=key)
    return section


def _number(node: Any, key: str, path: Path, where: str, low: float, high: float) -> float:
    value = node.get(key) if isinstance(node, Mapping) else None
    if not isinstance(value, int | float) or isinstance(value, bool) or not low <= value <= high:
        raise ModelError(f"{key}: got {value!r}, expected a number from {low:g} to {high:g}", file=path, key=where)
    return float(value)
