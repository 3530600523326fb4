"""A trial of a map: one simulated navigation on its file, by `mazeplan navigate` in a process of its own.

The page goes on meanwhile, whatever the run does. The log of the run is in a temporary folder, which is removed after
the run.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np

from mazeplan.apps.view.story import moments
from mazeplan.core.errors import MazeplanError
from mazeplan.core.logs.run_log_reader import read_messages
from mazeplan.core.records import Array

END_S = 5.0  # s that a run has to level the plate and end


class Trial:
    """A run that has begun, from ring 1 to the centre.

    command: the command that repeats the run
    said: the newest line of the run, then its outcome
    over: whether the run has ended
    arrived: whether the ball arrived
    path: places of the ball, (N, 2), m, once the run is over

    Raises OSError if no process can be started."""

    def __init__(self, file: Path, rig: str, seed: int) -> None:
        words = ["navigate", "--map", str(file), "--rig", rig, "--seed", str(seed)]
        self.command = f"mazeplan navigate --map {file.name} --rig {rig} --seed {seed}"
        self.said, self.over, self.arrived, self.path = "reading map and model", False, False, np.empty((0, 2))
        self._folder = tempfile.TemporaryDirectory(prefix="mazeplan-")
        self._log, self._answer = (Path(self._folder.name) / name for name in ("trial.mcap", "answer.json"))
        self._stopped = False
        with self._answer.open("wb") as answer:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "mazeplan", *words, "--log", str(self._log), "--json"],
                stdout=answer, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True, encoding="utf-8",
            )  # fmt: skip
        self._thread = Thread(target=self._watch, name="mazeplan trial", daemon=True)
        self._thread.start()

    def _watch(self) -> None:
        for line in self._process.stderr or ():
            self.said = " ".join(line.split()) or self.said
        status, answer = self._process.wait(), self._answer.read_text(encoding="utf-8")
        if self._stopped:
            self.said = "stopped"
        elif status in (0, 1) and answer:
            self.said = _verdict(json.loads(answer))
        self.arrived, self.path = status == 0, _path(self._log)
        self._folder.cleanup()
        self.over = True

    def stop(self) -> None:
        """Ask the run to end, and return at once. Does nothing if the run is over."""
        if self._process.poll() is None:
            self._stopped, self.said = True, "stopping"
            self._process.terminate()

    def close(self) -> None:
        """End the run."""
        self.stop()
        self._thread.join(END_S)
        self._process.kill()
        self._thread.join(END_S)


def _verdict(document: dict[str, Any]) -> str:
    """How the run ended, in words. document: what `navigate --json` printed"""
    passed = [ring["opening"] for ring in document["rings"] if ring["opening"]]
    word = "arrived" if document["success"] else document["reason"].replace("_", " ")
    return f"{word} after {document['time_s']:.1f} s" + (f", by {', '.join(passed)}" if passed else "")


def _path(log: Path) -> Array:
    """Places of the ball in a log, (N, 2), m; empty for a run that left no readable log."""
    try:
        _, messages, _ = read_messages(log)
        balls = [moment.ball for moment in moments(messages)]
    except MazeplanError:
        return np.empty((0, 2))
    return np.array([(ball.x, ball.y) for ball in balls if ball is not None]).reshape(-1, 2)
