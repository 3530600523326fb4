"""Derivatives of the innovations that run along in the filter, against differences of whole passes."""

from __future__ import annotations

import numpy as np
import pytest
from ring_records import DECLARED, record

from mazeplan.diagnosis.ring.fit import Likelihood
from mazeplan.diagnosis.ring.system import RingSystem, ring_library, stage_errors
from mazeplan.diagnosis.stage.plate_motion import fit_stage, plate_motion

ROWS = np.ones(1800, dtype=bool)


@pytest.fixture(scope="module")
def seen():
    return record(seed=3, seconds=60.0)


@pytest.fixture(scope="module")
def stage(seen):
    return fit_stage(seen, ROWS)


@pytest.fixture(scope="module")
def likelihood(seen, stage):
    system = RingSystem(seen.t, seen.theta, seen.begins, 0.0925, plate_motion(seen, stage), DECLARED)
    return Likelihood(system, [*ring_library(), stage_errors(stage.directions)], ROWS)


SMOOTH = ["rolling_inertia", "viscous_friction", "quadratic_drag", "tilt_offset", "constant_torque", "surface_profile",
          "surface_bump", "friction_drift", "tilt_gain", "axis_misalignment", "sensor_delay", "stage"]  # fmt: skip


@pytest.mark.parametrize("name", SMOOTH)
def test_derivatives_are_those_of_whole_passes(likelihood, name):
    candidate = next(c for c in likelihood.library if c.name == name)
    start = {key: spec.default for key, spec in candidate.parameters.items()}
    if name == "surface_bump":
        start |= {"centre": 1.0, "width": 0.4, "height": 0.5}
    if name in DECLARED:
        start = dict(DECLARED[name])
    steps = [(name, key, spec.step) for key, spec in candidate.parameters.items()]
    values = {name: start}
    _, J = likelihood.jacobian(values, 30.0, steps)
    for j, (_, key, step) in enumerate(steps):
        up, down = ({name: {**start, key: start[key] + sign * step}} for sign in (1.0, -1.0))
        slope = (likelihood.whitened(up, 30.0) - likelihood.whitened(down, 30.0)) / (2.0 * step)
        if name == "stage" and not np.any(slope):  # of a number that the kind of axis does not have
            assert not np.any(J[:, j])
            continue
        off = np.linalg.norm(J[:, j] - slope) / np.linalg.norm(slope)
        assert off < 0.1, (key, off)


def test_directions_of_the_stage_are_one_standard_error_long(likelihood, stage):
    """The tilt that each of them moves is worth one unit of the sensor's -2 log L, or less where it is cut."""
    tilt = likelihood.system.tilt
    moved = [change[::6, 0 if name.startswith("beta") else 3] for name, change in tilt.by_stage.items()]
    worth = np.array([np.sum(angle**2) / 8e-4**2 for angle in moved])
    assert np.sum(worth > 0.0) == sum(3 + axis.order for axis in stage.axes)  # a direction for each number of its kind
    assert worth.max() < 3.0
