"""The newest picture of a camera, from a thread that does nothing else: a camera keeps what nobody takes, and hands out
old pictures then."""

from __future__ import annotations

import threading
from collections.abc import Callable
from time import monotonic

from mazeplan.errors import MazeplanError, RigError
from mazeplan.rigs.camera.source import Frame, FrameSource


class Pictures:
    """Pictures of one source, opened by `make` in the thread that reads it."""

    def __init__(self, make: Callable[[], FrameSource], name: str) -> None:
        self._make, self._name = make, name
        self._news = threading.Condition()
        self._frame: Frame | None = None
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
        except Exception as error:  # anybody's driver may raise anything; who waits for a picture is told
            problem = f"{type(error).__name__}: {error}"
        finally:
            if self._source is not None:
                self._source.close()
        with self._news:
            self._problem = problem
            self._news.notify_all()

    def wait(self, after: float, until: float) -> Frame | None:
        """The newest picture that arrived later than `after`, or None when there is none by `until` (host's clock, s).
        Raises RigError when there will be none any more."""
        with self._news:
            while self._frame is None or self._frame.t <= after:
                if self._problem is not None and not self._closing:
                    raise RigError(f"camera {self._name}: {self._problem}")
                left = until - monotonic()
                if left <= 0.0:
                    return None
                self._news.wait(left)
            return self._frame

    def close(self) -> None:
        """End the thread; a driver that hangs is left behind."""
        self._closing = True
        if self._source is not None:
            self._source.close()
        self._thread.join(timeout=1.0)
