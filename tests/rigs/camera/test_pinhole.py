"""The lens and the tilting plate, against OpenCV's own projection and against numbers worked out by hand."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from emulator.render import TRUE, tilting

from mazeplan.rigs.camera.pinhole import CameraModel


def straight_down(height=0.6, focal=1000.0, pivot=(0.0, 0.0, 0.0)):
    matrix = np.array([[focal, 0.0, 320.0], [0.0, focal, 240.0], [0.0, 0.0, 1.0]])
    return CameraModel(
        matrix, np.zeros(5), np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, height]), pivot=np.array(pivot)
    )


def test_same_pixels_as_opencv_with_all_of_the_lens():
    lens = np.array([-0.2, 0.15, 0.002, -0.003, 0.05])
    camera = CameraModel(TRUE.matrix, lens, TRUE.rotation, TRUE.translation, pivot=np.array([0.01, 0.0, -0.02]))
    points = np.random.default_rng(0).uniform([-0.1, -0.1, 0.0], [0.1, 0.1, 0.02], (50, 3))
    beta, gamma = 0.07, -0.05
    pose = np.hstack([camera.rotation, camera.translation[:, None]]) @ tilting(beta, gamma, camera.pivot)
    turn, _ = cv2.Rodrigues(np.ascontiguousarray(pose[:, :3]))
    theirs, _ = cv2.projectPoints(points, turn, pose[:, 3], camera.matrix, lens)
    assert np.abs(camera.project(points, beta, gamma) - theirs.reshape(-1, 2)).max() < 1e-6


def test_signs_of_beta_and_gamma_in_the_picture():
    camera = straight_down()
    level = camera.project(np.array([[0.1, 0.0, 0.0], [0.0, 0.1, 0.0]]))
    lowered = camera.project(np.array([[0.1, 0.0, 0.0]]), beta=0.08)[0]
    lifted = camera.project(np.array([[0.0, 0.1, 0.0]]), gamma=0.08)[0]
    assert lowered[0] == pytest.approx(320.0 + 1000.0 * 0.1 * math.cos(0.08) / (0.6 + 0.1 * math.sin(0.08)))
    assert lowered[0] < level[0, 0]
    assert lifted[1] == pytest.approx(240.0 - 1000.0 * 0.1 * math.cos(0.08) / (0.6 - 0.1 * math.sin(0.08)))
    assert lifted[1] < level[1, 1]


def test_the_pivot_stays_where_it_is():
    pivot = (0.02, -0.01, -0.03)
    camera = straight_down(pivot=pivot)
    here = np.array([pivot])
    assert camera.project(here, 0.08, -0.06)[0] == pytest.approx(camera.project(here)[0])
    assert np.linalg.norm(camera.project(np.zeros((1, 3)), 0.08, -0.06) - camera.project(np.zeros((1, 3)))) > 1.0


def test_the_centre_is_where_all_lines_of_sight_begin():
    beta, gamma = 0.06, -0.08
    eye = TRUE.centre(beta, gamma)
    assert TRUE.to_camera(eye[None], beta, gamma)[0] == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
    point = np.array([0.05, -0.07, 0.006])
    halfway = eye + 0.5 * (point - eye)
    both = TRUE.project(np.array([point, halfway]), beta, gamma)
    assert both[0] == pytest.approx(both[1], abs=1e-9)
