"""`calibrate camera`: from pictures to the rig's file."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from chessboards import board_poses, draw_board
from emulator.render import TRUE, Overhead

from mazeplan.maze.mapfile import load_map
from mazeplan.maze.yamltree import read_yaml
from mazeplan.rigs.files import validated
from mazeplan.rigs.hardware.settings import CameraSection

MAZE = load_map("cme")
RIG = """# the rig in room 3
class: mazeplan.rigs.hardware:HardwareRig
camera:
  source: 0   # the grey one
port: auto  # stays
"""


@pytest.fixture(scope="module")
def shots(tmp_path_factory):
    """A folder with pictures of chessboards, a video of the empty plate, one picture of it."""
    folder = tmp_path_factory.mktemp("shots")
    (folder / "boards").mkdir()
    rng = np.random.default_rng(5)
    for i, pose in enumerate(board_poses(TRUE, (7, 5), 0.025, 6, rng)):
        cv2.imwrite(str(folder / "boards" / f"{i}.png"), draw_board(TRUE, (7, 5), 0.025, *pose, rng))
    eye = Overhead(MAZE, TRUE)
    video = cv2.VideoWriter(str(folder / "plate.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 30, (640, 480))
    for _ in range(4):
        video.write(eye.render(None, 0.0, 0.0, rng))
    video.release()
    cv2.imwrite(str(folder / "plate.png"), eye.render(None, 0.0, 0.0, rng))
    return folder


@pytest.fixture
def calibrate(call, monkeypatch, tmp_path):
    """`calibrate camera` in a folder of its own with a rig's file."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rig.yaml").write_text(RIG)
    return lambda *words: call("calibrate", "camera", "--rig", "rig.yaml", *words)


@pytest.mark.slow
def test_from_pictures_to_the_rigs_file(calibrate, shots, tmp_path):
    words = ("--boards", shots / "boards", "--corners", "7x5", "--square-mm", 25, "--plate", shots / "plate.avi")
    status, out, err = calibrate(*words)
    assert status == 0, err
    assert "over 6 pictures" in out
    text = (tmp_path / "rig.yaml").read_text()
    assert text.startswith("# the rig in room 3")
    assert "port: auto  # stays" in text
    assert "  source: 0   # the grey one" in text
    section = validated(CameraSection, read_yaml(tmp_path / "rig.yaml").data["camera"])
    assert section.source == 0
    assert section.date is not None
    camera = section.model()
    balls = np.array([[0.089, 0.0, 0.006], [0.0, -0.089, 0.006]])
    assert np.abs(camera.project(balls, 0.05, -0.05) - TRUE.project(balls, 0.05, -0.05)).max() < 0.6
    ball = np.array([-0.04879, 0.0, 0.00635])
    picture = Overhead(MAZE, TRUE).render(ball, 0.03, 0.02, np.random.default_rng(0))
    seen = section.detector(MAZE, tmp_path).locate(picture)
    assert seen.x is not None
    assert abs(seen.x - ball[0]) < 0.0005
    # again, the lens as the file has it now
    status, out, err = calibrate("--plate", shots / "plate.png")
    assert status == 0, err
    assert validated(CameraSection, read_yaml(tmp_path / "rig.yaml").data["camera"]).error_mm < 0.5
