"""What every rig must do. A rig owns the clock: nothing else reads wall time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np

from mazeplan.maze.geometry import Maze
from mazeplan.records import Observation


@runtime_checkable
class Rig(Protocol):
    """A plate that tilts, with a ball that is seen.

    Signs: positive beta lowers the +x side, so a ball at theta = 90 deg is pushed towards theta = 0; positive gamma
    lifts the +y side, so a ball at theta = 0 is pushed towards negative theta.

    A rig is watched: it must give a sample and take a command in time (`watchdog`). A simulation that waits for nobody
    says `realtime = False`.

    It may also say `latency`, a `records.Latency` that was measured of it and counts for more than its model's, and
    `unseen_s`: a run ends when the ball was not seen for so long. With a method `ready` it is asked, before a log is
    opened, whether it could be driven: where not, that raises SettingsError. With a method `begin_run` it is told
    before each run of `evaluate` which one comes, from 1 on.
    """

    rate_hz: float

    def __init__(self, maze: Maze, settings: Mapping[str, Any]) -> None:
        """Keep the settings; open nothing yet."""
        ...

    def reset(self, *, ring: int, theta: float, rng: np.random.Generator) -> None:
        """Place the ball (a person does it on hardware), level the plate, set time to 0."""
        ...

    def observe(self) -> Observation:
        """Block until the next sample, 1 / rate_hz after the last one, and return it."""
        ...

    def command(self, u_beta: float, u_gamma: float) -> None:
        """Command a tilt in rad; it is held until the next command."""
        ...

    def level(self) -> None:
        """Safe state: plate level, now."""
        ...

    def close(self) -> None:
        """Give the machine back; may be called twice."""
        ...


def check_ready(rig: Rig) -> None:
    """Ask a rig that can be asked whether it could be driven. Raises SettingsError."""
    ready = getattr(rig, "ready", None)
    if callable(ready):
        ready()
