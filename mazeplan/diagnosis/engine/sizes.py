"""Sizes of a record and of the candidates: how large a parameter has to be to matter, and how finely to integrate."""

from __future__ import annotations

import numpy as np

from mazeplan.core.errors import InputError
from mazeplan.core.records import Array, IntArray
from mazeplan.diagnosis.engine.model import Model
from mazeplan.diagnosis.engine.record import Record
from mazeplan.diagnosis.engine.system import System, Values
from mazeplan.diagnosis.engine.windows import first_states
from mazeplan.physics.effect import INPUT

CLEAR = 20.0  # times the noise: differences over a lag that show speeds
FINE = 0.05  # times the noise: error of the integration
MOST_PARTS = 16


def crude(record: Record, noise: Array) -> tuple[Array, Array, Array, Array]:
    """Crude speeds and accelerations: t (K,), coordinates, speeds and accelerations (K, C)."""
    y = np.column_stack([_filled(x) for x in record.y.T])
    lag = 1
    while lag < len(record) // 12:
        moved = np.sqrt(np.mean((y[lag:] - y[:-lag]) ** 2, axis=0))
        if (moved > CLEAR * noise).all():
            break
        lag *= 2
    t = record.t
    v = (y[lag:] - y[:-lag]) / (t[lag:] - t[:-lag])[:, None]
    a = (v[lag:] - v[:-lag]) / (0.5 * (t[2 * lag :] - t[: -2 * lag]))[:, None]
    middle = slice(lag, len(record) - lag)
    return t[middle], y[middle], 0.5 * (v[lag:] + v[:-lag]), a


def _filled(x: Array) -> Array:
    seen, n = np.isfinite(x), np.arange(len(x))
    return x if seen.all() else np.interp(n, n[seen], x[seen])


def scales(system: System, record: Record, noise: Array) -> dict[tuple[str, str], float]:
    """The size of each parameter at which its effect is as large as the acceleration of the record.

    Raises InputError for a formula that gives no finite number."""
    t, y, v, a = crude(record, noise)
    rows = np.searchsorted(record.t, t)
    w = [record.u[rows, i] for i in range(record.u.shape[1])]
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
            elif effect is not system.motion and name not in effect.places and not p.fixed:
                step = p.step if first[j] + p.step <= p.high else -p.step
                changes = []
                for term in system.terms[effect.name]:
                    plain = term.code.vectorised(np)["hold" if term.held else "term"]
                    i = term.coordinate
                    one, two = (
                        np.broadcast_to(plain(y[:, i], v[:, i], t, w, numbers), t.shape)
                        for numbers in (first, [*first[:j], first[j] + step, *first[j + 1 :]])
                    )
                    for values in (one, two):
                        if not np.isfinite(values).all():
                            raise _no_number(effect.name, values, y[:, i], v[:, i])
                    changes.append(np.sqrt(np.mean((two - one) ** 2)) / strong[i])
                per = max(changes) / abs(step)
                heavy = 1.0
                if system.inertia and p.unit.startswith("N"):
                    heavy = system.motion.parameters[system.inertia].default
                if per > 0.0:
                    out[effect.name, name] = heavy / per
    return out


def _no_number(name: str, values: Array, y: Array, v: Array) -> InputError:
    bad = int(np.argmax(~np.isfinite(values)))
    where = f"position {y[bad]:.4g}, speed {v[bad]:.4g}"
    return InputError(f"the formula of {name} gives {values[bad]} at {where}; expected a finite number")


def divide(model: Model, values: Values, windows: IntArray) -> None:
    """Divide the steps of the integration until its error is small beside the noise."""
    states, c = first_states(model.record, windows), len(model.noise)
    usual = model.record.step
    longer = np.append(np.diff(model.record.t), usual) / usual
    parts = 1
    model.divide = np.maximum(np.round(longer), 1.0).astype(np.int64)
    before = model.simulate(values, windows, states)[:, :c]
    while parts < MOST_PARTS:
        parts *= 2
        fine = model.divide.copy()
        model.divide = np.maximum(np.round(parts * longer), 1.0).astype(np.int64)
        after = model.simulate(values, windows, states)[:, :c]
        seen = np.isfinite(after).all(axis=1)
        error = np.abs(after - before)[seen] / model.noise
        if np.quantile(error, 0.95) < FINE:
            model.divide = fine
            return
        before = after


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
