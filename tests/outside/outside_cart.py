"""What somebody else's package may add to mazeplan."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from mazeplan import MazeLeaf, Port, Status
from mazeplan.apps.testing.lightrig import LightRig
from mazeplan.physics import Effect, Parameter, sin

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


def wind_of_a_fan():
    return [
        Effect(
            "wind",
            {"force": Parameter("rad/s^2", 0.0, -5.0, 5.0, smallest=0.05)},
            formula=lambda s, p: -p.force * sin(s.theta),
            text="a fan that blows towards +x",
        )
    ]
