"""`calibrate camera`: from pictures to the rig's file."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from chessboards import board_poses, draw_board

from mazeplan.maze.mapfile import load_map
from mazeplan.maze.yamltree import read_yaml
from mazeplan.rigs.camera.markers import corner_markers
from mazeplan.rigs.camera.render import Overhead
from mazeplan.rigs.camera.section import camera_section
from mazeplan.rigs.camera.sensing import TRUE

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
    section = camera_section(read_yaml(tmp_path / "rig.yaml").data["camera"])
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
    # again, the lens as the file has it now, nothing written
    before = (tmp_path / "rig.yaml").read_text()
    status, out, err = calibrate("--plate", shots / "plate.png", "--dry-run", "--json")
    assert status == 0, err
    document = json.loads(out)
    assert document["rig"] is None
    assert document["error_mm"] < 0.5
    assert (tmp_path / "rig.yaml").read_text() == before


def test_marker_sheets_to_scale_with_a_ruler(calibrate, tmp_path):
    status, _, err = calibrate("--sheet", "markers.png")
    assert status == 0, err
    assert "wrote markers-1.png, markers-2.png; print at 100 %" in err
    finder = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    where = {}
    for page, wanted in ((1, {1, 2}), (2, {0, 3})):
        sheet = cv2.imread(str(tmp_path / f"markers-{page}.png"), cv2.IMREAD_GRAYSCALE)
        assert sheet is not None
        mm = 25.4 / 300.0
        assert sheet.shape[1] * mm <= 210.0 + mm  # A4
        assert sheet.shape[0] * mm <= 279.4 + mm  # US Letter
        rows, columns = np.nonzero(sheet < 250)
        ends = columns.min(), sheet.shape[1] - columns.max(), rows.min(), sheet.shape[0] - rows.max()
        assert min(ends) * mm > 9.0  # printers' margins
        corners, ids, _ = finder.detectMarkers(sheet)
        assert set(ids.ravel().tolist()) == wanted
        for number, four in zip(ids.ravel().tolist(), corners, strict=True):
            assert np.ptp(four[0][:, 0]) * mm == pytest.approx(24.0, abs=0.3)
            where[number] = four[0].mean(axis=0) * mm
        below = sheet[round(262.0 / mm) : round(264.0 / mm)] < 128  # the ruler is the longest line there
        assert max(np.ptp(np.nonzero(row)[0]) for row in below if row.any()) * mm == pytest.approx(100.0, abs=0.3)
    far = corner_markers(MAZE).places[0][0] * 2000.0
    assert where[0][1] < where[3][1]
    assert where[3][1] - where[0][1] == pytest.approx(far, abs=0.2)
    assert where[2][1] - where[1][1] == pytest.approx(far, abs=0.2)
