"""Where pictures come from: a device, a URL, a video file or picture files, all through OpenCV."""

from __future__ import annotations

import glob
import os
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from mazeplan import filekinds
from mazeplan.errors import InputError, RigError
from mazeplan.maze.yamltree import shown

PATIENCE = 5.0  # s without a picture from a device before it counts as failed
SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")


@dataclass(frozen=True, slots=True)
class Frame:
    """image (height, width, 3) uint8 BGR; t: when it was taken, s of the monotonic clock."""

    image: np.ndarray
    t: float


class FrameSource(Protocol):
    """Something that gives pictures."""

    def read(self) -> Frame | None:
        """The next picture; blocks; None when there are no more."""
        ...

    def close(self) -> None:
        """Give the camera back; may be called twice."""
        ...


class VideoSource:
    """A camera or a stream, of which the newest picture counts; a video file gives all of its pictures in order.

    A thread of its own takes pictures from a camera as they come, so that none waits in a queue. Raises InputError for
    a file that is none, RigError for a camera that cannot be opened or falls silent."""

    def __init__(self, source: int | str, size: tuple[int, int] | None = None, *, patience_s: float = PATIENCE) -> None:
        self.source, self._patience = source, patience_s
        self._file = isinstance(source, str) and "://" not in source and not source.startswith("/dev/")
        if self._file and not Path(str(source)).is_file():
            raise InputError(filekinds.refused(str(source), "a video"), file=str(source))
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # what is wrong is said here, in one line
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        self._video = cv2.VideoCapture(source)
        if not self._video.isOpened():
            if self._file:
                raise InputError(filekinds.refused(str(source), "a video that OpenCV can read"), file=str(source))
            raise RigError(f"camera {shown(source)} cannot be opened; {_advice(source)}")
        if size is not None and not self._file:
            self._video.set(cv2.CAP_PROP_FRAME_WIDTH, size[0])
            self._video.set(cv2.CAP_PROP_FRAME_HEIGHT, size[1])
            self._video.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        self._news = threading.Condition()
        self._newest: Frame | None = None
        self._ended = self._closed = False
        if not self._file:
            threading.Thread(target=self._follow, name="camera", daemon=True).start()

    def _follow(self) -> None:
        while not self._ended:
            got, image = self._video.read()
            with self._news:
                if self._ended or not got:
                    self._ended = True
                else:
                    self._newest = Frame(image, time.monotonic())
                self._news.notify_all()
        self._video.release()

    def read(self) -> Frame | None:
        """The next picture of a file, None at its end; of a camera one that was not read before, None once it is
        closed, by whatever thread."""
        if self._file:
            got, image = self._video.read()
            return Frame(image, time.monotonic()) if got else None
        with self._news:
            if not self._news.wait_for(lambda: self._newest is not None or self._ended, self._patience):
                raise RigError(f"camera {shown(self.source)} has sent no picture for {self._patience:g} s")
            newest, self._newest = self._newest, None
        if newest is None and not self._closed:
            raise RigError(f"camera {shown(self.source)} stopped sending pictures; {_advice(self.source)}")
        return newest

    def close(self) -> None:
        """Give the camera back; may be called twice."""
        with self._news:
            self._ended = self._closed = True
            self._news.notify_all()
        if self._file:
            self._video.release()


def _advice(source: int | str) -> str:
    """What to try where a camera does not open."""
    if isinstance(source, str) and "://" in source:
        return "does that address show pictures in a browser or player on this machine, and is it one stream of video?"
    return "is it plugged in, and used by nothing else?"


def pictures(source: str, most: int) -> Iterator[tuple[str, np.ndarray]]:
    """(name, picture) from a folder, a pattern such as boards/*.png, one picture file, a video, a URL or the number of
    a device; `most` at most, those of a video evenly apart. Raises InputError or RigError."""
    names = _files(source)
    if names is not None:
        for name in names[:most]:
            image = cv2.imdecode(np.frombuffer(Path(name).read_bytes(), np.uint8), cv2.IMREAD_COLOR)
            if image is None:
                raise InputError(filekinds.refused(name, "a picture that OpenCV can read"), file=name)
            yield name, image
        return
    if not (source.isdigit() or "://" in source or Path(source).exists()):
        raise InputError("no such file, expected a folder of pictures, a picture or a video", file=source)
    video = VideoSource(int(source) if source.isdigit() else source)
    try:
        count = int(video._video.get(cv2.CAP_PROP_FRAME_COUNT)) if video._file else 0
        apart = max(1, count // most)
        given = index = 0
        while given < most and (frame := video.read()) is not None:
            if index % apart == 0:
                given += 1
                yield f"{source}: picture {index}", frame.image
            index += 1
    finally:
        video.close()


def _files(source: str) -> list[str] | None:
    """Picture files that a source names, or None for a video or a camera. Raises InputError when there are none."""
    path = Path(source)
    if path.is_dir():
        names = sorted(str(p) for p in path.iterdir() if p.suffix.lower() in SUFFIXES)
        if not names:
            raise InputError(f"got a folder without pictures, expected some ({', '.join(SUFFIXES)})", file=source)
        return names
    if any(sign in source for sign in "*?["):
        names = sorted(glob.glob(source))
        if not names:
            raise InputError("no such files, expected pictures", file=source)
        return names
    if path.suffix.lower() in SUFFIXES:
        if not path.is_file():
            raise InputError("no such file, expected a picture", file=source)
        return [source]
    return None
