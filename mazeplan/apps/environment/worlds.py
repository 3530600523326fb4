"""The rigs of environments: a fleet of simulated rigs if it supports them, else rigs that run one after another."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from typing import Protocol

import numpy as np

from mazeplan.core.errors import RigError, SettingsError
from mazeplan.core.records import Array, IntArray, Observation
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.interface import Rig, check_ready, traits
from mazeplan.rigs.registry import make_rig
from mazeplan.rigs.sim.fleet import Fleet, Samples, fits
from mazeplan.rigs.sim.simulated import SimulatedRig
from mazeplan.rigs.watchdog import WatchedRig, watched


class World(Protocol):
    """N rigs. Each call resets or steps some of them, `rows`. See `rigs.sim.fleet.Fleet`."""

    rate_hz: float

    def reset(
        self, rows: IntArray, rings: Sequence[int], thetas: Sequence[float], rngs: Sequence[np.random.Generator]
    ) -> Samples:
        """Place the balls of the rigs `rows`, and return their first samples."""
        ...

    def step(self, rows: IntArray, commands: Array) -> Samples:
        """Command tilts (len(rows), 2), rad, to the rigs `rows`, and return their next samples."""
        ...

    def rest(self, rows: IntArray) -> None:
        """Level the real rigs of `rows`, whose episodes have ended. They may then wait for any time."""
        ...

    def pictured(self, row: int) -> Array:
        """The scene in the picture of the last sample, (5,): see `SimulatedRig.pictured`."""
        ...

    def close(self) -> None:
        """Release all rigs."""
        ...


class RigRow:
    """Rigs that run one after another."""

    def __init__(self, rigs: Sequence[Rig]) -> None:
        self._rigs = list(rigs)
        self.rate_hz, self._placed = self._rigs[0].rate_hz, set[int]()

    def reset(
        self, rows: IntArray, rings: Sequence[int], thetas: Sequence[float], rngs: Sequence[np.random.Generator]
    ) -> Samples:
        """See `World`."""
        seen = []
        for row, ring, theta, rng in zip(rows.tolist(), rings, thetas, rngs, strict=True):
            self._rigs[row].reset(ring=ring, theta=theta, rng=rng)
            self._placed.add(row)
            seen.append(self._rigs[row].observe())
            self._rest(row)  # nobody knows when the first step comes
        return _samples(seen)

    def step(self, rows: IntArray, commands: Array) -> Samples:
        """See `World`. Raises RigError before `reset`."""
        seen = []
        if not self._placed.issuperset(rows.tolist()):
            raise RigError("reset() comes first")
        for row, command in zip(rows.tolist(), commands.tolist(), strict=True):
            self._rigs[row].command(*command)
            seen.append(self._rigs[row].observe())
        return _samples(seen)

    def rest(self, rows: IntArray) -> None:
        """See `World`. Raises RigError if a plate cannot be levelled."""
        for row in rows.tolist():
            self._rest(row)

    def _rest(self, row: int) -> None:
        """Answer the last sample with a level plate. A simulation waits for nobody, and keeps its tilt."""
        if isinstance(self._rigs[row], WatchedRig):
            self._rigs[row].level()

    def pictured(self, row: int) -> Array:
        """See `World`. Raises SettingsError for a rig without `pictured`."""
        look = traits(self._rigs[row]).pictured
        if look is None:
            raise SettingsError("got pixels, but this rig tells positions only; expected state", key="observation")
        return look()

    def close(self) -> None:
        """Level and close all rigs."""
        for rig in self._rigs:
            with suppress(RigError):  # a rig that fails now has raised its error before
                rig.level()
            with suppress(RigError):  # also a rig that cannot level gives its port back
                rig.close()
        self._rigs = []


def _samples(seen: Sequence[Observation]) -> Samples:
    table = np.array([(o.t, _number(o.x), _number(o.y), o.beta, o.gamma) for o in seen], dtype=float)
    return Samples(*table.T)


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def world_of(spec: str, maze: Maze, number: int, threads: int | None = None) -> World:
    """N rigs that a name, file or class describes, with watchdogs. Raises SettingsError or RigError for a rig that
    cannot be used."""
    rig = make_rig(spec, maze)
    if isinstance(rig, SimulatedRig) and fits(rig.settings, rig.maze):
        return Fleet(rig.maze, rig.settings, number, threads)
    guarded = [watched(one, wakes=False) for one in (rig, *(make_rig(spec, maze) for _ in range(number - 1)))]
    for one in guarded:  # the loop is another program's code
        check_ready(one)
    return RigRow(guarded)
