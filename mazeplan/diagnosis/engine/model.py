"""A record under a system: the problem of its simulation, and its inputs after delay, lag and gain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from mazeplan.core.records import Array, IntArray
from mazeplan.diagnosis.engine.record import Record
from mazeplan.diagnosis.engine.simulation import LEFT, Problem, decayed, simulate
from mazeplan.diagnosis.engine.system import System, Values
from mazeplan.physics.effect import Effect

Free = tuple[tuple[str, str], ...]  # effect and parameter
FEWEST, SMOOTH = 20, 0.5  # samples; error of cubics over that of lines, of an input that changes smoothly
GAP = 3.0  # median steps; a longer step is a gap


class Model:
    """A record under a system. scale: size of each parameter at which it matters, as (effect, parameter)"""

    def __init__(self, system: System, record: Record, noise: Array, scale: dict[tuple[str, str], float]) -> None:
        self.system, self.record, self.noise, self.scale = system, record, noise, scale
        self.effects = {e.name: e for e in system.library}
        span = np.nanmax(record.y, axis=0) - np.nanmin(record.y, axis=0)
        self.limit = LEFT * np.maximum(span, np.nanmax(np.abs(record.y), axis=0))
        self.divide = np.ones(len(record), dtype=np.int64)
        self._inputs: dict[tuple[float, ...], Array] = {}
        self._layouts: dict[tuple[str, ...], tuple[IntArray, IntArray]] = {}

    def problem(self, values: Values, windows: IntArray) -> tuple[Problem, Array]:
        """The problem of the simulation and its parameters, with these effects."""
        inverse, motion = 1.0 / self.system.inertia_of(values), self.system.motion.name
        names = tuple(values)
        if names not in self._layouts:
            self._layouts[names] = self._layout(names)
        terms, holds = self._layouts[names]
        p = [
            number * (inverse if parameter.unit.startswith("N") and name != motion else 1.0)
            for name, numbers in values.items()
            for number, parameter in zip(
                self.effects[name].numbers(numbers), self.effects[name].parameters.values(), strict=True
            )
        ]
        w = self.inputs(values)
        return Problem(self.record.t, w, terms, holds, self.divide, windows, self.limit), np.array(p or [0.0])

    def _layout(self, names: Sequence[str]) -> tuple[IntArray, IntArray]:
        """Terms and dry frictions of some effects, as in `Problem`."""
        terms, holds, first = [], [], 0
        for name in names:
            for term in self.system.terms[name]:
                (holds if term.held else terms).append((term.address, term.coordinate, first))
            first += len(self.effects[name].parameters)
        return np.array(terms, dtype=np.int64).reshape(-1, 3), np.array(holds, dtype=np.int64).reshape(-1, 3)

    def inputs(self, values: Values) -> Array:
        """Inputs (N, 2, W) at begin and end of each step, after delay, lag and gain."""
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


def shaped(record: Record, system: System, delay: float, lag: float) -> Array:
    """Inputs at begin and end of each step (N, 2, W), late by `delay` and through a lag (s)."""
    t, n = record.t, len(record)
    out = np.zeros((n, 2, record.u.shape[1]))
    for i, name in enumerate(system.inputs):
        u = record.u[:, i]
        held = name in system.held or record.means
        if held and delay > 0.0:  # the mean over each step
            total = np.concatenate([[0.0], np.cumsum(u[:-1] * np.diff(t))])
            edges = np.interp(t - delay, t, total, left=np.nan)
            early = t - delay < t[0]
            edges[early] = (t[early] - delay - t[0]) * u[0]
            u = np.diff(edges, append=edges[-1]) / np.diff(t, append=t[-1] + 1.0)
        elif delay > 0.0:
            before = np.maximum(t - delay, t[0])
            u = CubicSpline(t, u)(before) if _smooth(u) else np.interp(before, t, u)
        if held:
            out[:, :, i] = u[:, None] if lag == 0.0 else _held_behind_lag(t, u, lag)
            if name not in system.held and _smooth(u):  # means over the steps: a line with the same mean
                rise = np.gradient(u, t) * np.diff(t, append=2.0 * t[-1] - t[-2])
                out[:, :, i] += 0.5 * rise[:, None] * np.array([-1.0, 1.0])
        else:
            at = _lagged(t, u, lag, False) if lag > 0.0 else u
            bow = _bow(t, at)
            out[:, 0, i], out[:, 1, i] = at + bow, np.append(at[1:], at[-1]) + bow
    return out


def _bow(t: Array, u: Array) -> Array:
    """Mean over each step (N,) of a cubic spline through the samples, less that of a line; 0 for a rough input.

    Lines between samples weaken an input that changes smoothly: with 12 samples a period by 2 %. With the mean of the
    spline, a line is as good. Long steps are gaps, where nobody knows the input."""
    if not _smooth(u):
        return np.zeros(len(u))
    h = np.diff(t)
    mean = np.diff(CubicSpline(t, u).antiderivative()(t)) / h
    return np.append(np.where(h < GAP * np.median(h), mean - 0.5 * (u[1:] + u[:-1]), 0.0), 0.0)


def _smooth(u: Array) -> bool:
    """Whether cubics through its neighbours predict a sample much better than lines do. Noise and jumps are rough."""
    if len(u) < FEWEST:
        return False
    by_line = u[2:-2] - (u[1:-3] + u[3:-1]) / 2.0
    by_cubic = u[2:-2] - (4.0 * (u[1:-3] + u[3:-1]) - u[:-4] - u[4:]) / 6.0
    return float(np.mean(by_cubic**2)) < SMOOTH**2 * float(np.mean(by_line**2))


def _lagged(t: Array, u: Array, lag: float, held: bool) -> Array:
    """The input behind a first-order lag, exact for an input that is a parabola (or constant) between samples."""
    h = np.diff(t)
    e, c0 = np.exp(-h / lag), u[:-1]
    if held:
        return decayed(u[0], e, c0 * (1.0 - e))
    bow = 6.0 * _bow(t, u)[:-1] / h  # of a parabola with the mean of the spline
    c1, c2 = np.diff(u) / h + bow, -bow / h
    end = c0 + c1 * (h - lag) + c2 * (h * h - 2.0 * lag * h + 2.0 * lag * lag)
    return decayed(u[0], e, end - e * (c0 - c1 * lag + 2.0 * c2 * lag * lag))


def _held_behind_lag(t: Array, u: Array, lag: float) -> Array:
    """A held input behind a first-order lag (N, 2): the line over each step with the mean and the first moment of the
    exponential. So a lag that is much shorter than a step changes little, and a fit can start there."""
    k = np.diff(t, append=2.0 * t[-1] - t[-2]) / lag
    short = np.maximum(k, 0.01)  # below this the differences lose digits
    e = np.exp(-short)
    mean = np.where(k < 0.01, 1.0 - 0.5 * k, (1.0 - e) / short)
    moment = np.where(k < 0.01, -k / 12.0, (1.0 - e * (1.0 + short)) / short**2 - 0.5 * mean)
    away = _lagged(t, u, lag, True) - u
    return u[:, None] + away[:, None] * (mean[:, None] + 6.0 * moment[:, None] * np.array([-1.0, 1.0]))


def changed(values: Values, effect: str, name: str, number: float) -> Values:
    """The values with one number changed."""
    return {**values, effect: {**values[effect], name: number}}


def with_numbers(values: Values, free: Sequence[tuple[str, str]], numbers: Array) -> Values:
    """The values with numbers for the free parameters."""
    out = {name: dict(numbers_) for name, numbers_ in values.items()}
    for (effect, name), number in zip(free, numbers, strict=True):
        out[effect][name] = float(number)
    return out


def free_of(effects: Sequence[Effect], known: Values) -> Free:
    """Parameters of some effects that are not known and not fixed."""
    return tuple(
        (e.name, n) for e in effects for n, p in e.parameters.items() if not p.fixed and n not in known.get(e.name, {})
    )
