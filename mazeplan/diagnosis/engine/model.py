"""A record under a system: simulated states from values of effects."""

from __future__ import annotations

import numpy as np

from mazeplan.core.records import Array, IntArray
from mazeplan.diagnosis.effect_entry import Values
from mazeplan.diagnosis.engine.record import Record
from mazeplan.diagnosis.engine.simulation import LEFT, Problem, simulate
from mazeplan.diagnosis.engine.system import System


class Model:
    """A record under a system. scale: size of each parameter at which it matters, as (effect, parameter)"""

    def __init__(self, system: System, record: Record, noise: Array, scale: dict[tuple[str, str], float]) -> None:
        self.system, self.record, self.noise, self.scale = system, record, noise, scale
        self.effects = {e.name: e for e in system.library}
        span = np.nanmax(record.y, axis=0) - np.nanmin(record.y, axis=0)
        self.limit = LEFT * np.maximum(span, np.nanmax(np.abs(record.y), axis=0))
        self.divide = np.ones(len(record), dtype=np.int64)
        self._inputs: dict[tuple[float, ...], Array] = {}

    def problem(self, values: Values, windows: IntArray) -> tuple[Problem, Array]:
        """The problem of the simulation and its parameters, with these effects."""
        inverse, motion = 1.0 / self.system.inertia_of(values), self.system.motion.name
        p: list[float] = []
        rows: dict[str, list[tuple[int, int, int]]] = {"term": [], "hold": [], "opening": []}
        angles = []
        for name, numbers in values.items():
            effect = self.effects[name]
            for term in self.system.terms[name]:
                if term.loss:
                    rows["opening"].append((term.address, term.loss, len(p)))
                    angles.append(term.angle)
                else:
                    rows["hold" if term.held else "term"].append((term.address, term.coordinate, len(p)))
            for number, parameter in zip(effect.numbers(numbers), effect.parameters.values(), strict=True):
                p.append(number * (inverse if parameter.unit.startswith("N") and name != motion else 1.0))
        terms, holds, openings = (np.array(found, dtype=np.int64).reshape(-1, 3) for found in rows.values())
        problem = Problem(
            self.record.t, self.inputs(values), terms, holds, openings, np.array(angles, dtype=np.float64),
            self.divide, windows, self.limit,
        )  # fmt: skip
        return problem, np.array(p or [0.0])

    def inputs(self, values: Values) -> Array:
        """Inputs (N, 3, W) at begin, middle and end of each step, as they act."""
        if self.system.drive is not None:
            return self.system.drive(values)
        delay, lag, gain = (
            values.get(name, {}).get(key, default)
            for name, key, default in (
                ("input_delay", "delay", 0.0), ("input_lag", "time_constant", 0.0), ("input_gain", "factor", 1.0)
            )
        )  # fmt: skip
        key = (delay, lag, gain)
        if key not in self._inputs:
            if len(self._inputs) > 40:
                self._inputs.clear()
            self._inputs[key] = gain * shaped(self.record, self.system, delay, lag)
        return self._inputs[key]

    def simulate(self, values: Values, windows: IntArray, states: Array) -> Array:
        """Simulated states (N, 2 C)."""
        problem, p = self.problem(values, windows)
        return simulate(problem, p, states)

    def seen(self, values: Values, states: Array) -> Array:
        """Coordinates as they are measured, from simulated states (N, 2 C)."""
        return states if self.system.seen is None else self.system.seen(values, states)


def shaped(record: Record, system: System, delay: float, lag: float) -> Array:
    """Inputs at begin, middle and end of each step (N, 3, W), late by `delay` and through a lag (s)."""
    t, n = record.t, len(record)
    out = np.zeros((n, 3, record.u.shape[1]))
    for i, name in enumerate(system.inputs):
        u = record.u[:, i]
        held = name in system.held or record.means
        if lag > 0.0:
            u, held = _lagged(t, u, lag, held), False
        if held and delay > 0.0:  # the mean over each step
            total = np.concatenate([[0.0], np.cumsum(u[:-1] * np.diff(t))])
            edges = np.interp(t - delay, t, total, left=np.nan)
            early = t - delay < t[0]
            edges[early] = (t[early] - delay - t[0]) * u[0]
            mean = np.diff(edges, append=edges[-1]) / np.diff(t, append=t[-1] + 1.0)
            out[:, 0, i] = out[:, 2, i] = mean
        elif held:
            out[:, 0, i] = out[:, 2, i] = u
        else:
            at = u if delay == 0.0 else np.interp(t - delay, t, u)
            out[:, 0, i], out[:-1, 2, i], out[-1, 2, i] = at, at[1:], at[-1]
    out[:, 1] = 0.5 * (out[:, 0] + out[:, 2])
    return out


def _lagged(t: Array, u: Array, lag: float, held: bool) -> Array:
    """The input behind a first-order lag, exact for an input that is linear (or constant) between samples."""
    h = np.diff(t)
    e = np.exp(-h / lag)
    slope = np.zeros(len(h)) if held else np.diff(u) / h
    out = np.empty(len(u))
    x = out[0] = u[0]
    forced = (u[:-1] - slope * lag) * (1.0 - e) + slope * h
    for k in range(len(h)):
        x = x * e[k] + forced[k]
        out[k + 1] = x
    return out
