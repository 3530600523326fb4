"""Maximum-likelihood fit of effects by the innovations of the filter: Gauss-Newton and process noise in turn."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mazeplan.core.records import Array
from mazeplan.diagnosis.document import Values, changed
from mazeplan.diagnosis.ring.kalman import Moves, innovations
from mazeplan.diagnosis.ring.system import RingSystem, remembered
from mazeplan.physics.effect import Effect, Parameter

Q_LOW, Q_HIGH = 1e-3, 1e8  # 1/s^3, intensity of the process noise over the variance of one measurement
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
WIDTH = 0.7  # half width, in log q, of the parabola that finds the best q
STEPS, ENOUGH = 10, 0.02  # maximum number of Gauss-Newton steps; minimum gain of -2 log L for a further step
DAMPING = (1e-6, 1e8)
PASSES = 12  # cached passes of the filter: a fit asks for some of them again
ROUNDS, STEADY = 14, 1.0  # maximum rounds of values and process noise; minimum gain of -2 log L for a further round
NOTHING, NO_ROW = np.empty((0, 0)), np.empty(0, dtype=np.int64)
NONE = Moves(NOTHING, np.empty((0, 0, 0, 0)), NO_ROW, np.empty(0), NO_ROW.reshape(0, 2))


@dataclass(frozen=True)
class Fit:
    """Effects with values and standard errors."""

    candidates: tuple[Effect, ...]
    values: Values
    minus2: float  # -2 log L of the rows of the fit
    noise: float  # standard deviation of one measurement, rad
    q: float  # process noise, 1/s^3
    stderr: Values


class Likelihood:
    """-2 log L of a record in a ring on some of its rows.

    rows: True (N,) for rows that count
    noisy: whether it depends on the process noise
    repeats: number of residuals that count as one independent residual"""

    noisy, repeats = True, 1.0

    def __init__(self, system: RingSystem, library: Sequence[Effect], rows: np.ndarray) -> None:
        self.system, self.library, self.rows = system, list(library), rows
        n = len(system)
        self._stop = int(np.flatnonzero(rows)[-1]) + 1 if rows.any() else 0
        self._nu, self._S, self._states = np.full(n, np.nan), np.ones(n), np.empty((n, 5))
        self._passes: dict[tuple[str, float], tuple[Array, float, np.ndarray]] = {}

    def add(self, candidate: Effect) -> None:
        """Add a candidate. It replaces a candidate of the same name."""
        self._passes.clear()
        self.library = [c for c in self.library if c.name != candidate.name] + [candidate]

    def whitened(self, values: Values, q: float) -> Array:
        """Whitened innovations (n,): each is divided by the square root of its variance S."""
        return self._pass(values, q)[0]

    def _pass(self, values: Values, q: float) -> tuple[Array, float, np.ndarray]:
        """Whitened innovations (n,), sum of log S, and True (N,) for the rows that they are of."""

        def make() -> tuple[Array, float, np.ndarray]:
            problem, p = self.system.build(self.library, values)
            innovations(problem, p, q, self._stop, self._nu, self._S, self._states, NONE, NOTHING)
            keep = self.rows & np.isfinite(self._nu)
            S = self._S[keep]
            return self._nu[keep] / np.sqrt(S), float(np.sum(np.log(S))), keep

        return remembered(self._passes, PASSES, (repr(values), q), make)

    def jacobian(self, values: Values, q: float, steps: Sequence[tuple[str, str, float]]) -> tuple[Array, Array]:
        """Whitened innovations e (n,) and their derivatives (n, J) by parameters (effect, name, step)."""
        problem, p = self.system.build(self.library, values)
        moves = self.system.moves(self.library, values, steps)
        J = np.zeros((len(self.system), len(steps)))
        innovations(problem, p, q, self._stop, self._nu, self._S, self._states, moves, J)
        keep = self.rows & np.isfinite(self._nu)
        root = np.sqrt(self._S[keep])
        e, J = self._nu[keep] / root, J[keep] / root[:, None]
        for j, (effect, name, step) in enumerate(steps):
            if effect == "camera_offset":  # it moves the measured positions; the filter has no derivatives by these
                moved = changed(values, effect, name, values[effect][name] + step)
                J[:, j] = (self.whitened(moved, q) - e) / step
        return e, J

    def everywhere(self, values: Values, q: float) -> tuple[Array, Array]:
        """Whitened innovations (N,) of all rows, NaN where there is none, and filtered states (N, 5)."""
        problem, p = self.system.build(self.library, values)
        n = len(self.system)
        nu, S, states = np.empty(n), np.empty(n), np.empty((n, 5))
        innovations(problem, p, q, n, nu, S, states, NONE, NOTHING)
        return nu / np.sqrt(S), states

    def minus2(self, values: Values, q: float) -> float:
        """-2 log L with the variance of a measurement eliminated; inf where it is not finite."""
        e, logs, counted = self._pass(values, q)
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            out = len(e) * math.log(max(float(np.mean(e * e)), 1e-300)) + logs if len(e) else math.inf
        if not math.isfinite(out):
            return math.inf
        return out + self.prior(values) + self.system.volume(values, counted)

    def prior(self, values: Values) -> float:
        """Penalty in -2 log L for values that differ from their defaults, by the priors."""
        known = {(c.name, name): spec for c in self.library for name, spec in c.parameters.items()}
        numbers = ((known[e, name], value) for e, given in values.items() for name, value in given.items())
        return sum(((value - spec.default) / spec.prior) ** 2 for spec, value in numbers)


def best_q(likelihood: Likelihood, values: Values, guess: float | None = None) -> float:
    """The likeliest process noise, 1/s^3: by golden section over all decades, or by a parabola around a guess."""
    if not likelihood.noisy:
        return guess or math.sqrt(Q_LOW * Q_HIGH)
    low, high = math.log(Q_LOW), math.log(Q_HIGH)

    def at(x: float) -> float:
        return likelihood.minus2(values, math.exp(x))

    if guess is not None:
        return math.exp(_parabola(at, math.log(guess), low, high))
    a, b = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    fa, fb = at(a), at(b)
    while high - low > 0.4:
        if fa < fb:
            high, b, fb = b, a, fa
            a = high - GOLDEN * (high - low)
            fa = at(a)
        else:
            low, a, fa = a, b, fb
            b = low + GOLDEN * (high - low)
            fb = at(b)
    return math.exp(a if fa < fb else b)


def _parabola(at: Callable[[float], float], x: float, low: float, high: float) -> float:
    """A lower point of a function near x, between bounds, by one parabola through three points."""
    left, right = max(x - WIDTH, low), min(x + WIDTH, high)
    f, fl, fr = at(x), at(left), at(right)
    a, b = x - left, x - right
    bend = a * (f - fr) - b * (f - fl)
    best = min(((fl, left), (f, x), (fr, right)))
    if a == 0.0 or b == 0.0 or bend == 0.0:
        return best[1]
    new = x - 0.5 * (a * a * (f - fr) - b * b * (f - fl)) / bend
    new = min(max(new, x - 3.0 * WIDTH, low), x + 3.0 * WIDTH, high)
    return min((at(new), new), best)[1]


def fit(likelihood: Likelihood, free: Sequence[Effect], start: Values, q: float | None = None) -> Fit:
    """The likeliest values of the free effects. Values and process noise are fitted in turn until neither changes."""
    names = [(c.name, name, spec) for c in free for name, spec in c.parameters.items()]
    x = np.array([start[c][name] for c, name, _ in names])

    def values_of(x: Array) -> Values:
        out: Values = {c.name: {} for c in free}
        for (c, name, _), value in zip(names, x, strict=True):
            out[c][name] = float(value)
        return out

    q = best_q(likelihood, values_of(x), q)
    J, minus2 = np.zeros((1, 0)), likelihood.minus2(values_of(x), q)
    for _ in range(ROUNDS if len(x) else 0):
        before = minus2
        x, J, minus2 = _gauss_newton(likelihood, values_of, x, q, names)
        new = best_q(likelihood, values_of(x), q)
        better = likelihood.minus2(values_of(x), new)
        settled = abs(math.log(new / q)) < 0.5
        if better < minus2:
            minus2, q = better, new
        if settled and before - minus2 < STEADY:
            break
    e = likelihood.whitened(values_of(x), q)
    variance, prior = float(np.mean(e * e)), np.array([spec.prior for *_, spec in names])
    stderr = values_of(_sigma(J, likelihood.repeats * variance, prior)) if len(x) else {}
    return Fit(tuple(free), values_of(x), minus2, math.sqrt(variance), q, stderr)


def fit_without(likelihood: Likelihood, found: Fit, effect: Effect) -> Fit:
    """The fit without one of its effects, all others fitted again."""
    rest = [c for c in found.candidates if c is not effect]
    return fit(likelihood, rest, {c.name: found.values[c.name] for c in rest}, found.q)


def start_of(effect: Effect) -> dict[str, float]:
    """The first of an effect's start values for a fit."""
    return dict(zip(effect.parameters, effect.first_guesses()[0], strict=True))


def forecast(likelihood: Likelihood, current: Fit, c: Effect, start: dict[str, float]) -> float:
    """The fall of -2 log L in one linear step of a candidate from its start.

    current: the fit of the accepted effects, with its process noise"""
    values = {**current.values, c.name: start}
    steps = [(k.name, name, spec.step) for k in (*current.candidates, c) for name, spec in k.parameters.items()]
    e, J = likelihood.jacobian(values, current.q, steps)
    n = len(e) / likelihood.repeats
    J = J / np.maximum(np.linalg.norm(J, axis=0), 1e-12)
    left = e - J @ np.linalg.lstsq(J, e, rcond=1e-10)[0]
    here = current.minus2 - likelihood.minus2(values, current.q)  # the start itself may already be better, or worse
    return here + n * math.log(float(e @ e) / max(float(left @ left), 1e-300))


def _sigma(J: Array, variance: float, prior: Array) -> Array:
    """Standard errors from the Jacobian of the whitened innovations and from the priors."""
    J = np.vstack([J, np.diag(math.sqrt(variance) / prior)])
    scale = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    _, sizes, turn = np.linalg.svd(J / scale, full_matrices=False)
    root = turn.T / np.maximum(sizes, 1e-12 * sizes[0])
    with np.errstate(over="ignore"):  # infinite for a parameter that changes nothing
        return np.sqrt(variance) * np.linalg.norm(root, axis=1) / scale


def _gauss_newton(
    likelihood: Likelihood, values_of: Callable[[Array], Values], x: Array, q: float,
    names: Sequence[tuple[str, str, Parameter]],
) -> tuple[Array, Array, float]:  # fmt: skip
    """Values, last Jacobian and -2 log L after Levenberg-Marquardt steps on the whitened innovations, inside bounds."""
    low, high, step, default, prior = (
        np.array([getattr(spec, field) for *_, spec in names]) for field in ("low", "high", "step", "default", "prior")
    )
    best, damping, J = likelihood.minus2(values_of(x), q), 1e-4, np.zeros((1, len(x)))
    for _ in range(STEPS):
        inward = np.where(x + step > high, -step, step)
        e, J = likelihood.jacobian(values_of(x), q, [(c, n, s) for (c, n, _), s in zip(names, inward, strict=True)])
        scale = np.maximum(np.linalg.norm(J, axis=0), 1e-12)
        A, g = (J / scale).T @ (J / scale), (J / scale).T @ e
        variance = likelihood.repeats * float(np.mean(e * e))
        A += np.diag(variance / (prior * scale) ** 2)
        g += variance * (x - default) / (prior**2 * scale)
        held = ((x <= low) & (g > 0.0)) | ((x >= high) & (g < 0.0))  # at a bound, and pulled against it
        A[held], A[:, held], g[held] = 0.0, 0.0, 0.0
        gained = 0.0
        while DAMPING[0] <= damping <= DAMPING[1]:
            new = np.clip(x - np.linalg.solve(A + damping * np.eye(len(x)), g) / scale, low, high)
            minus2 = likelihood.minus2(values_of(new), q)
            if minus2 < best:
                gained, best, x = best - minus2, minus2, new
                damping = max(damping / 5.0, DAMPING[0])
                break
            damping *= 5.0
        damping = min(damping, 1.0)
        if gained < ENOUGH:
            break
    return x, J, best
