"""Starts the process of the emulated world (`world`), and receives its pictures."""

from __future__ import annotations

import contextlib
import json
import mmap
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import weakref
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np

from emulator.chip import how_it_ended, new_folder
from emulator.settings import WorldSettings
from emulator.world import SLOTS
from mazeplan.core.errors import RigError
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import dump_map
from mazeplan.rigs.camera.source import CameraFrame

START_S, END_S, ANSWER_S = 60.0, 1.0, 2.0  # time limits, s: of the start, of the end, of an answer
TOOLS = str(Path(__file__).resolve().parents[1])  # the folder from which `emulator` is imported
SIZE = (480, 640, 3)  # shape of a picture


def _end(process: subprocess.Popen[str], folder: Path) -> None:
    """Kill the world and its board, which is in the same process group, and remove their files."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(END_S)
    shutil.rmtree(folder, ignore_errors=True)


class EmulatedTable:
    """A running world, and the source of its pictures. Raises RigError if the world does not start.

    port: serial port of its board."""

    def __init__(self, maze: Maze, settings: WorldSettings) -> None:
        self._news = threading.Condition()
        self._said: dict[str, Any] = {}
        self._frame: CameraFrame | None = None
        self._given: CameraFrame | None = None
        self._ended = self._closed = self._gone = False
        self.lost = 0  # number of pictures that were lost, because this computer was too slow
        self.shown: list[tuple[float, float, float]] = []  # (exposed, handed out, received) of each picture
        bytes_each = int(np.prod(SIZE))
        with tempfile.TemporaryFile() as file:
            file.truncate(SLOTS * bytes_each)
            self._memory = mmap.mmap(file.fileno(), 0)
            self._process = subprocess.Popen(
                [sys.executable, "-m", "emulator.world", str(file.fileno())],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                bufsize=1,
                env={**os.environ, "PYTHONPATH": os.pathsep.join((TOOLS, *filter(None, sys.path)))},
                pass_fds=(file.fileno(),),
                process_group=0,  # Ctrl-C is for the program, which levels the plate first
            )
        folder = new_folder()
        # runs at the end of the program at the latest
        self._finish = weakref.finalize(self, _end, self._process, folder)
        threading.Thread(target=self._listen, name="mazeplan table", daemon=True).start()
        try:
            self.order({"map": dump_map(maze), "world": settings.model_dump(mode="json"), "folder": str(folder)})
            started = self._wait("ready", START_S) is not None
        except BaseException:
            self.close()
            raise
        if not started:
            problem = self.why if self._ended or "problem" in self._said else f"no answer in {START_S:g} s"
            self.close()
            raise RigError(f"the emulated rig does not start: {problem}")
        self.port: str = self._said["ready"]

    @property
    def process_id(self) -> int:
        """Of the world; its board is in the same process group."""
        return self._process.pid

    def order(self, document: dict[str, Any]) -> None:
        """Send an order. Raises RigError if the world has ended."""
        try:
            assert self._process.stdin is not None
            self._process.stdin.write(json.dumps(document) + "\n")
            self._process.stdin.flush()
        except (OSError, ValueError):
            raise RigError(self.why) from None

    def place(self, ring: int, theta: float, seed: int) -> None:
        """Put the ball to rest in a ring. seed: seed of the camera's noise."""
        self.order({"place": [ring, theta, seed]})

    def remove(self) -> None:
        """Take the ball away."""
        self.order({"remove": True})

    def tilt(self) -> tuple[float, float]:
        """The true tilt, rad, as an exact clinometer would show it."""
        with self._news:
            self._said.pop("tilt", None)
        self.order({"tilt": True})
        answer = self._wait("tilt", ANSWER_S)
        if answer is None:
            raise RigError("the emulated rig does not answer")
        return float(answer[0]), float(answer[1])

    @property
    def gone(self) -> bool:
        """Whether the world has ended by itself."""
        if not self._closed:
            self._gone = self._ended or "problem" in self._said
        return self._gone

    def ends_within(self, seconds: float) -> bool:
        """Whether the world has ended by itself, or does so within some seconds."""
        with self._news:
            return bool(self._news.wait_for(lambda: self.gone, seconds))

    @property
    def why(self) -> str:
        """Why the world ended."""
        return str(self._said.get("problem") or f"the emulated table {how_it_ended(self._process)}")

    def read(self) -> CameraFrame | None:
        """The next picture, or None after `close`. Raises RigError if the world has ended by itself."""
        with self._news:
            self._news.wait_for(lambda: self._ended or self.gone or self._frame is not self._given)
            if self.gone:
                raise RigError(self.why)
            if self._ended:
                return None
            self._given = self._frame
            return self._given

    def close(self) -> None:
        """End the world, even if it hangs. A second call does nothing."""
        with self._news:
            gone = self.gone  # only an end before this call counts as an end by itself
            self._gone, self._ended, self._closed = gone, True, True
            self._news.notify_all()
        with contextlib.suppress(RigError):
            self.order({"end": True})
        with contextlib.suppress(OSError, ValueError):
            if self._process.stdin is not None:
                self._process.stdin.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(END_S)
        self._finish()

    def _wait(self, word: str, seconds: float) -> Any:
        with self._news:
            self._news.wait_for(lambda: word in self._said or self._ended or "problem" in self._said, seconds)
            return self._said.get(word)

    def _listen(self) -> None:
        stdout = self._process.stdout
        assert stdout is not None
        size = int(np.prod(SIZE))
        with contextlib.suppress(ValueError), stdout:
            for line in stdout:
                document = json.loads(line)
                slot = document.get("frame")
                with self._news:
                    if slot is None:
                        self._said.update(document)
                    else:
                        now = monotonic()
                        raw = self._memory[slot * size : (slot + 1) * size]
                        self._frame = CameraFrame(np.frombuffer(raw, dtype=np.uint8).reshape(SIZE), now)
                        self.lost = document["lost"]
                        self.shown.append((document["exposed"], document["out"], now))
                    self._news.notify_all()
        with self._news:
            self._ended = True
            self._news.notify_all()
