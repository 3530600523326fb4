"""From what was found to a new model: the entries that change, and no others."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import yaml

from mazeplan.core.logs.table import Table
from mazeplan.diagnosis.record import centred
from mazeplan.diagnosis.ring.camera import fit_circle
from mazeplan.diagnosis.update import base_model, updated
from mazeplan.learning.modelfile import load_model, model_document, save_model
from mazeplan.physics.rig.sensors import Camera

TOY = load_model("toy")


def effect(name, **numbers):
    """An entry as in a diagnosis: parameter = (value, stderr)."""
    return {"name": name, "parameters": {k: {"value": v, "stderr": s, "unit": "1"} for k, (v, s) in numbers.items()}}


def changed(old, new, key=()):
    """Keys at which two documents differ, down to where one of them ends."""
    if isinstance(old, dict) and isinstance(new, dict):
        return [k for name in {**old, **new} for k in changed(old.get(name), new.get(name), (*key, name))]
    return [] if old == new else [key]


@pytest.mark.parametrize(
    ("found", "entries"),
    [
        (effect("dry_friction", coefficient=(1.2, 0.1), asymmetry=(0.0, 0.1)), {("rings", 2, "dry_friction")}),
        (effect("surface_bump", centre=(1.0, 0.1), width=(0.2, 0.1), height=(-2.0, 0.1)),
         {("rings", 2, "surface_bump")}),
        (effect("surface_profile", cos2=(1.0, 0.1)), {("rings", 2, "surface_profile")}),
        (effect("tilt_offset", beta=(0.01, 0.001), gamma=(0.02, 0.001)),
         {("rings", ring, "tilt_offset") for ring in range(1, 6)}),
        (effect("sensor_delay", delay=(0.145, 0.001)), {("camera_delay_s",)}),
        (effect("camera_offset", x=(0.001, 1e-4), y=(-0.002, 1e-4)), {("camera",)}),
        (effect("axis_misalignment", angle=(0.03, 1e-3)), {("camera",)}),
        (effect("tilt_gain", beta=(1.1, 0.01), gamma=(0.9, 0.01)), {("tilt_sensor",)}),
        (effect("backlash", beta=(0.017, 1e-3), gamma=(0.0, 0.0)), {("stage", "beta", "backlash")}),
        (effect("command_delay", delay=(0.03, 0.001)),
         {("stage", axis, "dead_time") for axis in ("beta", "gamma")}),
        (effect("friction_drift", rate=(1e-3, 1e-4), start=(0.0, 0.1)),
         {("rings", 2, "viscous_friction")}),
    ],
    ids=lambda value: value["name"] if isinstance(value, dict) else "",
)  # fmt: skip
def test_the_new_file_differs_by_one_entry_and_can_be_read(tmp_path, found, entries):
    new = updated(TOY, {2: [found]})
    old_document, new_document = (yaml.safe_load(yaml.dump(model_document(m))) for m in (TOY, new))
    prefixes = {next((e for e in entries if key[: len(e)] == e), key) for key in changed(old_document, new_document)}
    assert prefixes == entries
    save_model(new, tmp_path)
    again = load_model(tmp_path)
    assert model_document(again) == model_document(new)
    assert set(again.processes) == set(TOY.processes)


def test_declared_by_the_new_model_is_what_was_found():
    found = [
        effect("sensor_delay", delay=(0.145, 0.001)),
        effect("tilt_gain", beta=(1.1, 0.01), gamma=(0.9, 0.01)),
        effect("axis_misalignment", angle=(0.03, 1e-3)),
        effect("backlash", beta=(0.017, 1e-3), gamma=(0.0, 0.0)),
        effect("surface_bump", centre=(1.0, 0.1), width=(0.2, 0.1), height=(-2.0, 0.1)),
    ]
    declared = updated(TOY, {3: found}).declared(3)
    for entry in found:
        assert declared[entry["name"]] == pytest.approx({k: p["value"] for k, p in entry["parameters"].items()})


def test_friction_that_drifted_is_in_the_new_model_as_it_was_in_the_end():
    had = TOY.ball(2).parameter("viscous_friction", "coefficient", 0.0)
    found = {**effect("friction_drift", rate=(1e-3, 1e-4), start=(0.05, 0.01)), "until_s": 200.0}
    new = updated(TOY, {2: [found]})
    assert new.ball(2).parameter("viscous_friction", "coefficient", 0.0) == pytest.approx(had + 0.05 + 0.2)
    assert new.ball(2).stderr["viscous_friction"]["coefficient"] == pytest.approx(math.hypot(0.01, 0.02))
    assert all(term.name != "friction_drift" for term in new.ball(2).effects)


@pytest.mark.parametrize("known", [Camera(), Camera(offset_x=0.002, offset_y=-0.001, scale=1.1, angle=0.05)])
def test_an_offset_of_the_camera_comes_to_the_one_that_the_model_knows(known):
    angle, camera = np.linspace(0.0, 60.0, 400), replace(known, offset_x=0.003, offset_y=-0.002)
    r = 0.0892 + 1e-4 * np.random.default_rng(0).standard_normal(len(angle))
    seen = zip(*(camera.seen(*place) for place in zip(r * np.cos(angle), r * np.sin(angle), strict=True)), strict=True)
    place = centred(Table(dict(zip("xy", map(np.array, seen), strict=True)) | {"t": angle}), known)
    x, y = place["x"], place["y"]
    _, entry = fit_circle(np.arctan2(y, x), np.hypot(x, y), np.ones(len(x), dtype=bool), known)
    assert entry["known_before"] == {"x": known.offset_x, "y": known.offset_y}
    new = updated(replace(TOY, camera=known), {1: [entry]}).camera
    assert (new.offset_x, new.offset_y) == pytest.approx((0.003, -0.002), abs=5e-5)
    assert new.stderr["offset_x"] == entry["parameters"]["x"]["stderr"]


def test_values_outside_what_a_model_may_have_become_the_nearest():
    found = [effect("sensor_delay", delay=(-0.01, 0.001)), effect("quadratic_drag", coefficient=(-1, 1))]
    new = updated(TOY, {1: found})
    assert new.camera_delay == -TOY.stage.dead_time
    assert new.ball(1).parameter("quadratic_drag", "coefficient", 1.0) == 0.0


def test_declarations_alone_make_a_model_of_one_ring():
    declared = {"rolling_inertia": {"factor": 0.6}, "sensor_delay": {"delay": 0.05}}
    model = base_model(2, declared, None)
    there = model.declared(2)
    assert {name: there.pop(name) for name in declared} == declared
    assert set(there) == {"servo_gain", "servo_lag"}, "a servo as in a textbook"
    assert list(model.balls) == [2]
