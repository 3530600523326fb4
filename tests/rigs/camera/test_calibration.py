"""The camera's numbers come back from pictures that a known camera took."""

from __future__ import annotations

import math
from functools import cache

import cv2
import numpy as np
import pytest
from chessboards import board_poses, draw_board
from emulator.look import Look
from emulator.render import TRUE
from scenes import FOUND, MAZE, overlooking, usual

from mazeplan.core.errors import InputError, SettingsError
from mazeplan.rigs.camera.calibration import LensCalibration, calibrate_lens, calibrate_plate
from mazeplan.rigs.camera.pinhole import corner_markers, fit_tilt
from mazeplan.rigs.files import validated
from mazeplan.rigs.hardware.settings import CameraSection, mapping

CORNERS, SQUARE = (9, 6), 0.02
TRUE_LENS = LensCalibration(TRUE.matrix, TRUE.distortion, TRUE.size, 0.0, 0)
BALLS = np.array([[0.089, 0.0, 0.006], [0.0, 0.089, 0.006], [-0.06, -0.06, 0.006], [0.0, 0.0, 0.006]])


@cache
def boards(count=8):
    rng = np.random.default_rng(2)
    poses = board_poses(TRUE, CORNERS, SQUARE, count, rng)
    return tuple((f"board {i}", draw_board(TRUE, CORNERS, SQUARE, *pose, rng)) for i, pose in enumerate(poses))


def plates(count=3):
    rng = np.random.default_rng(3)
    return [(f"plate {i}", overlooking(Look()).render(None, 0.0, 0.0, rng)) for i in range(count)]


def apart_mm(camera, other=TRUE, beta=0.0, gamma=0.0):
    """How far two cameras disagree on where balls are, mm on the plate."""
    pixels = camera.project(BALLS, beta, gamma) - other.project(BALLS, beta, gamma)
    return 1000.0 * np.abs(pixels).max() * other.translation[2] / other.matrix[0, 0]


def test_lens_and_pose_from_rendered_pictures():
    lens = calibrate_lens(boards(), CORNERS, SQUARE)
    assert lens.error_px < 0.15
    assert lens.matrix[0, 0] == pytest.approx(1200.0, rel=0.005)
    assert lens.distortion[0] == pytest.approx(-0.12, abs=0.03)
    done = calibrate_plate(lens, plates(), MAZE, corner_markers(MAZE))
    assert apart_mm(done.camera) < 0.3
    assert apart_mm(done.camera, beta=0.08, gamma=-0.08) < 0.4


def test_a_board_that_lies_is_left_out_and_named():
    crooked = dict(boards())
    name = "board 3"
    picture = crooked[name]
    bent = cv2.warpPerspective(
        picture, np.array([[1.0, 0, 0], [0, 1, 0], [0, 4e-4, 1]]), (640, 480), borderValue=(120,) * 3
    )
    bent = np.roll(bent, 3, axis=1)
    rows = np.arange(480, dtype=np.float32)
    shear = np.stack(np.meshgrid(np.arange(640, dtype=np.float32), rows), axis=-1)
    shear[..., 0] += 6.0 * np.sin(rows / 40.0)[:, None]
    crooked[name] = cv2.remap(bent, shear[..., 0], shear[..., 1], cv2.INTER_LINEAR)
    lens = calibrate_lens(crooked.items(), CORNERS, SQUARE)
    assert len(lens.left_out) == 1
    assert lens.left_out[0].startswith(name)
    assert lens.matrix[0, 0] == pytest.approx(1200.0, rel=0.01)


def test_markers_that_lie_elsewhere_are_noticed():
    from dataclasses import replace

    markers = corner_markers(MAZE)
    places = dict(markers.places)
    places[0] = (places[0][0] - 0.01, places[0][1], 0.0)
    with pytest.raises(InputError, match="px off"):
        calibrate_plate(TRUE_LENS, plates(1), MAZE, replace(markers, places=places))


def test_tilt_from_exact_corners():
    markers = corner_markers(MAZE)
    points = np.vstack([markers.corners(number) for number in markers.places])
    for beta, gamma in ((0.0, 0.0), (0.087, -0.087), (-0.05, 0.02)):
        got = fit_tilt(TRUE, points, TRUE.project(points, beta, gamma))
        assert got[:2] == pytest.approx((beta, gamma), abs=1e-9)
        assert got[2] < 1e-6


def test_the_section_says_all_and_comes_back(tmp_path):
    data = mapping(FOUND, corner_markers(MAZE), source="video.avi", background="b.png", date="2026-01-02", error_px=0.3)
    section = validated(CameraSection, data)
    back = section.model()
    assert apart_mm(back, FOUND) < 0.001
    assert section.source == "video.avi"
    assert section.markers is not None
    assert section.markers.markers().places[2] == pytest.approx(corner_markers(MAZE).places[2], abs=1e-6)
    usual()[1].background.write(tmp_path / "b.png")
    finder = section.detector(MAZE, tmp_path)
    picture = usual()[0].render(np.array([0.0, 0.068, 0.00635]), 0.02, 0.03, np.random.default_rng(0))
    seen = finder.locate(picture)
    assert math.hypot((seen.x or 0.0), (seen.y or 0.0) - 0.068) < 0.0005


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"focal_px": [0.0, 1.0]}, "focal_px"),
        ({"colour": 1}, "unknown key, expected one of source"),
        ({"markers": {"at_mm": [[1, 2.0]]}}, "markers"),
        ({"turn_rad": None}, "turn_rad: missing"),
    ],
)
def test_sections_that_are_wrong_are_refused(change, said):
    with pytest.raises(SettingsError, match=said):
        validated(CameraSection, {**mapping(FOUND, None), **change})
