"""The stage as difference equations (ARX), each axis with the other one's motion, and what they say: poles, dead time,
coupling.

    w_k = sum_i a_i w_(k-i) + sum_j b_j u_(k-d-j),    i = 1..n, j = 1..n+1      (motion under the axis' own command)
    y_k = w_k + c_0 v_k + c_1 v_(k-1) + level + noise                           (measured angle)

u: command; v: the other axis' w; n: order; d: dead time in samples. A held command after a dead time between d and
d + 1 samples needs the one coefficient b more than n. Axes are coupled by what the other one does, a sensor or a
linkage askew, so v enters as it moves, with the other axis' own poles. Its command is no further input, since v is
that command filtered and both could not be told apart; v is simulated and not measured, since noise in an input
biases.

Plain ARX, least squares with measured y_(k-i) in place of w_(k-i), is biased by their noise; it is the start of a
refinement (`output_error`) after which the squared error of the free simulation is smallest.

n and d have the smallest N log(V) / K + p log(N) (BIC; V mean squared error of the simulation, p parameters), with N
divided by K >= 1, how much wider than for independent errors the errors of the parameters are: a servo that is not
quite linear leaves errors that last, and thousands of those would otherwise buy any order. A criterion on held-out
blocks was tried: it costs the fit a part of the record and, with commands below 1.5 Hz, tells orders and delays apart
less well. Of candidates within `ALIKE` of the best, which the record can hardly tell apart, the one that is most
like a servo with a dead time is taken (`_unlike_a_servo`). Fits in percent are from blocks in time, one in five, that
took no part in anything.
"""

from __future__ import annotations

import cmath
import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from mazeplan.models.output_error import (
    SETTLE_S,
    Stretch,
    all_pole,
    covariance_of,
    kept,
    late,
    least_squares_arx,
    loss,
    motion,
    refine,
    regressors,
    settling,
    simulate,
    z_poles,
)
from mazeplan.records import Array

ORDERS = (1, 2, 3, 4)
DELAYS = (0, 1, 2, 3, 4, 5, 6)  # samples
BLOCK_S = 5.0  # s; shorter where the record is
HELD_OUT = 5  # of so many blocks the last takes no part in the fit
MIN_SAMPLES = 150  # 5 s at 30 Hz
ALIKE = 10.0  # difference in BIC above which evidence is very strong (Kass and Raftery, J. Am. Stat. Assoc. 90, 1995)
ONE_SIGN = 1.1  # sum |b| / |sum b| that noise on a b of about 0 brings
COARSE = 1e-5  # of the squared error: a step that gains less ends the fit of a candidate, until the last few are left
SHORTEST_S = 1.0  # s of a stretch that is used
MIN_TRAVEL = 1e-3  # rad; a command that moves less has not moved
ONE_COMMAND = 0.95  # correlation of the commands of both axes above which they are the same
COUPLED = 3.0  # standard errors that a cross gain must be away from 0


@dataclass(frozen=True)
class AxisArx:
    """One axis. dt s; delay samples; a (n,), b (n + 1,), c (m,), level rad as in the formula; m = 0 or 2.

    covariance: of (a, b, c, level), for this order and delay. Fits in percent, 100 (1 - ||y - yhat|| / ||y - mean||),
    on blocks that took no part: one_step of plain ARX one step ahead, simulation of the refined equation played freely,
    simulation_plain of plain ARX played freely. rms: rad, of measured minus simulated angle there; samples: rows
    fitted."""

    dt: float
    delay: int
    a: Array
    b: Array
    c: Array
    level: float
    covariance: Array
    one_step: float
    simulation: float
    simulation_plain: float
    rms: float
    samples: int

    @property
    def order(self) -> int:
        """Number of poles."""
        return len(self.a)

    @cached_property
    def z_poles(self) -> tuple[complex, ...]:
        """Poles of the difference equation, slowest first."""
        return z_poles(self.a)

    @cached_property
    def poles(self) -> tuple[complex | None, ...]:
        """log(z) / dt in rad/s, slowest first; None for a negative real z, which no continuous system has."""
        return tuple(None if abs(z.imag) < 1e-12 and z.real <= 0.0 else cmath.log(z) / self.dt for z in self.z_poles)

    @property
    def gain(self) -> tuple[float, float]:
        """Angle per command held for ever, and its standard error."""
        return self._with_error(lambda a, b, _: b.sum() / (1.0 - a.sum()))

    @property
    def cross_gain(self) -> tuple[float, float]:
        """Angle per angle of the other axis held for ever, and its standard error; 0, 0 of an axis fitted alone."""
        return self._with_error(lambda a, b, c: c.sum()) if len(self.c) else (0.0, 0.0)

    @property
    def coupled(self) -> bool:
        """Whether the other axis moves this one, beyond doubt."""
        gain, error = self.cross_gain
        return abs(gain) > COUPLED * error

    @property
    def natural_frequency(self) -> tuple[float, float]:
        """rad/s of the two slowest poles together, and standard error; of one pole, its own."""
        return self._with_error(lambda a, *_: second_order(a, self.dt)[0])

    @property
    def damping(self) -> tuple[float, float]:
        """Damping ratio of the two slowest poles, and standard error; 1 of one pole, taken twice at double speed."""
        return self._with_error(lambda a, *_: second_order(a, self.dt)[1])

    @property
    def dead_time(self) -> tuple[float, float]:
        """s of pure delay that, before the two slowest poles, gives the axis its mean lag; and standard error.

        Mean lag: sum k h_k / sum h_k of the response h to a command of one sample. Of the continuous axis it is dead
        time + 2 damping / natural frequency + dt / 2 (the hold), to within 1 ms, so fractions of a sample show."""
        return self._with_error(lambda a, b, _: mean_lag(a, b, self.delay, self.dt) - _hold_lag(a, self.dt))

    def _with_error(self, value: Callable[[Array, Array, Array], float]) -> tuple[float, float]:
        """value(a, b, c), and its standard error by first differences."""
        n = self.order
        x = np.concatenate([self.a, self.b, self.c])
        covariance = self.covariance[:-1, :-1]

        def at(x: Array) -> float:
            return float(value(x[:n], x[n : 2 * n + 1], x[2 * n + 1 :]))

        steps = 1e-4 * np.sqrt(np.maximum(np.diag(covariance), 1e-24))
        slope = np.array([(at(x + h) - at(x - h)) / (2.0 * s) for s, h in zip(steps, np.diag(steps), strict=True)])
        return at(x), math.sqrt(max(float(slope @ covariance @ slope), 0.0))

    def document(self) -> dict[str, Any]:
        """Plain numbers for a model file."""

        def pair(found: tuple[float, float], digits: int) -> dict[str, float]:
            return {"value": round(found[0], digits), "stderr": round(found[1], digits)}

        def number(pole: complex | None, digits: int) -> list[float] | None:
            return None if pole is None else [round(pole.real, digits), round(pole.imag, digits)]

        return {
            "order": self.order,
            "delay_samples": self.delay,
            "a": [round(float(x), 6) for x in self.a],
            "b": [round(float(x), 6) for x in self.b],
            "c": [round(float(x), 6) for x in self.c],
            "level_rad": round(self.level, 7),
            "z_poles": [number(z, 5) for z in self.z_poles],
            "poles_rad_s": [number(pole, 3) for pole in self.poles],
            "gain": pair(self.gain, 5),
            "cross_gain": pair(self.cross_gain, 5) if len(self.c) else None,
            "coupled": self.coupled if len(self.c) else None,
            "dead_time_s": pair(self.dead_time, 5),
            "one_step_percent": round(self.one_step, 2),
            "simulation_percent": round(self.simulation, 2),
            "simulation_plain_percent": round(self.simulation_plain, 2),
            "rms_rad": round(self.rms, 7),
            "samples": self.samples,
        }

    def line(self) -> str:
        """One line for a person: gain, coupling, dead time, poles, fits."""
        (gain, error), (cross, cross_error), (dead, dead_error) = self.gain, self.cross_gain, self.dead_time
        poles = ", ".join("none" if p is None else f"{p.real:.1f}{p.imag:+.1f}j" for p in self.poles)
        other = f"other axis {cross:+.4f} ± {cross_error:.4f} ({'coupled' if self.coupled else 'not coupled'}), "
        return (
            f"order {self.order}, gain {gain:.4f} ± {error:.4f}, {other if len(self.c) else ''}dead time "
            f"{1e3 * dead:.1f} ± {1e3 * dead_error:.1f} ms, poles {poles} rad/s; held out: one step "
            f"{self.one_step:.1f} %, free {self.simulation:.1f} % (plain ARX {self.simulation_plain:.1f} %)"
        )


@dataclass(frozen=True)
class ArxFit:
    """Both axes."""

    beta: AxisArx
    gamma: AxisArx

    def document(self) -> dict[str, Any]:
        """Plain numbers for a model file, by axis."""
        return {"beta": self.beta.document(), "gamma": self.gamma.document()}

    def lines(self) -> tuple[str, str]:
        """One line an axis, for a person."""
        return f"ARX beta     {self.beta.line()}", f"ARX gamma    {self.gamma.line()}"


def fit_arx(u: Array, y: Array, dt: float, segment: Array | None = None) -> ArxFit:
    """ARX of both axes from commands u (N, 2) and measured angles y (N, 2), rad, columns beta, gamma, every dt s.

    segment (N,): number of the uninterrupted stretch of each row; a row with NaN ends a stretch too. Where both axes
    had the same command, nothing tells whether they are coupled, and they are fitted apart (no c). Raises
    ValueError when there is too little to fit, or a command never moves."""
    if u.shape != y.shape or u.ndim != 2 or u.shape[1] != 2:
        raise ValueError(f"got commands {u.shape} and angles {y.shape}, expected (N, 2) of both")
    axes = cut(u, y, dt, segment)
    moved = []
    if abs(_correlation(axes)) > ONE_COMMAND:
        return ArxFit(*(_fitted(alone, dt) for alone in axes))
    for alone in axes:
        n, d, x = choose(alone, dt, (2,), DELAYS)
        moved.append([motion(s, x, n, d) for s in alone])
    beta, gamma = (
        _fitted([replace(s, extra=np.stack([w, late(w, 1)])) for s, w in zip(own, other, strict=True)], dt)
        for own, other in zip(axes, reversed(moved), strict=True)
    )
    return ArxFit(beta, gamma)


def _correlation(axes: list[list[Stretch]]) -> float:
    beta, gamma = (np.concatenate([s.u for s in stretches]) for stretches in axes)
    return float(np.corrcoef(beta, gamma)[0, 1])


def fit_arx_alone(
    u: Array, y: Array, dt: float, segment: Array | None = None, orders: Sequence[int] = ORDERS,
    delays: Sequence[int] = DELAYS,
) -> AxisArx:  # fmt: skip
    """ARX of one axis from its command u (N,) and angle y (N,), rad, without the other. Raises as `fit_arx`."""
    (stretches,) = cut(u[:, None], y[:, None], dt, segment)
    return _fitted(stretches, dt, orders, delays)


def cut(u: Array, y: Array, dt: float, segment: Array | None) -> list[list[Stretch]]:
    """Of each column of u and y (N, axes), the uninterrupted stretches that are long enough to tell something."""
    good = np.logical_and.reduce(np.isfinite(np.hstack([u, y])), axis=1)
    number = np.zeros(len(y)) if segment is None else segment
    edges = np.flatnonzero((np.diff(number) != 0) | (good[1:] != good[:-1])) + 1
    shortest = max(round(SHORTEST_S / dt), 4 * (max(ORDERS) + max(DELAYS)))
    places = [(i, j) for i, j in itertools.pairwise([0, *edges, len(y)]) if j - i >= shortest and good[i]]
    total = sum(j - i for i, j in places)
    if total < MIN_SAMPLES:
        raise ValueError(f"got {total} samples in uninterrupted stretches, expected at least {MIN_SAMPLES}")
    if min(float(np.ptp(np.concatenate([y[i:j, axis] for i, j in places]))) for axis in range(y.shape[1])) == 0.0:
        raise ValueError("got an angle that is the same all the time, expected it to follow the command")
    travel = float(np.min(np.ptp(np.concatenate([u[i:j] for i, j in places]), axis=0)))
    if travel < MIN_TRAVEL:
        raise ValueError(f"got a command over {travel:.2g} rad, expected at least {MIN_TRAVEL:g} rad")
    length = max(min(round(BLOCK_S / dt), total // (4 * HELD_OUT)), 1)
    firsts = itertools.accumulate((j - i for i, j in places), initial=0)
    axes: list[list[Stretch]] = [[] for _ in range(u.shape[1])]
    for (i, j), first in zip(places, firsts, strict=False):
        block = (first + np.arange(j - i)) // length
        for axis, stretches in enumerate(axes):
            rows = u[i:j, axis].copy(), y[i:j, axis].copy(), np.zeros((0, j - i))
            stretches.append(Stretch(*rows, block % HELD_OUT == HELD_OUT - 1, block))
    return axes


def _fitted(
    stretches: list[Stretch], dt: float, orders: Sequence[int] = ORDERS, delays: Sequence[int] = DELAYS
) -> AxisArx:
    n, delay, x = choose(stretches, dt, orders, delays)
    plain = least_squares_arx(stretches, n, delay)
    warm = settling(x[:n], dt)
    free, loose, ahead, centred = [], [], [], []
    for s in stretches:
        rows, keep = regressors(s, n, delay), kept(s, warm, held_out=True)
        free.append((s.y - simulate(s, x, n, delay))[keep])
        loose.append((s.y - all_pole(plain[:n], rows[:, n:] @ plain[n:], s.y[:3].mean()))[keep])
        ahead.append((s.y - rows @ plain)[keep])
        centred.append(s.y[keep])
    spread = max(float(np.concatenate(centred).std()), 1e-12)
    rms, *others = (float(np.sqrt(np.mean(np.concatenate(errors) ** 2))) for errors in (free, ahead, loose))
    one_step, simulation, simulation_plain = (100.0 * (1.0 - e / spread) for e in (others[0], rms, others[1]))
    covariance, _ = covariance_of(stretches, x, n, delay, dt)
    return AxisArx(
        dt, delay, x[:n], x[n : 2 * n + 1], x[2 * n + 1 : -1], float(x[-1]), covariance,
        one_step, simulation, simulation_plain, rms, sum(int(kept(s, warm).sum()) for s in stretches),
    )  # fmt: skip


def choose(stretches: list[Stretch], dt: float, orders: Sequence[int], delays: Sequence[int]) -> tuple[int, int, Array]:
    """(order, delay, coefficients), chosen as the module's first lines say."""
    warm = round(SETTLE_S / dt)
    tried: dict[tuple[int, int], Array] = {}
    place = list(delays)
    for n in sorted(orders):
        for d in place:
            lower = tried.get((n - 1, d))
            tried[n, d] = refine(stretches, n, d, dt, None if lower is None else lower[: n - 1], COARSE)
        if n >= 2:  # a pole more takes over some of the dead time
            best = min(place, key=lambda d: loss(stretches, tried[n, d], n, d, warm)[0])
            place = [d for d in place if d <= best]
    n, d = min(tried, key=lambda at: loss(stretches, tried[at], *at, warm)[0])
    warm = settling(tried[n, d][:n], dt)
    inflation = covariance_of(stretches, tried[n, d], n, d, dt)[1]

    def criterion(at: tuple[int, int]) -> float:
        mean, rows = loss(stretches, tried[at], *at, warm)
        return rows * math.log(max(mean, 1e-20)) / inflation + len(tried[at]) * math.log(rows)

    def close(candidates: Iterable[tuple[int, int]], margin: float) -> list[tuple[int, int]]:
        criteria = {at: criterion(at) for at in candidates}
        return [at for at in criteria if criteria[at] < min(criteria.values()) + margin]

    finalists = close(tried, 3.0 * ALIKE)
    for at in finalists:
        tried[at] = refine(stretches, *at, dt, tried[at][: at[0]])
    n, d = min(close(finalists, ALIKE), key=lambda at: (*_unlike_a_servo(at[0], tried[at]), criterion(at)))
    return n, d, tried[n, d]


def _unlike_a_servo(order: int, x: Array) -> tuple[bool, int, float]:
    """How little coefficients look like a servo with a dead time: what to avoid first, first.

    Poles with Re z < 0 turn by more than a quarter in a sample, or belong to no continuous system; another order than
    that of `StageAxis`; coefficients b of both signs imitate a dead time, as a Padé approximation does, where a servo
    begins into the direction in which it ends: sum |b| / |sum b|, which is then 1."""
    b = x[order : 2 * order + 1]
    both_signs = float(np.abs(b).sum()) / max(abs(float(b.sum())), 1e-12)
    return any(z.real < 0.0 for z in z_poles(x[:order])), abs(order - 2), max(both_signs, ONE_SIGN)


def second_order(a: Array, dt: float) -> tuple[float, float]:
    """(natural frequency in rad/s, damping) of the two slowest poles of a difference equation.

    A pole without a partner counts as two of double speed, which have the same mean lag. Poles with Re z <= 0 are
    left out: they turn by more than a quarter in a sample, or belong to no continuous system."""
    rates = [-cmath.log(z) / dt for z in z_poles(a) if z.real > 0.0]
    if not rates:
        return math.pi / dt, 1.0  # faster than the samples show
    first = rates[0]
    if abs(first.imag) > 1e-9:
        second = first.conjugate()
    else:
        second = next((rate for rate in rates[1:] if abs(rate.imag) <= 1e-9), None)
        if second is None:
            first = second = 2.0 * first
    frequency = math.sqrt(max((first * second).real, 1e-12))
    return frequency, (first + second).real / (2.0 * frequency)


def mean_lag(a: Array, b: Array, delay: int, dt: float) -> float:
    """s: sum k h_k / sum h_k of the response h to a command of one sample. a (n,), b (n + 1,)."""
    late = (delay + np.arange(1, len(b) + 1)) @ b / b.sum()
    return float(dt * (late + np.arange(1, len(a) + 1) @ a / (1.0 - a.sum())))


def _hold_lag(a: Array, dt: float) -> float:
    """s: mean lag of the continuous axis with the two slowest poles under held commands, without dead time."""
    frequency, damping = second_order(a, dt)
    return 2.0 * damping / frequency + 0.5 * dt
