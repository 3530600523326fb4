"""A record of a mechanism as a system to diagnose: inputs in, position out.

    x_dd = motion + sum of effects        or, of forces,        inertia x_dd = force + sum of effects

A record that is much faster than RATE is resampled. Inputs and position go through the same zero-phase low-pass filter,
so linear equations between them stay true. Innovations a few milliseconds apart would not be independent anyway.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import butter, sosfiltfilt

from mazeplan.core.records import Array
from mazeplan.diagnosis.coordinate.kalman import NODES, Moves, Problem, accelerations
from mazeplan.diagnosis.coordinate.system import Values
from mazeplan.diagnosis.mechanism.drive_log import MotionLog
from mazeplan.diagnosis.mechanism.mechanism import Mechanism
from mazeplan.physics.effect import DRY, Effect
from mazeplan.physics.formulas.compiled import term_functions

RATE = 200.0  # Hz; faster records are resampled to about this rate
BAND = 0.4  # of the new rate: cutoff of the low-pass filter


class MechanismSystem:
    """Problems for `kalman`, made from a record and the values of effects."""

    def __init__(
        self, mechanism: Mechanism, dt: float, position: Array, nodes: Array, declared: Values, weakest: float = 0.0
    ) -> None:
        """dt: time between samples, s
        position: measured positions (N,), NaN where not seen
        nodes: inputs (N, NODES, W) at the nodes of the integration, from each sample to the next
        declared: known effects
        weakest: as in `System`"""
        self.mechanism, self.dt, self.theta, self.declared = mechanism, dt, position, declared
        self.t = dt * np.arange(len(position), dtype=np.float64)
        self.begins = np.arange(len(position)) == 0
        self.weakest = weakest
        self._w = np.ascontiguousarray(nodes)
        self._addresses: dict[tuple[str, int], int] = {}

    def __len__(self) -> int:
        return len(self.t)

    def build(self, candidates: Sequence[Effect], values: Values) -> tuple[Problem, Array]:
        """The problem and its parameters, with these effects at these values; other effects stay as declared.

        Parameters in N, or in N per unit, are divided by the inertia. The motion divides its own by itself."""
        known, inverse = {c.name: c for c in candidates}, 1.0 / self.inertia(values)
        motion = self.mechanism.motion.name
        p: list[float] = []
        terms, holds = [], []  # address and place of each
        for name, numbers in self._merged(values).items():
            effect = known.get(name)
            if effect is None:
                continue
            (holds if effect.acts == DRY else terms).append((self._address(effect), len(p)))
            p.extend(
                number * (inverse if parameter.unit.startswith("N") and name != motion else 1.0)
                for number, parameter in zip(effect.numbers(numbers), effect.parameters.values(), strict=True)
            )
        found = np.array(terms, dtype=np.int64).reshape(-1, 2)
        problem = Problem(
            self.theta, np.isfinite(self.theta), self.begins, self.t, self.dt, self._w, found[:, 0].copy(),
            found[:, 1].copy(), 0.0, np.array(holds, dtype=np.int64).reshape(-1, 2),
        )  # fmt: skip
        return problem, np.array(p, dtype=np.float64)

    def _merged(self, values: Values) -> Values:
        """Declared values and these values together. A declaration may give only some parameters of an effect."""
        names = dict.fromkeys([*self.declared, *values])
        return {name: {**self.declared.get(name, {}), **values.get(name, {})} for name in names}

    def inertia(self, values: Values) -> float:
        """The inertia that divides forces; 1 if effects are accelerations."""
        of = self.mechanism
        return self._merged(values)[of.motion.name][of.inertia] if of.inertia else 1.0

    def _address(self, effect: Effect) -> int:
        key = (effect.name, id(effect.formula))
        if key not in self._addresses:
            found = term_functions(effect, self.mechanism.inputs).address
            self._addresses[key] = found["hold" if effect.acts == DRY else "term"]
        return self._addresses[key]

    def volume(self, values: Values, rows: np.ndarray) -> float:
        """0, because no effect changes the measured position."""
        return 0.0

    def moves(self, candidates: Sequence[Effect], values: Values, steps: Sequence[tuple[str, str, float]]) -> Moves:
        """Changes when each parameter (effect, name, step) moves by its step. Only p changes."""
        problem, here = self.build(candidates, values)
        p = np.empty((len(steps), len(here)))
        for row, (effect, name, step) in zip(p, steps, strict=True):
            row[:] = self.build(candidates, {**values, effect: {**values[effect], name: values[effect][name] + step}})[
                1
            ]
        unmoved = np.ascontiguousarray(np.repeat(problem.w.mean(axis=1)[None, :, None], 2, axis=2))
        which, sizes = np.full(len(steps), -1, dtype=np.int64), np.array([step for *_, step in steps])
        return Moves(p, unmoved, which, sizes, np.tile([0, len(problem.terms)], (len(steps), 1)))

    def modelled(self, candidates: Sequence[Effect], values: Values, v: Array) -> Array:
        """Acceleration (N,) at the measured positions and speeds v (N,)."""
        problem, p = self.build(candidates, values)
        out = np.empty(len(v))
        accelerations(problem, p, self.theta, v, out)
        return out


def low_passed(signal: Array, cutoff: float, rate: float) -> Array:
    """Signal (N, ...) after a Butterworth filter of order 4, forwards and backwards. cutoff, rate: Hz"""
    return np.asarray(sosfiltfilt(butter(4, cutoff, fs=rate, output="sos"), signal, axis=0), dtype=np.float64)


def filled(position: Array) -> Array:
    """Positions (N,) with straight lines where nothing was seen."""
    seen, n = np.isfinite(position), np.arange(len(position))
    return position if seen.all() else np.interp(n, n[seen], position[seen])


def thinned(mechanism: Mechanism, log: MotionLog, declared: Values, weakest: float) -> MechanismSystem:
    """The system of a record. A faster record is resampled to about RATE."""
    every = max(1, round(1.0 / (RATE * log.dt)))
    position, inputs = log.position, log.inputs
    if every > 1:
        cutoff = BAND / (every * log.dt)
        smooth = low_passed(np.column_stack([filled(position), inputs]), cutoff, 1.0 / log.dt)
        position, inputs = np.where(np.isfinite(position), smooth[:, 0], np.nan), smooth[:, 1:]
    n = (len(position) - 1) // every  # a whole step follows each of these
    at = every * (np.arange(n)[:, None] + np.arange(NODES) / (NODES - 1))
    nodes = np.zeros((n, NODES, max(inputs.shape[1], 1)))
    for i, name in enumerate(mechanism.inputs):
        steps = np.floor(at + 1e-9).clip(max=(every * np.arange(1, n + 1) - 1)[:, None])
        nodes[:, :, i] = np.interp(steps if name in mechanism.held else at, np.arange(len(position)), inputs[:, i])
    return MechanismSystem(mechanism, log.dt * every, position[: n * every : every].copy(), nodes, declared, weakest)
