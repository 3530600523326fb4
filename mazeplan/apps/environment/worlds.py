"""The rigs of environments. They run one after another."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from mazeplan.core.errors import RigError, SettingsError
from mazeplan.core.records import Array, IntArray, Observation
from mazeplan.maze.geometry import Maze
from mazeplan.rigs.interface import Rig, check_ready, traits
from mazeplan.rigs.registry import make_rig
from mazeplan.rigs.watchdog import WatchedRig, watched


@dataclass(frozen=True)
class Samples:
    """Samples of N rigs; each field has shape (N,).

    t: s.
    x, y: m; NaN for a ball that is not seen.
    beta, gamma: rad."""

    t: Array
    x: Array
    y: Array
    beta: Array
    gamma: Array


class RigRow:
    """N rigs that run one after another. Each call resets or steps some of them, `rows`."""

    def __init__(self, rigs: Sequence[Rig]) -> None:
        self._rigs = list(rigs)
        self.rate_hz, self._placed = self._rigs[0].rate_hz, set[int]()

    def reset(
        self, rows: IntArray, rings: Sequence[int], thetas: Sequence[float], rngs: Sequence[np.random.Generator]
    ) -> Samples:
        """Place the balls of the rigs `rows`, and return their first samples."""
        seen = []
        for row, ring, theta, rng in zip(rows.tolist(), rings, thetas, rngs, strict=True):
            self._rigs[row].reset(ring=ring, theta=theta, rng=rng)
            self._placed.add(row)
            seen.append(self._rigs[row].observe())
            self._rest(row)  # nobody knows when the first step comes
        return _samples(seen)

    def step(self, rows: IntArray, commands: Array) -> Samples:
        """Command tilts (len(rows), 2), rad, and return the next samples. Raises RigError before `reset`."""
        seen = []
        if not self._placed.issuperset(rows.tolist()):
            raise RigError("reset() comes first")
        for row, command in zip(rows.tolist(), commands.tolist(), strict=True):
            self._rigs[row].command(*command)
            seen.append(self._rigs[row].observe())
        return _samples(seen)

    def rest(self, rows: IntArray) -> None:
        """Level the real rigs of `rows`, whose episodes have ended. Raises RigError if a plate cannot be levelled."""
        for row in rows.tolist():
            self._rest(row)

    def _rest(self, row: int) -> None:
        """Answer the last sample with a level plate. A simulation waits for nobody, and keeps its tilt."""
        if isinstance(self._rigs[row], WatchedRig):
            self._rigs[row].level()

    def pictured(self, row: int) -> Array:
        """See `SimulatedRig.pictured`. Raises SettingsError for a rig without it."""
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


def rigs_of(spec: str, maze: Maze, number: int) -> RigRow:
    """N rigs that a name, file or class describes, with watchdogs. Raises SettingsError or RigError for a rig that
    cannot be used."""
    guarded = [watched(make_rig(spec, maze), wakes=False) for _ in range(number)]
    for one in guarded:  # the loop is another program's code
        check_ready(one)
    return RigRow(guarded)
