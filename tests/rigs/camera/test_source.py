"""Pictures from files, videos and cameras that fail."""

from __future__ import annotations

import threading
import time

import cv2
import numpy as np
import pytest

from mazeplan.core.errors import RigError
from mazeplan.rigs.camera import source as room
from mazeplan.rigs.camera.source import NewestPicture, VideoSource, pictures


@pytest.fixture
def video(tmp_path):
    path = tmp_path / "v.avi"
    out = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 30, (64, 48))
    for i in range(10):
        out.write(np.full((48, 64, 3), 20 * i, np.uint8))
    out.release()
    return path


def test_a_video_gives_every_picture_in_order_and_then_none(video):
    reader = VideoSource(str(video))
    levels = []
    while (frame := reader.read()) is not None:
        levels.append(frame.image.mean())
    reader.close()
    reader.close()
    assert np.round(np.array(levels) / 20.0).tolist() == list(range(10))


def test_folders_patterns_and_files(tmp_path):
    for i in range(3):
        cv2.imwrite(str(tmp_path / f"{i}.png"), np.full((4, 4, 3), i, np.uint8))
    (tmp_path / "note.txt").write_text("no picture")
    assert [image[0, 0, 0] for _, image in pictures(str(tmp_path), 9)] == [0, 1, 2]
    assert [image[0, 0, 0] for _, image in pictures(str(tmp_path / "[12].png"), 9)] == [1, 2]
    assert [image[0, 0, 0] for _, image in pictures(str(tmp_path / "2.png"), 9)] == [2]


def test_a_camera_that_is_not_there_fails_the_rig():
    with pytest.raises(RigError, match="camera 97 cannot be opened"):
        VideoSource(97)


class FakeCapture:
    """A camera that gives what it is told, then nothing, then hangs up."""

    def __init__(self, count, last):
        self.count, self.last, self.given, self.released = count, last, 0, 0

    def isOpened(self):  # noqa: N802 (OpenCV's name)
        return True

    def set(self, *_):
        return True

    def read(self):
        if self.given < self.count:
            self.given += 1
            return True, np.full((2, 2, 3), self.given, np.uint8)
        if self.last == "silent":
            time.sleep(0.5)
        return False, None

    def release(self):
        self.released += 1


def camera(monkeypatch, count, last):
    monkeypatch.setattr(room.cv2, "VideoCapture", lambda _: FakeCapture(count, last))
    return VideoSource(0, (640, 480))


def test_a_camera_that_stops_fails_the_rig(monkeypatch):
    reader = camera(monkeypatch, 0, "gone")
    with pytest.raises(RigError, match="stopped sending pictures"):
        reader.read()


def test_the_newest_picture_counts(monkeypatch):
    newest = NewestPicture(lambda: camera(monkeypatch, 5, "silent"), "fake")
    time.sleep(0.2)  # five have come, none was fetched
    frame = newest.wait(0.0, time.monotonic() + 1.0)
    assert frame is not None
    assert frame.image[0, 0, 0] == 5
    assert abs(time.monotonic() - frame.t) < 2.0
    assert newest.wait(frame.t, time.monotonic() + 0.1) is None
    newest.close()


def test_the_camera_is_released_by_the_read_under_way(monkeypatch):
    reader = camera(monkeypatch, 0, "silent")
    threading.Timer(0.1, reader.close).start()
    assert reader.read() is None
    assert reader._video.released == 1
    reader.close()
