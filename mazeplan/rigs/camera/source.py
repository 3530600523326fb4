"""Sources of pictures: a device, a URL, a video file or picture files, all through OpenCV."""

from __future__ import annotations

import glob
import os
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from mazeplan.core import file_kinds
from mazeplan.core.errors import InputError, MazeplanError, RigError
from mazeplan.maze.yamltree import shown

ADVICE = "is it plugged in or its address right, and is it used by nothing else?"
SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")


@dataclass(frozen=True, slots=True)
class CameraFrame:
    """A picture."""

    image: np.ndarray  # (height, width, 3), uint8, BGR
    t: float  # when it arrived, monotonic clock, s


class FrameSource(Protocol):
    """A source of pictures. `close` may come from another thread while `read` waits."""

    def read(self) -> CameraFrame | None:
        """Block until the next picture; None at the end."""

    def close(self) -> None:
        """Release the camera. A second call does nothing."""


class VideoSource:
    """All pictures of a camera, a stream or a video file, in order. count: their number; 0: unknown.

    Raises InputError for a file that is no video, RigError for a camera that cannot be opened or stops sending."""

    def __init__(self, source: int | str, size: tuple[int, int] | None = None) -> None:
        self.source = source
        self._closed = False
        self._reading = threading.Lock()
        self._file = isinstance(source, str) and "://" not in source and not source.startswith("/dev/")
        if self._file and not Path(str(source)).is_file():
            raise InputError(file_kinds.refused(str(source), "a video"), file=str(source))
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # this class reports errors in one line
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        self._video = cv2.VideoCapture(source)
        if not self._video.isOpened():
            if self._file:
                raise InputError(file_kinds.refused(str(source), "a video that OpenCV can read"), file=str(source))
            raise RigError(f"camera {shown(source)} cannot be opened; {ADVICE}")
        self.count = int(self._video.get(cv2.CAP_PROP_FRAME_COUNT)) if self._file else 0
        if size is not None and not self._file:
            self._video.set(cv2.CAP_PROP_FRAME_WIDTH, size[0])
            self._video.set(cv2.CAP_PROP_FRAME_HEIGHT, size[1])
            self._video.set(cv2.CAP_PROP_BUFFERSIZE, 1)

    def read(self) -> CameraFrame | None:
        """The next picture; None at the end of a file, and after `close`."""
        with self._reading:
            got, image = (False, None) if self._closed else self._video.read()
        if self._closed:
            self._video.release()
            return None
        if not got and not self._file:
            raise RigError(f"camera {shown(self.source)} stopped sending pictures; {ADVICE}")
        # wall clock: a camera has no other, and the rig's clock begins from it
        return None if image is None or not got else CameraFrame(image, time.monotonic())

    def close(self) -> None:
        """Release the camera, or let the `read` under way release it. A second call does nothing."""
        self._closed = True
        if self._reading.acquire(blocking=False):
            self._video.release()
            self._reading.release()


class NewestPicture:
    """The newest picture of a source. A thread opens the source with `make` and reads it all the time.

    The thread is needed because a camera keeps unread pictures, and would give old pictures later."""

    def __init__(self, make: Callable[[], FrameSource], name: str) -> None:
        self._make = make
        self._name = name
        self._news = threading.Condition()
        self._frame: CameraFrame | None = None
        self._problem: str | None = None
        self._source: FrameSource | None = None
        self._closing = False
        self._thread = threading.Thread(target=self._work, name="mazeplan camera", daemon=True)
        self._thread.start()

    def _work(self) -> None:
        try:
            self._source = self._make()
            while not self._closing:
                frame = self._source.read()
                if frame is None:
                    break
                with self._news:
                    self._frame = frame
                    self._news.notify_all()
            problem = "gives no more pictures"
        except MazeplanError as error:
            problem = str(error)
        except Exception as error:  # a driver may raise anything; `wait` raises it again
            problem = f"{type(error).__name__}: {error}"
        finally:
            if self._source is not None:
                self._source.close()
        with self._news:
            self._problem = problem
            self._news.notify_all()

    def wait(self, after: float, until: float) -> CameraFrame | None:
        """A picture that arrived later than `after`; None if none has come by `until`. Host's clock, s.

        Raises RigError if the source has ended."""
        with self._news:  # wall clock, because this waits for a device
            self._news.wait_for(lambda: self._problem or self._newer(after), max(0.0, until - time.monotonic()))
            if self._problem is not None and not self._closing and self._newer(after) is None:
                raise RigError(f"camera {self._name}: {self._problem}")
            return self._newer(after)

    def _newer(self, after: float) -> CameraFrame | None:
        return None if self._frame is None or self._frame.t <= after else self._frame

    def close(self) -> None:
        """End the thread. Does not wait longer than 1 s, because a driver may hang."""
        self._closing = True
        if self._source is not None:
            self._source.close()
        self._thread.join(timeout=1.0)


def pictures(source: str, most: int, size: tuple[int, int] | None = None) -> Iterator[tuple[str, np.ndarray]]:
    """(name, picture) for each picture of a source. Raises InputError or RigError.

    source: a folder, a pattern such as boards/*.png, a picture file, a video, a URL or the number of a device.
    most: largest number of pictures; a video gives pictures at even distances.
    size: width and height to request from a device, px; None: the device's own."""
    device = source.isdigit() or "://" in source  # the address of a camera may end in .jpg or contain "?"
    path = Path(source)
    names = [] if device else sorted(path.iterdir() if path.is_dir() else map(Path, glob.glob(source) or [source]))
    names = [name for name in names if name.suffix.lower() in SUFFIXES]
    for name in names[:most]:
        image = cv2.imread(str(name)) if name.is_file() else None
        if image is None:
            raise InputError(file_kinds.refused(name, "a picture that OpenCV can read"), file=name)
        yield str(name), image
    if names:
        return
    if path.is_dir():
        raise InputError(f"got a folder without pictures, expected some ({', '.join(SUFFIXES)})", file=source)
    video = VideoSource(int(source) if source.isdigit() else source, size)
    try:
        apart = max(1, video.count // most)
        given = index = 0
        while given < most and (frame := video.read()) is not None:
            if index % apart == 0:
                given += 1
                yield f"{source}: picture {index}", frame.image
            index += 1
    finally:
        video.close()
