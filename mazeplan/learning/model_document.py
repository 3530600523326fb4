"""The content of a model.yaml for a model; `modelfile` reads and writes the file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

import yaml

from mazeplan.learning.rig_model import RigModel
from mazeplan.learning.rigid_body_entries import KEPT, PARAMETERS
from mazeplan.physics.effect import Term
from mazeplan.physics.rig.sensors import Camera, TiltSensor
from mazeplan.physics.rig.stage import ORDERS, StageAxis

FORMAT = 1
AXIS_UNITS = {"gain": "1", "natural_frequency": "rad/s", "damping": "1", "dead_time": "s", "offset": "rad"}
# these are written if they are not at their default
AXIS_MORE = {"backlash": "rad", "deadband": "rad", "coupling": "1", "rate_limit": "rad/s", "resolution": "rad"}
CAMERA_UNITS = {"offset_x": "m", "offset_y": "m", "angle": "rad"}
CAMERA_MORE = {"scale": "1", "distortion": "1/m^2", "distortion_x": "m", "distortion_y": "m"}
SENSOR_UNITS = {"gain_beta": "1", "gain_gamma": "1"}
BODY_UNITS = {name: PARAMETERS[name].unit for name in KEPT}


def entry(value: float, stderr: float | None, unit: str) -> dict[str, Any]:
    """A number with its standard error, if that is known, and its unit."""
    entry: dict[str, Any] = {"value": float(f"{value:.6g}")}
    if stderr is not None and math.isfinite(stderr):
        entry["stderr"] = float(f"{stderr:.2g}")
    return {**entry, "unit": unit}


def _entries(
    part: StageAxis | Camera | TiltSensor, units: Mapping[str, str], more: Mapping[str, str]
) -> dict[str, Any]:
    """The entries of a part; those of `more` only if they differ from their default."""
    usual = type(part)()
    chosen = {**units, **{name: unit for name, unit in more.items() if getattr(part, name) != getattr(usual, name)}}
    return {name: entry(getattr(part, name), part.stderr.get(name), unit) for name, unit in chosen.items()}


def _axis_entries(axis: StageAxis) -> dict[str, Any]:
    """The entries of an axis, without numbers that its kind does not have."""
    entries = _entries(axis, AXIS_UNITS, AXIS_MORE)
    if axis.behind and axis.backlash:
        entries["backlash"]["behind_the_lag"] = True
    if axis.dead_time == 0.0:
        del entries["dead_time"]
    if axis.order < 2:
        del entries["damping"]
        if axis.order == 0:
            entries["natural_frequency"] = {"faster_than": axis.natural_frequency, "unit": "rad/s"}
        return {"follows": ORDERS[axis.order], **entries}
    return entries


def _term_entries(terms: Iterable[Term], stderr: Mapping[str, Mapping[str, float]]) -> dict[str, Any]:
    return {
        term.name: {
            k: entry(value, stderr.get(term.name, {}).get(k), term.effect.parameters[k].unit)
            for k, value in term.values().items()
        }
        for term in terms
    }


def model_document(model: RigModel, processes: Mapping[int, Mapping[str, Any]] | None = None) -> dict[str, Any]:
    """The content of model.yaml; processes: entries of the learned parts, from `write_process`."""
    out: dict[str, Any] = {
        "format": FORMAT,
        "kind": model.kind,
        "rate_hz": model.rate_hz,
        "camera_delay_s": entry(model.camera_delay, model.camera_delay_stderr, "s"),
        "stage": {name: _axis_entries(getattr(model.stage, name)) for name in ("beta", "gamma")},
    }
    if model.camera != Camera():
        out["camera"] = _entries(model.camera, CAMERA_UNITS, CAMERA_MORE)
    if model.tilt_sensor != TiltSensor():
        out["tilt_sensor"] = _entries(model.tilt_sensor, SENSOR_UNITS, {})
    out["rings"] = {ring: _term_entries(ball.effects, ball.stderr) for ring, ball in sorted(model.balls.items())}
    if model.body is not None:
        values, stderr = model.body.values, model.body.stderr
        numbers = {name: entry(value, stderr.get(name), BODY_UNITS[name]) for name, value in values.items()}
        terms = {"terms": _term_entries(model.body.terms, {})} if model.body.terms else {}
        out["body"] = {"of": model.body.of, **numbers, **terms}
    if processes:
        out["processes"] = processes
    return {**out, "data": [dict(entry) for entry in model.data], "scores": dict(model.scores)}


class ModelDumper(yaml.SafeDumper):
    """Writes innermost mappings on one line."""


def _mapping(dumper: ModelDumper, data: Mapping[str, Any]) -> yaml.Node:
    flat = bool(data) and all(not isinstance(value, dict | list) for value in data.values())
    return dumper.represent_mapping("tag:yaml.org,2002:map", data.items(), flow_style=flat)


ModelDumper.add_representer(dict, _mapping)
