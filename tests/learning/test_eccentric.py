"""A camera whose angle is about another point than the rings' centre."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plant import play

from mazeplan.apps.report.inputs import Input
from mazeplan.apps.report.models import models_section
from mazeplan.apps.report.page import section_text
from mazeplan.core.logs.table import Table
from mazeplan.learning.camera_center import Centre, find_centre, smoothing_of, straightened
from mazeplan.learning.comparison import CompareOptions, compare
from mazeplan.learning.samples import SampleOptions, ring_samples
from mazeplan.learning.smoothing import Smoothing
from mazeplan.maze.mapfile import load_map

OFF = (0.06, -0.1)  # radii
RADIUS = 0.08919


def record(off=OFF, seconds=120.0):
    columns = play(seed=4, seconds=seconds, radius=RADIUS, dry=0.4, camera=1e-4,
                   camera_offset=(off[0] * RADIUS, off[1] * RADIUS))  # fmt: skip
    bare = {name: column for name, column in columns.items() if name not in ("r", "u_beta", "u_gamma")}
    return Table({**bare, "ring": np.ones(len(columns["t"]))})


def samples_of(table):
    return ring_samples(table, load_map("cme"), Smoothing(), SampleOptions(radius=RADIUS))[1]


def test_there_and_back_and_the_slope_between():
    centre, phi = Centre(*OFF), np.linspace(-9.0, 9.0, 500)
    theta = centre.seen(phi)
    assert np.max(np.abs(np.exp(1j * theta) * np.abs(np.exp(1j * phi) + complex(*OFF)) - np.exp(1j * phi)
                         - complex(*OFF))) < 1e-12  # fmt: skip
    assert centre.straight(theta) == pytest.approx(phi)
    step = 1e-6
    slope = (centre.straight(theta + step) - centre.straight(theta - step)) / (2.0 * step)
    assert centre.slope(theta) == pytest.approx(slope, abs=1e-6)


def test_the_centre_is_found_and_a_camera_that_is_right_is_left_alone():
    samples = samples_of(record())
    rows = np.flatnonzero(samples.good)
    smoothing = smoothing_of(samples, rows, Smoothing())
    assert smoothing is not None
    found = find_centre(samples, rows, smoothing)
    assert found is not None
    assert (found.x, found.y) == pytest.approx(OFF, abs=0.01)
    right = samples_of(record((0.0, 0.0)))
    assert find_centre(right, np.flatnonzero(right.good), smoothing) is None


def test_straightened_samples_are_those_of_a_camera_that_is_right():
    off, right = samples_of(record()), samples_of(record((0.0, 0.0)))
    moved = straightened(off, Centre(*OFF), "smoothed", Smoothing())
    rows = moved.good & right.good
    apart = np.angle(np.exp(1j * (moved.k.theta - right.k.theta)[rows]))
    assert np.std(apart) < 2e-3
    error = (moved.theta_ddot - right.theta_ddot)[rows]
    assert np.std(error) < 0.15 * np.std(right.theta_ddot[rows])


def test_compare_predicts_as_well_in_the_measured_angle_and_tells_the_centre():
    table = record(seconds=90.0)
    scores = compare([table], [], load_map("cme"), CompareOptions(kinds=("pi",)))[1]
    assert scores["centre_m"] == pytest.approx((OFF[0] * RADIUS, OFF[1] * RADIUS), abs=1e-3)
    section = models_section(Input("comparison", Path("x.json"), "x", {"ring1": scores}))
    assert "another point than the rings' centre, in mm: ring 1 5." in section_text(section)
    right = compare([record((0.0, 0.0), 90.0)], [], load_map("cme"), CompareOptions(kinds=("pi",)))[1]
    assert right["centre_m"] == [0.0, 0.0]
    assert scores["nrmse_test"]["pi"] < right["nrmse_test"]["pi"] + 0.03
    assert scores["rollout"]["pi"]["40"] < 1.3 * right["rollout"]["pi"]["40"]
