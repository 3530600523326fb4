"""A record under a system: the problem of its simulation, its inputs after delay, lag and gain, and how large a
parameter has to be to matter."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, lru_cache, partial

import numpy as np
from scipy.interpolate import CubicSpline

from mazeplan.core.errors import InputError
from mazeplan.core.records import Array, IntArray
from mazeplan.diagnosis.document import Values
from mazeplan.diagnosis.engine.record import Record
from mazeplan.diagnosis.engine.simulation import LEFT, Problem, decayed, simulate
from mazeplan.diagnosis.engine.system import System
from mazeplan.physics.effect import INPUT

Free = tuple[tuple[str, str], ...]  # effect and parameter
FEWEST, SMOOTH = 20, 0.5  # samples; error of cubics over that of lines, of an input that changes smoothly
GAP = 3.0  # median steps; a longer step is a gap
KEPT = 40  # cached inputs
START, BOW = 6, 3  # samples whose line, and whose parabola, is a first guess of an initial state
CLEAR = 20.0  # times the noise: differences over a lag that show speeds
FINE, MOST_PARTS = 0.05, 16  # times the noise: error of the integration; parts of a step


class Model:
    """A record under a system. scale: size of each parameter at which it matters, as (effect, parameter)"""

    def __init__(self, system: System, record: Record, noise: Array, scale: dict[tuple[str, str], float]) -> None:
        self.system, self.record, self.noise, self.scale = system, record, noise, scale
        self.effects = {e.name: e for e in system.library}
        span = np.nanmax(record.y, axis=0) - np.nanmin(record.y, axis=0)
        self.limit = LEFT * np.maximum(span, np.nanmax(np.abs(record.y), axis=0))
        self.divide = np.ones(len(record), dtype=np.int64)
        self._shaped = lru_cache(maxsize=KEPT)(partial(_shaped, record, system))
        self._layout = cache(partial(_layout, system))

    def simulate(self, values: Values, windows: IntArray, states: Array) -> Array:
        """Simulated states (N, 2 C) with these effects, of windows (M, 2) that start in `states` (M, 2 C)."""
        motion, inertia = self.system.motion.name, self.system.inertia
        inverse = 1.0 / values[motion][inertia] if inertia else 1.0
        (terms, holds), p = self._layout(tuple(values)), []
        for name, given in values.items():
            effect = self.effects[name]
            for number, parameter in zip(effect.numbers(given), effect.parameters.values(), strict=True):
                p.append(number * (inverse if parameter.unit.startswith("N") and name != motion else 1.0))
        delay = values.get("input_delay", {}).get("delay", 0.0)
        lag = values.get("input_lag", {}).get("time_constant", 0.0)
        w = values.get("input_gain", {}).get("factor", 1.0) * self._shaped(delay, lag)
        problem = Problem(self.record.t, w, terms, holds, self.divide, windows, self.limit)
        return simulate(problem, np.array(p or [0.0]), states)


def _layout(system: System, names: tuple[str, ...]) -> tuple[IntArray, IntArray]:
    """Terms and dry frictions of some effects, as in `Problem`."""
    counts = {e.name: len(e.parameters) for e in system.library}
    terms, holds, first = [], [], 0
    for name in names:
        for term in system.terms[name]:
            (holds if term.held else terms).append((term.address, term.coordinate, first))
        first += counts[name]
    return np.array(terms, dtype=np.int64).reshape(-1, 3), np.array(holds, dtype=np.int64).reshape(-1, 3)


def _shaped(record: Record, system: System, delay: float, lag: float) -> Array:
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


def with_numbers(values: Values, free: Sequence[tuple[str, str]], numbers: Array) -> Values:
    """The values with numbers for the free parameters."""
    out = {name: dict(numbers_) for name, numbers_ in values.items()}
    for (effect, name), number in zip(free, numbers, strict=True):
        out[effect][name] = float(number)
    return out


def first_states(record: Record, windows: IntArray, degree: int = 1) -> Array:
    """First guess of the initial states (M, 2 C): lines or parabolas through the first samples."""
    c = record.y.shape[1]
    out = np.zeros((len(windows), 2 * c))
    for m, (a, b) in enumerate(windows):
        count = max(START, (b - a) // 25) if degree == 1 else BOW
        for i in range(c):
            seen = a + np.flatnonzero(np.isfinite(record.y[a:b, i]))[:count]
            *_, slope, level = np.polyfit(record.t[seen] - record.t[a], record.y[seen, i], degree)
            out[m, i], out[m, c + i] = level, slope
    return out


def scales(system: System, record: Record, noise: Array) -> dict[tuple[str, str], float]:
    """The size of each parameter at which its effect is as large as the acceleration of the record.

    Raises InputError for a formula that gives no finite number."""
    t, y, v, a = _crude(record, noise)
    w = list(record.u[np.searchsorted(record.t, t)].T)
    if len(system.positions) > 1:
        w += [part for i in range(y.shape[1]) for part in (y[:, i], v[:, i])]
    strong = np.sqrt(np.mean(a**2, axis=0)) + 1e-300
    out: dict[tuple[str, str], float] = {}
    for effect in system.library:
        first = [p.default for p in effect.parameters.values()]
        for j, (name, p) in enumerate(effect.parameters.items()):
            out[effect.name, name] = abs(p.default) or (p.step if effect.places else 1.0)
            if effect.acts == INPUT:
                out[effect.name, name] = 1.0 if name == "factor" else 4.0 * record.step
            if effect.acts == INPUT or effect is system.motion or name in effect.places or p.fixed:
                continue
            step = p.step if first[j] + p.step <= p.high else -p.step
            numbers, changes = (first, [*first[:j], first[j] + step, *first[j + 1 :]]), []
            for term in system.terms[effect.name]:
                i = term.coordinate
                one, two = (np.broadcast_to(term.values(y[:, i], v[:, i], t, w, given), t.shape) for given in numbers)
                if (bad := ~np.isfinite(one + two)).any():
                    k = int(np.argmax(bad))
                    where = f"position {y[k, i]:.4g}, speed {v[k, i]:.4g}"
                    raise InputError(f"the formula of {effect.name} gives no finite number at {where}")
                changes.append(np.sqrt(np.mean((two - one) ** 2)) / strong[i])
            per, heavy = max(changes) / abs(step), 1.0
            if system.inertia and p.unit.startswith("N"):
                heavy = system.motion.parameters[system.inertia].default
            if per > 0.0:
                out[effect.name, name] = heavy / per
    return out


def _crude(record: Record, noise: Array) -> tuple[Array, Array, Array, Array]:
    """Crude speeds and accelerations: t (K,), coordinates, speeds and accelerations (K, C)."""
    rows, t = np.arange(len(record)), record.t
    y = np.column_stack([np.interp(rows, rows[np.isfinite(x)], x[np.isfinite(x)]) for x in record.y.T])
    lag = 1
    while lag < len(record) // 12:
        moved = np.sqrt(np.mean((y[lag:] - y[:-lag]) ** 2, axis=0))
        if (moved > CLEAR * noise).all():
            break
        lag *= 2
    v = (y[lag:] - y[:-lag]) / (t[lag:] - t[:-lag])[:, None]
    a = (v[lag:] - v[:-lag]) / (0.5 * (t[2 * lag :] - t[: -2 * lag]))[:, None]
    middle = slice(lag, len(record) - lag)
    return t[middle], y[middle], 0.5 * (v[lag:] + v[:-lag]), a


def divide(model: Model, values: Values, windows: IntArray) -> None:
    """Divide the steps of the integration until its error is small beside the noise."""
    states, c, usual = first_states(model.record, windows), len(model.noise), model.record.step
    longer = np.append(np.diff(model.record.t), usual) / usual
    parts, fine, before = 1, model.divide, None
    while parts <= MOST_PARTS:
        coarse = fine
        model.divide = fine = np.maximum(np.round(parts * longer), 1.0).astype(np.int64)
        after = model.simulate(values, windows, states)[:, :c]
        if before is not None:
            error = np.abs(after - before)[np.isfinite(after).all(axis=1)] / model.noise
            if np.quantile(error, 0.95) < FINE:
                model.divide = coarse
                return
        parts, before = 2 * parts, after


def thinned(record: Record, most: int, held: Array) -> Record:
    """A record with at most about this many rows: each k-th one; inputs keep their means over the steps.

    held: inputs (W,) that keep their value until the next sample"""
    every = int(np.ceil(len(record) / most))
    if every == 1:
        return record
    keep = np.arange(0, len(record), every)
    over = np.where(held, record.u[:-1], 0.5 * (record.u[1:] + record.u[:-1]))
    total = np.vstack([np.zeros(record.u.shape[1]), np.cumsum(over * np.diff(record.t)[:, None], axis=0)])
    span = np.diff(record.t[keep])[:, None]
    mean = np.diff(total[keep], axis=0) / span
    u = np.vstack([mean, mean[-1:]]) if len(mean) else record.u[keep]
    return Record(record.t[keep], record.y[keep], u, record.notes, means=True)
