"""Where the ball is in a picture, or why nobody can say; the camera that looks is a calibrated one, not the true
one."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

import cv2
import numpy as np
import pytest
from emulator.look import Look
from emulator.render import TRUE
from scenes import FOUND, MAZE, STANDARD, orange, overlooking, place, usual

from mazeplan.rigs.camera.detector import BallDetector, DetectionOutcome
from mazeplan.rigs.camera.pinhole import corner_markers


def pictures(eye, seed=0, others=()):
    rng = np.random.default_rng(seed)
    return [(eye.render(ball, beta, gamma, rng, others=others), ball, beta, gamma) for ball, beta, gamma in STANDARD]


def errors_mm(finder, shots):
    out = []
    for picture, ball, _, _ in shots:
        seen = finder.locate(picture)
        assert seen.why is DetectionOutcome.FOUND, seen
        assert seen.x is not None
        assert seen.y is not None
        out.append(1000.0 * math.hypot(seen.x - ball[0], seen.y - ball[1]))
    return np.array(out)


def test_a_steel_ball_is_found_everywhere():
    eye, finder = usual()
    errors = errors_mm(finder, pictures(eye))
    assert math.sqrt((errors**2).mean()) < 0.15
    assert errors.max() < 0.4


def test_a_coloured_ball_is_found():
    eye, finder = orange()
    assert errors_mm(finder, pictures(eye)[::2]).max() < 0.4


@pytest.mark.slow
@pytest.mark.parametrize(
    "look",
    [
        replace(Look(), exposure=0.5),
        replace(Look(), flicker=0.3),
        replace(Look(), slope=0.7),
        replace(Look(), lamp=(0.3, -0.3, 0.9)),
        replace(Look(), noise=7.0),
    ],
    ids=["half the light", "flicker", "one side bright", "lamp elsewhere", "noise"],
)
def test_light_that_changed_since_the_calibration(look):
    _, finder = usual()
    shots = pictures(overlooking(look))[::2]
    found = [finder.locate(picture) for picture, *_ in shots]
    near = [
        1000.0 * math.hypot(s.x - ball[0], s.y - ball[1])
        for s, (_, ball, _, _) in zip(found, shots, strict=True)
        if s.x is not None and s.y is not None
    ]
    assert len(near) >= len(shots) - 1
    assert max(near) < 0.6


def test_no_ball():
    eye, finder = usual()
    rng = np.random.default_rng(0)
    for _, beta, gamma in STANDARD[::2]:
        seen = finder.locate(eye.render(None, beta, gamma, rng))
        assert (seen.x, seen.y) == (None, None)
        assert seen.why in (DetectionOutcome.NO_BALL, DetectionOutcome.UNSURE)
        assert seen.confidence == 0.0
        assert seen.beta is not None


def test_two_balls_are_none():
    eye, finder = usual()
    words = Counter()
    for picture, *_ in pictures(eye, others=(place(4, 215.0),))[:7]:
        seen = finder.locate(picture)
        assert seen.x is None
        words[seen.why] += 1
    assert words[DetectionOutcome.TWO] >= 6


def test_dark():
    _, finder = usual()
    for share in (0.0, 0.05, 0.15):
        picture = overlooking(replace(Look(), exposure=share)).render(
            place(1, 20.0), 0.0, 0.0, np.random.default_rng(0)
        )
        seen = finder.locate(picture)
        assert (seen.x, seen.why) == (None, DetectionOutcome.DARK)


def veiled(picture, at, radius=12.0, strength=0.9):
    rows, columns = np.ogrid[: picture.shape[0], : picture.shape[1]]
    square = (columns - at[0]) ** 2 + (rows - at[1]) ** 2
    return np.clip(picture + (255.0 * strength / (1.0 + (square / radius**2) ** 3))[..., None], 0, 255).astype(np.uint8)


@pytest.mark.slow
def test_a_bright_spot_is_never_taken_for_the_ball():
    eye, finder = usual()
    found = 0
    for picture, ball, beta, gamma in pictures(eye):
        at = TRUE.project(ball[None], beta, gamma)[0]
        elsewhere = TRUE.project(-ball[None] * (1, 1, -1), beta, gamma)[0]
        for spot in (at + np.array([10.0, 0.0]), at - np.array([0.0, 10.0]), elsewhere):
            seen = finder.locate(veiled(picture, spot))
            if seen.x is not None and seen.y is not None:
                found += 1
                assert math.hypot(seen.x - ball[0], seen.y - ball[1]) < 0.001
    assert found > 15


def test_shadows_alone_are_no_ball():
    # the lamp stands low: long shadows of the walls wander over the floor when the plate tilts
    _, finder = usual()
    eye = overlooking(replace(Look(), lamp=(0.5, -0.4, 0.7), gloss=0.0))
    rng = np.random.default_rng(0)
    for _, beta, gamma in STANDARD:
        seen = finder.locate(eye.render(None, beta, gamma, rng))
        assert seen.x is None, seen


def test_half_a_ball_under_a_hand_is_right_or_none():
    eye, finder = usual()
    for picture, ball, beta, gamma in pictures(eye):
        at = TRUE.project(ball[None], beta, gamma)[0]
        tip = (round(at[0] + 15.0), round(at[1]))
        cv2.line(picture, tip, (tip[0] + 300, tip[1]), (120, 150, 205), 30, cv2.LINE_AA)
        seen = finder.locate(picture)
        if seen.x is not None and seen.y is not None:
            assert math.hypot(seen.x - ball[0], seen.y - ball[1]) < 0.0015


def test_without_markers_the_tilt_is_taken_as_told():
    eye, finder = usual()
    blind = BallDetector(MAZE, FOUND, finder.background, None)
    ball, beta, gamma = STANDARD[1]
    picture = eye.render(ball, beta, gamma, np.random.default_rng(0))
    assert blind.locate(picture).why is DetectionOutcome.NO_MARKERS
    seen = blind.locate(picture, (beta, gamma))
    assert seen.beta is None
    assert seen.x is not None
    assert math.hypot(seen.x - ball[0], (seen.y or 0.0) - ball[1]) < 0.0005


def test_a_camera_that_was_pushed_says_so():
    _, finder = usual()
    pushed = overlooking(Look()).render(place(2, 30.0), 0.0, 0.0, np.random.default_rng(0))
    pushed = np.roll(pushed, 6, axis=1)
    pushed = cv2.warpAffine(pushed, cv2.getRotationMatrix2D((320, 240), 1.5, 1.0), (640, 480))
    assert finder.locate(pushed).why is DetectionOutcome.MOVED


def test_half_of_the_markers_are_enough():
    eye, finder = usual()
    ball, beta, gamma = STANDARD[3]
    picture = eye.render(ball, beta, gamma, np.random.default_rng(0))
    for number in (0, 2):
        at = TRUE.project(np.array([corner_markers(MAZE).places[number]]))[0]
        cv2.circle(picture, (round(at[0]), round(at[1])), 40, (90, 90, 90), -1)
    seen = finder.locate(picture)
    assert seen.x is not None
    assert math.hypot(seen.x - ball[0], (seen.y or 0.0) - ball[1]) < 0.0005
