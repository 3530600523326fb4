"""An effect of somebody else."""

from __future__ import annotations

from mazeplan.physics import Effect, Parameter, sin


def wind_of_a_fan():
    return [
        Effect(
            "wind",
            {"force": Parameter("rad/s^2", 0.0, -5.0, 5.0, smallest=0.05)},
            formula=lambda s, p: -p.force * sin(s.theta),
            text="a fan that blows towards +x",
        )
    ]
