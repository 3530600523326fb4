"""The toy, which writes down when it was told what, by the wall: (s since the epoch, word, largest tilt in rad)."""

from __future__ import annotations

import os
from pathlib import Path
from time import time

import yaml

from mazeplan.rigs import registry
from mazeplan.rigs.files import validated
from mazeplan.rigs.sim.settings import SimulatedSettings
from mazeplan.rigs.sim.simulated import SimulatedRig

TOY = Path(registry.__file__).parent / "toy.yaml"


class TracedRig(SimulatedRig):
    def __init__(self, maze, settings):
        super().__init__(maze, validated(SimulatedSettings, yaml.safe_load(TOY.read_text(encoding="utf-8"))))
        self._trace = os.open(os.environ["MAZEPLAN_TRACE"], os.O_WRONLY | os.O_APPEND)

    def _note(self, word, size=0.0):
        os.write(self._trace, f"{time():.4f} {word} {size:.5f}\n".encode())

    def reset(self, **where):
        super().reset(**where)
        self._note("reset")

    def command(self, u_beta, u_gamma):
        super().command(u_beta, u_gamma)
        self._note("command", max(abs(u_beta), abs(u_gamma)))

    def level(self):
        super().level()
        self._note("level")
