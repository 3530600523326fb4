"""Windows of a record, and the fit of a system to them.

Each window is simulated from its own initial state (multiple shooting). The residual is the measured position minus the
simulated one, over the noise. The fit is a Levenberg-Marquardt method with bounds. In each step the initial states are
eliminated window by window, so their number costs nothing:

    min over d, s_m of  sum over windows m of |r_m + P_m d + S_m s_m|^2,      s_m = -S_m^+ (r_m + P_m d)
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mazeplan.core.records import Array, IntArray
from mazeplan.diagnosis.document import Values, changed
from mazeplan.diagnosis.engine.model import START, Free, Model, first_states, with_numbers
from mazeplan.diagnosis.engine.record import Record

STEP = 1e-5  # of numeric derivatives, as a share of a parameter's scale
ITERATIONS = 40
DONE = 1e-5  # relative decrease of the sum of squares at which a fit ends
SECANTS = 3  # passes of the covariance; each takes the standard errors of the one before
STRAIGHT, BENT = 0.75, 0.25  # gain of a step over the foreseen one: a longer or a shorter step is tried next
STRAY = 9.0  # times the usual mean square of a held-out window
GROWN, FEWEST = (0.02, 0.05, 0.1, 0.25, 0.5, 1.0), 20  # shares of a window that grows; samples of its first part


class Point(NamedTuple):
    """A state of a descent: values of all effects, initial states (M, 2 C), residual (K,) over the noise, damping."""

    values: Values
    states: Array
    r: Array
    weight: float = 1e-3

    @property
    def cost(self) -> float:
        """Sum of all squares."""
        return _sum(self.r)


@dataclass(frozen=True)
class Fit:
    """The result of a fit."""

    values: Values  # of all effects, with those that were not fitted
    free: Free  # fitted parameters
    states: Array  # initial state of each window (M, 2 C)
    residual: Array  # (N, C) over the noise, NaN where there is none
    cost: Array  # sum of squares of each window (M,)
    count: Array  # measurements in each window (M,)
    at_bound: tuple[tuple[str, str], ...]  # fitted parameters at a bound
    windows: Windows  # where they were fitted

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the fitted parameters (P, P), by blocks (sandwich); 0 for one at a bound."""
        return self.windows.covariance(self)

    @property
    def total(self) -> float:
        """Sum of all squares."""
        return float(np.sum(self.cost))

    def rms(self) -> float:
        """Root mean square of the residual, in times the noise."""
        return math.sqrt(self.total / max(float(np.sum(self.count)), 1.0))

    def stderr(self, effect: str, name: str) -> float:
        """Standard error of a fitted parameter; 0 for others."""
        if (effect, name) not in self.free:
            return 0.0
        i = self.free.index((effect, name))
        return math.sqrt(max(float(self.covariance[i, i]), 0.0))


def cut(record: Record, rows: int) -> IntArray:
    """Windows (M, 2) of about this many steps that cover the record; neighbours share one sample."""
    out = []
    for first, stop in record.stretches:
        steps = stop - 1 - first
        count = max(1, round(steps / rows))
        if steps < 0.5 * rows:
            continue
        edges = np.round(np.linspace(first, stop - 1, count + 1)).astype(np.int64)
        out += [(a, b + 1) for a, b in pairwise(edges.tolist())]
    found = np.array(out, dtype=np.int64).reshape(-1, 2)
    seen = np.array([np.isfinite(record.y[a:b]).sum(axis=0).min() for a, b in found], dtype=np.int64)
    return found[seen > 2 * START] if len(found) else found


class Windows:
    """Some windows of a record, with a number for each measurement."""

    def __init__(self, model: Model, windows: IntArray) -> None:
        self.model, self.windows = model, windows
        y, c = model.record.y, model.record.y.shape[1]
        self.size = 2 * c
        rows = np.concatenate([np.arange(a + 1, b) for a, b in windows])  # the first row counts for the window before
        which = np.repeat(np.arange(len(windows)), windows[:, 1] - windows[:, 0] - 1)
        good = np.isfinite(y[rows]).ravel()
        self.row, self.coordinate = np.repeat(rows, c)[good], np.tile(np.arange(c), len(rows))[good]
        self.which = np.repeat(which, c)[good]
        self.flat = self.size * self.row + self.coordinate  # of a simulation (N, 2 C)
        self.starts = np.searchsorted(self.which, np.arange(len(windows)))
        self.count = np.diff(np.append(self.starts, len(self.which)))
        self.measured = y[self.row, self.coordinate]
        self.weight = 1.0 / model.noise[self.coordinate]
        self.guess = first_states(model.record, windows)
        self.bent = first_states(model.record, windows, 2)  # nearer where a window begins in a fast swing
        # sizes of initial states at which they matter
        tiny = model.noise * math.sqrt(1e-4)
        last = max(float(np.median(model.record.t[windows[:, 1] - 1] - model.record.t[windows[:, 0]])), 1e-9)
        self.state_steps = np.concatenate([tiny, tiny / last])
        self.state_floor = 1.0 / np.concatenate([model.noise, model.noise / last]) ** 2  # one measurement
        self.resting = self.guess.copy()
        self.resting[:, c:] = 0.0

    def states_on(self, track: Array | None) -> Array:
        """Initial states (M, 2 C) on a track of states along the record, or the first guess."""
        if track is None:
            return self.guess
        near = track[self.windows[:, 0]]
        return np.where(np.isfinite(near).all(axis=1, keepdims=True), near, self.guess)

    def residual(self, values: Values, states: Array) -> Array:
        """Residuals of all measurements (K,), over the noise."""
        out = self.model.simulate(values, self.windows, states)
        return (out.ravel()[self.flat] - self.measured) * self.weight

    def sums(self, x: Array) -> Array:
        """Sums over the measurements of each window."""
        return np.add.reduceat(x, self.starts, axis=0)

    def _columns(
        self, values: Values, states: Array, r: Array, free: Free, steps: Array | None = None,
        state_steps: Array | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """Derivatives of the residual by parameters (K, P) and by the initial state of the own window (K, 2 C).

        steps (P,), state_steps (M, 2 C): of the differences; by default small ones"""
        by_p = np.empty((len(r), len(free)))
        for j, (effect, name) in enumerate(free):
            at, one = values[effect][name], self.model.effects[effect].parameters[name]
            size = max(self.model.scale[effect, name], abs(at))
            step = STEP * size if steps is None else min(max(float(steps[j]), STEP * size), size)
            step = min(step, max(one.high - at, at - one.low))
            step = -step if at + step > one.high else step
            by_p[:, j] = (self.residual(changed(values, effect, name, at + step), states) - r) / step
        by_s = np.empty((len(r), self.size))
        far = np.broadcast_to(self.state_steps, states.shape) if state_steps is None else state_steps
        for j in range(self.size):
            moved = states.copy()
            moved[:, j] += far[:, j]
            by_s[:, j] = (self.residual(values, moved) - r) / far[self.which, j]
        return by_p, by_s

    def _eliminated(self, by_s: Array, x: Array, damping: Array | float = 0.0) -> Array:
        """The states that cancel columns x, window by window: (M, 2 C, ...)."""
        gram = self.sums(by_s[:, :, None] * by_s[:, None, :])
        diagonal = np.einsum("mii->mi", gram) * (1e-9 + np.reshape(damping, (-1, 1)))
        diagonal += self.state_floor * (1e-9 + np.reshape(damping, (-1, 1)))
        gram = gram + diagonal[:, :, None] * np.eye(self.size)
        return np.linalg.solve(gram, self.sums(by_s[:, :, None] * x[:, None, :]))

    def _cleaned(self, by_p: Array, by_s: Array, damping: Array | float = 0.0) -> tuple[Array, Array]:
        """Derivatives by parameters (K, P) without what the initial states can copy, and these states."""
        states = self._eliminated(by_s, by_p, damping)
        return by_p - np.einsum("ks,ksp->kp", by_s, states[self.which]), states

    def settled(self, values: Values, *near: Array | None, most: int = 12) -> tuple[Array, Array]:
        """Initial states (M, 2 C) fitted window by window, from the best of several starts, and the residual (K,)."""
        starts = [*(states for states in near if states is not None), self.guess, self.bent, self.resting]
        states, r = starts[0].copy(), self.residual(values, starts[0])
        for other in starts[1:]:
            states, r = self._better(states, r, other, self.residual(values, other))
        weight, cost = np.full(len(states), 1e-3), self.sums(r * r)
        for _ in range(most):
            _, by_s = self._columns(values, states, r, ())
            trial = states - self._eliminated(by_s, r[:, None], weight)[:, :, 0]
            s = self.residual(values, trial)
            fresh = self.sums(s * s)
            states, r = self._better(states, r, trial, s)
            weight = np.where(fresh < cost, weight / 8.0, np.maximum(weight, 1e-6) * 10.0)
            gain, cost = cost - np.minimum(fresh, cost), np.minimum(fresh, cost)
            if float(gain.sum()) <= DONE * float(cost.sum()) and not (weight > 1e-2).sum() > len(weight) // 4:
                break
        return states, r

    def _better(self, states: Array, r: Array, others: Array, s: Array) -> tuple[Array, Array]:
        """Of two initial states of each window the better one, and its residual."""
        fewer = self.sums(s * s) < self.sums(r * r)
        return np.where(fewer[:, None], others, states), np.where(fewer[self.which], s, r)

    def fit(self, values: Values, free: Free, near: Array | None = None) -> Fit:
        """Fit free parameters and all initial states, from initial states near (M, 2 C) or the first guess."""
        return self.finished(self.descend(self.begin(values, near), free), free)

    def begin(self, values: Values, near: Array | None = None) -> Point:
        """Where a descent begins."""
        return Point(values, *self.settled(values, near, most=1))

    def descend(self, point: Point, free: Free, most: int = ITERATIONS) -> Point:
        """The least sum of squares near a point, after at most so many steps."""
        values, states, r, weight = point
        limits = [self.model.effects[e].parameters[n] for e, n in free]
        low, high = np.array([p.low for p in limits]), np.array([p.high for p in limits])
        cost, p = point.cost, np.array([values[e][n] for e, n in free])
        for _ in range(most if free else 0):
            by_p, by_s = self._columns(values, states, r, free)
            s_r, (clean, s_p) = self._eliminated(by_s, r[:, None], weight), self._cleaned(by_p, by_s, weight)
            left = r - np.einsum("ks,ks->k", by_s, s_r[self.which][:, :, 0])
            gram, slope = clean.T @ clean, clean.T @ left
            by_states, full = cost - _sum(left), _bounded_step(gram, slope, 1e-9, p, low, high)
            if by_states + _foreseen(gram, slope, full) <= DONE * cost:  # no step gains more
                break
            for _ in range(8):
                new = np.clip(p + _bounded_step(gram, slope, weight, p, low, high), low, high)
                trial = with_numbers(values, free, new)
                begin = states - (s_r[:, :, 0] + np.einsum("msp,p->ms", s_p, new - p))
                s = self.residual(trial, begin)
                if not _sum(s) < cost:  # in some windows the linear step of the initial state may go too far
                    begin, s = self._better(begin, s, states, self.residual(trial, states))
                fresh = _sum(s)
                if fresh < cost:
                    break
                weight = max(weight, 1e-6) * 6.0
            else:
                break
            gain = cost - fresh
            share = gain / max(by_states + _foreseen(gram, slope, new - p), 1e-300)
            weight = max(weight / 8.0, 1e-12) if share > STRAIGHT else weight * 2.0 if share < BENT else weight
            values, states, p, r, cost = trial, begin, new, s, fresh
            if gain <= DONE * cost:
                break
        return Point(values, states, r, weight)

    def finished(self, point: Point, free: Free) -> Fit:
        """The fit at a solution."""
        values, states, r, _ = point
        residual = np.full(self.model.record.y.shape, np.nan)
        residual[self.row, self.coordinate] = r
        at_bound = []
        for e, n in free:
            one, at = self.model.effects[e].parameters[n], values[e][n]
            slack = 1e-6 * max(abs(at), self.model.scale[e, n])
            if at <= one.low + slack or at >= one.high - slack:
                at_bound.append((e, n))
        return Fit(
            values, free, states, residual, self.sums(r * r), self.count.astype(np.float64), tuple(at_bound), self
        )

    def covariance(self, fit: Fit) -> Array:
        """Covariance of fitted parameters (P, P), by secants over about a standard error: where a kink of the motion
        (a body that stops, a wall) lies near the solution, a derivative is no measure of what the record tells."""
        free, out = fit.free, np.zeros((len(fit.free), len(fit.free)))
        inside = np.array([key not in fit.at_bound for key in free], dtype=bool)
        if not inside.any():
            return out
        r = fit.residual[self.row, self.coordinate]
        steps = state_steps = None
        for _ in range(SECANTS):
            by_p, by_s = self._columns(fit.values, fit.states, r, free, steps, state_steps)
            clean, _ = self._cleaned(by_p, by_s)
            out[np.ix_(inside, inside)] = sandwich(clean[:, inside], r, self.sums)
            steps = np.sqrt(np.diag(out))
            gram = self.sums(by_s[:, :, None] * by_s[:, None, :]) + 1e-9 * np.diag(self.state_floor)
            spread = np.einsum("mii->mi", np.linalg.inv(gram)) * (fit.cost / fit.count)[:, None]
            state_steps = np.maximum(np.sqrt(spread), self.state_steps)
        return out

    def own_share(self, values: Values, states: Array, own: tuple[str, str], free: Free) -> float:
        """The share of a parameter's influence that free parameters and initial states cannot copy."""
        r = self.residual(values, states)
        by_p, by_s = self._columns(values, states, r, (own, *free))
        clean, _ = self._cleaned(by_p, by_s)
        column, others = clean[:, 0], clean[:, 1:] / np.maximum(np.linalg.norm(clean[:, 1:], axis=0), 1e-300)
        left = column - others @ np.linalg.lstsq(others, column, rcond=1e-10)[0]
        return float(np.linalg.norm(left)) / max(float(np.linalg.norm(column)), 1e-300)

    def held_out(self, values: Values, *near: Array | None) -> Fit:
        """Only the initial states are fitted, from states near them (M, 2 C).

        Where a motion is sensitive, as near the upper rest of a pendulum, the fit of a long window may end far off:
        such windows are fitted again as they grow."""
        states, r = self.settled(values, *near)
        cost = self.sums(r * r) / self.count
        stray = np.flatnonzero(cost > STRAY * max(float(np.median(cost)), 1.0))
        if 0 < len(stray) <= len(cost) // 2:
            again, fresh = states.copy(), Windows(self.model, self.windows[stray])
            again[stray] = fresh.grown(values)
            states, r = self._better(states, r, again, self.residual(values, again))
        return self.finished(Point(values, states, r), ())

    def grown(self, values: Values) -> Array:
        """Initial states (M, 2 C), fitted to longer and longer parts of each window."""
        states, (a, b) = self.guess, self.windows.T
        for share in GROWN:
            part = np.minimum(b, np.maximum(a + FEWEST, a + np.round(share * (b - a)).astype(np.int64)))
            states, _ = Windows(self.model, np.column_stack([a, part])).settled(values, states)
        return states


def sandwich(clean: Array, r: Array, sums: Callable[[Array], Array]) -> Array:
    """Covariance of parameters from windows: not smaller than that of white residuals of the same size."""
    gram = clean.T @ clean
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    inverse = np.linalg.pinv(gram / np.outer(size, size), rcond=1e-12, hermitian=True) / np.outer(size, size)
    slopes = sums(clean * r[:, None])
    m = len(slopes)
    between = slopes.T @ slopes * (m / max(m - clean.shape[1], 1))
    white = inverse * float(r @ r) / max(len(r) - clean.shape[1], 1)
    robust = inverse @ between @ inverse
    wider = np.sqrt(np.maximum(np.diag(white), np.diag(robust)) / np.maximum(np.diag(robust), 1e-300))
    return robust * np.outer(wider, wider)


def _sum(r: Array) -> float:
    total = float(r @ r)
    return total if math.isfinite(total) else math.inf


def _foreseen(gram: Array, slope: Array, move: Array) -> float:
    """The fall of the sum of squares by a move, if residuals were straight."""
    return -float(2.0 * slope @ move + move @ gram @ move)


def _bounded_step(gram: Array, slope: Array, weight: float, p: Array, low: Array, high: Array) -> Array:
    """A damped Gauss-Newton step; a parameter that would leave its bounds stays at the bound."""
    n = len(slope)
    move, open_ = np.zeros(n), np.ones(n, dtype=bool)
    if n == 0:
        return move
    damping = np.diag(np.maximum(np.diag(gram), 1e-12 * np.max(np.diag(gram)) + 1e-300)) * weight
    for _ in range(n + 1):
        if not open_.any():
            break
        a = (gram + damping)[np.ix_(open_, open_)]
        fixed = gram[np.ix_(open_, ~open_)] @ move[~open_]
        s = 1.0 / np.sqrt(np.diag(a))
        solved = s * np.linalg.lstsq(a * np.outer(s, s), -s * (slope[open_] + fixed), rcond=1e-13)[0]
        move[open_] = solved
        beyond = open_ & ((p + move < low) | (p + move > high))
        if not beyond.any():
            break
        move = np.where(beyond, np.clip(p + move, low, high) - p, move)
        open_ &= ~beyond
    return move
