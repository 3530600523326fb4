"""The interface of every rig. A rig owns the clock: decisions depend on its time alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, Protocol, runtime_checkable

import numpy as np

from mazeplan.core.errors import RigError
from mazeplan.core.records import Array, Latency, Observation
from mazeplan.maze.geometry import Maze

TOLERANCE = 1e-9  # rad by which a command may exceed the tilt limit


@runtime_checkable
class Rig(Protocol):
    """A plate that tilts, and a camera that sees the ball on it.

    Signs: positive beta lowers the +x side and pushes a ball at theta = 90 deg towards theta = 0. Positive gamma lifts
    the +y side and pushes a ball at theta = 0 towards negative theta.

    mazeplan makes a rig as `Class(maze, settings)`: a Maze, and the keys of the rig's file as a mapping. The
    constructor keeps the settings and opens nothing. A watchdog expects samples and commands in time (`watchdog`).
    `RigTraits` lists the optional attributes and methods of a rig."""

    rate_hz: float

    def reset(self, *, ring: int, theta: float, rng: np.random.Generator) -> None:
        """Place the ball (a person does it on hardware), level the plate, set time to 0."""

    def observe(self) -> Observation:
        """Block until the next sample, 1 / rate_hz after the last one, and return the sample."""
        ...

    def command(self, u_beta: float, u_gamma: float) -> None:
        """Command a tilt in rad. The rig holds this tilt until the next command."""

    def level(self) -> None:
        """Level the plate now: the safe state."""

    def close(self) -> None:
        """Release the machine. A second call does nothing."""


@dataclass(frozen=True)
class RigTraits:
    """Optional attributes and methods of a rig. A rig that lacks one gets the default here."""

    realtime: bool = True  # False for a simulation, which needs no watchdog
    latency: Latency | None = None  # measured delays; they replace the delays of the model
    unseen_s: float | None = None  # a run ends after so many seconds without a sight of the ball
    out_s: float | None = None  # a run ends after so many seconds with the ball out of the maze; None: as `Setup` says
    balls: int = 1  # number of balls; `reset` places the first, and `Observation.others` has the others
    ready: Callable[[], None] = lambda: None  # raises SettingsError if the rig cannot be driven yet
    stop: Callable[[], None] | None = None  # levels the plate until the next reset; any thread may call it
    inject: Callable[[Any], None] | None = None  # makes the machine fail
    cannot: tuple[str, ...] = ()  # kinds of faults that `inject` refuses
    truth: Callable[[], Array] | None = None  # true state of a simulation


def traits(rig: object) -> RigTraits:
    """The optional attributes and methods of a rig."""
    return RigTraits(**{f.name: getattr(rig, f.name) for f in fields(RigTraits) if hasattr(rig, f.name)})


def check_command(maze: Maze, u_beta: float, u_gamma: float) -> None:
    """Raises RigError for NaN and for a tilt beyond the map's limit."""
    limit = maze.tilt_limit + TOLERANCE
    for name, value in (("u_beta", u_beta), ("u_gamma", u_gamma)):
        if not -limit <= value <= limit:  # also refuses NaN
            raise RigError(f"{name}: got {value} rad, expected at most {maze.tilt_limit:.4f} rad either way")


class RigWrapper:
    """A rig around another rig, `inside`. Passes every call and attribute on to it; subclasses replace some."""

    def __init__(self, rig: Rig) -> None:
        self.inside = rig
        self.rate_hz = rig.rate_hz

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name == "inside":  # a copy has no attributes yet
            raise AttributeError(name)
        return getattr(self.inside, name)

    def reset(self, *, ring: int, theta: float, rng: np.random.Generator) -> None:
        """As the rig inside."""
        self._call("reset", ring=ring, theta=theta, rng=rng)

    def observe(self) -> Observation:
        """As the rig inside."""
        return self._call("observe")

    def command(self, u_beta: float, u_gamma: float) -> None:
        """As the rig inside."""
        self._call("command", u_beta, u_gamma)

    def level(self) -> None:
        """As the rig inside."""
        self._call("level")

    def close(self) -> None:
        """As the rig inside."""
        self._call("close")

    def _call(self, name: str, *args: Any, **more: Any) -> Any:
        return getattr(self.inside, name)(*args, **more)
