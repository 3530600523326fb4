"""A drive on its axis as a system to diagnose: force in, position out.

    M q_dd = force + sum of effects

Force and position are sampled anew at RATE behind the same zero-phase low-pass filter: what a linear equation says of
the two stays true, and innovations a few milliseconds apart would not be independent of one another anyhow.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import butter, sosfiltfilt

from mazeplan.data.drivelog import DriveLog
from mazeplan.diagnosis.axislibrary import LOAD, MASS, WORTH, Scale, drive
from mazeplan.diagnosis.kalman import NODES, TERM, Moves, Problem
from mazeplan.diagnosis.library import DRY, Candidate
from mazeplan.diagnosis.system import Values, plain_moves
from mazeplan.maths.compiled import address_of
from mazeplan.records import Array

RATE = 200.0  # Hz, about which records are sampled anew
BAND = 0.4  # of that rate: what the low-pass filter leaves


class AxisSystem:
    """Problems for `kalman`, made from a record and the values of effects."""

    def __init__(self, dt: float, position: Array, nodes: Array, declared: Values, scale: Scale) -> None:
        """dt: s between samples; position (N,): m; nodes (N, NODES): N, force at the nodes of the integration from each
        sample on."""
        self.dt, self.theta, self.declared = dt, position, declared
        self.t = dt * np.arange(len(position), dtype=np.float64)
        self.first = np.arange(len(position)) == 0
        self.weakest = WORTH * scale.force / scale.mass  # m/s^2
        self._w = np.ascontiguousarray(nodes[:, :, None])
        self._kept: dict[int, tuple[object, int]] = {}

    def __len__(self) -> int:
        return len(self.t)

    def build(self, candidates: Sequence[Candidate], values: Values) -> tuple[Problem, Array]:
        """The problem with these effects at these values (of those left out: as declared), and its parameters: those in
        N, or N per something, over the mass."""
        known = {c.name: c for c in candidates}
        merged = {**self.declared, **values}
        inverse = 1.0 / merged[LOAD]["mass"]
        p, places, functions, dry = [inverse], [0], [drive], -1
        for effect, numbers in merged.items():
            c = known.get(effect)
            if c is None or c.acts == MASS:
                continue
            at = len(p)
            p.extend(numbers[name] * (inverse if s.unit.startswith("N") else 1.0) for name, s in c.parameters.items())
            if c.acts == DRY:
                dry = at
            else:
                places.append(at)
                functions.append(c.term)
        problem = Problem(
            self.theta, np.isfinite(self.theta), self.first, self.t, self.dt, self._w,
            np.array([self._address(f) for f in functions], dtype=np.int64), np.array(places, dtype=np.int64), dry,
            np.empty(0, dtype=np.int64), 0.0,
        )  # fmt: skip
        return problem, np.array(p)

    def volume(self, values: Values, rows: np.ndarray) -> float:
        """Nothing changes what was measured."""
        return 0.0

    def moves(self, candidates: Sequence[Candidate], values: Values, steps: Sequence[tuple[str, str, float]]) -> Moves:
        """What moving each of some parameters (effect, name, step) changes."""
        return plain_moves(self, candidates, values, steps)

    def _address(self, function: object) -> int:
        if id(function) not in self._kept:
            self._kept[id(function)] = function, address_of(function, TERM)
        return self._kept[id(function)][1]


def low_passed(signal: Array, cutoff: float, rate: float) -> Array:
    """Signal (N,) behind a Butterworth filter of order 4, forwards and backwards; cutoff, rate: Hz."""
    return np.asarray(sosfiltfilt(butter(4, cutoff, fs=rate, output="sos"), signal), dtype=np.float64)


def thinned(log: DriveLog, declared: Values, scale: Scale) -> AxisSystem:
    """The system at RATE."""
    every = max(1, round(1.0 / (RATE * log.dt)))
    cutoff = BAND / (every * log.dt)
    position, force = (low_passed(signal, cutoff, 1.0 / log.dt) for signal in (log.position, log.force))
    n = (len(log) - 1) // every  # behind each of these there is a whole step
    at = every * (np.arange(n)[:, None] + np.arange(NODES) / (NODES - 1))
    nodes = np.interp(at, np.arange(len(log)), force)
    return AxisSystem(log.dt * every, position[: n * every : every], nodes, declared, scale)


def scale_of(log: DriveLog) -> Scale:
    """The sizes of a record; the mass by least squares of force on acceleration alone."""
    position = low_passed(log.position, BAND * min(RATE, 1.0 / log.dt), 1.0 / log.dt)
    v = np.gradient(position, log.dt)
    a = np.gradient(v, log.dt)
    mass = abs(float(a @ log.force)) / max(float(a @ a), 1e-300)
    return Scale(
        float(np.sqrt(np.mean(log.force**2))),
        float(np.max(np.abs(v))),
        float(np.ptp(position)),
        log.dt * len(log),
        mass,
    )
