"""What somebody else's package may add to mazeplan."""

from __future__ import annotations

import math
from pathlib import Path
from typing import ClassVar

from numba import njit

from mazeplan import MazeLeaf, Port, Status
from mazeplan.diagnosis.library import Candidate, Spec
from mazeplan.testing.lightrig import LightRig

SLOW = Path(__file__).with_name("slow_cart.yaml")


class Cart(LightRig):
    """A rig by name."""


class Nap(MazeLeaf):
    """Leave the plate level for some ticks."""

    ports: ClassVar = {"ticks": Port(int, 3, "how many", least=1)}

    def start(self):
        self.left = self.get("ticks")

    def step(self):
        self.left -= 1
        self.context.on_event("nap", {"left": self.left})
        return Status.RUNNING if self.left else Status.SUCCESS


@njit(cache=True)
def _wind(x, v, t, w, p):
    return -p[0] * math.sin(x)


def wind_of_a_fan():
    return [Candidate("wind", {"force": Spec("rad/s^2", 0.0, -5.0, 5.0, 1e-3, 0.05)}, term=_wind)]
