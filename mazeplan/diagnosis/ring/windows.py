"""Fits to the smoothed accelerations of a record: they predict the positions in each window of the smoothing.

A filter that predicts one sample ahead weighs errors by its noise. Blows at the edges of openings look like strong
white noise in the acceleration. With this noise, nothing slower than a sample counts any more. The residual here is

    e_k = sum_j c_j theta_(k+j) - sum_j c_j theta^_(k+j),    j = -3 .. 3

with the weights c of a Savitzky-Golay second derivative. The positions theta^ are predicted from the first sample of
the window on (`scores`, matched). Neighbouring windows share samples. The smoothing averages the acceleration with
weights w. With white noise in the acceleration, n windows count as n sum(w^2) independent ones.

Unexplained blows make long tails. Therefore the residuals have Student's distribution with nu degrees of freedom and
scale s. With s eliminated,

    -2 log L = n sum(w^2) [ 2 log s + (nu + 1) mean log(1 + e^2 / (nu s^2)) ]

This weighs residuals by (nu + 1) / (nu + e^2 / s^2): blows count little, and the fit finds forces that act all the
time. For the effects of blows, nu is infinite: least squares.

Some effects make the path jump: friction at rest, openings, the camera. Derivatives by their parameters are
differences of residuals. The derivative by a smooth force is the force itself, averaged in the same way as the
smoothing averages.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mazeplan.core.progress import Words
from mazeplan.core.records import Array, IntArray
from mazeplan.diagnosis.document import Values, changed
from mazeplan.diagnosis.ring.fit import Fit, Likelihood, best_q, fit, fit_without, start_of
from mazeplan.diagnosis.ring.kalman import accelerations, midpoint_roll_outs
from mazeplan.diagnosis.ring.scores import KNOWN, MATCHED, begun_at, matched_target
from mazeplan.diagnosis.ring.search import ACCEPT, Finding, Search, price, still_alike
from mazeplan.diagnosis.ring.system import RingSystem, remembered
from mazeplan.learning.smoothing import acceleration_kernel, savgol_weights
from mazeplan.physics.effect import DRAG, FORCE, GRAVITY, Effect

TAILS = 4.0  # degrees of freedom nu
EVERY = 2  # windows from one residual to the next: neighbours share six of seven samples
ASIDE = (-0.05, 0.0, 0.05)  # rad, by which openings may seem rotated if blows come at one edge only
SHARE = 0.1  # minimum further gain of a closer model, as a share of the effect's gain
SMOOTH = (FORCE, DRAG, GRAVITY)  # they change the acceleration without jumps
KEPT = 100  # cached residuals, so that the same values are not computed twice


class WindowLikelihood(Likelihood):
    """-2 log L of smoothed accelerations on some rows. It does not depend on the process noise.

    tails: degrees of freedom of Student's distribution

    Raises ValueError for a record without accelerations of its own."""

    noisy = False

    def __init__(self, system: RingSystem, library: Sequence[Effect], rows: np.ndarray, tails: float = TAILS) -> None:
        super().__init__(system, library, rows)
        self.tails, target = tails, matched_target(system)
        if target is None:
            raise ValueError("the record brings no accelerations by the smoothing that is known")
        half = MATCHED.window // 2
        begun = begun_at(system.begins)
        at = np.flatnonzero(rows & np.isfinite(target))
        at = at[at - half - begun[at] >= KNOWN]
        seen = np.isfinite(system.theta)  # the first sample of a window and the one before give its speed
        self.windows: IntArray = at[seen[at - half] & seen[at - half - 1]][::EVERY]
        self.target: Array = target[self.windows]
        self.weights = savgol_weights(MATCHED.window, MATCHED.order, 2, system.dt)
        self.kernel = acceleration_kernel(MATCHED.window, MATCHED.order)
        self.worth = EVERY * float(np.sum(self.kernel**2))
        self.repeats = 1.0 / self.worth
        self._kept: dict[str, Array] = {}

    def residuals(self, values: Values) -> Array:
        """Residuals e (n,), rad/s^2."""

        def make() -> Array:
            problem, p = self.system.build(self.library, values)
            angles = midpoint_roll_outs(problem, p, self.windows - MATCHED.window // 2, MATCHED.window - 1)
            return self.target - self.system.seen_at(values, angles) @ self.weights

        return remembered(self._kept, KEPT, repr(values), make)

    def whitened(self, values: Values, q: float) -> Array:
        """Weighted residuals (n,), rad/s^2: each is multiplied by the square root of its weight."""
        e = self.residuals(values)
        return e * np.sqrt(weights_of(e, spread_of(e, self.tails), self.tails))

    def jacobian(self, values: Values, q: float, steps: Sequence[tuple[str, str, float]]) -> tuple[Array, Array]:
        """Weighted residuals e (n,) and their derivatives (n, J) by parameters (effect, name, step to move by)."""
        e = self.residuals(values)
        root = np.sqrt(weights_of(e, spread_of(e, self.tails), self.tails))
        J = np.empty((len(e), len(steps)))
        smooth = {c.name for c in self.library if c.acts in SMOOTH or c.name in ("tilt_gain", "axis_misalignment")}
        here = self._averaged(values)
        for j, (effect, name, step) in enumerate(steps):
            moved = changed(values, effect, name, values[effect][name] + step)
            if effect in smooth:
                J[:, j] = (here - self._averaged(moved)) / step
            else:
                J[:, j] = (self.residuals(moved) - e) / step
        return root * e, root[:, None] * J

    def _averaged(self, values: Values) -> Array:
        """Acceleration (n,) along the measured path, averaged over each window with the weights of the smoothing.

        It misses a few percent of a change, which is good enough for the direction of a step."""
        problem, p = self.system.build(self.library, values)
        x, half = np.nan_to_num(problem.y), MATCHED.window // 2
        along = accelerations(problem, p, x, np.gradient(x, self.system.dt))
        return along[self.windows[:, None] + np.arange(-half, half + 1)] @ self.kernel

    def minus2(self, values: Values, q: float) -> float:
        """-2 log L with the scale eliminated; inf where it is not finite."""
        e = self.residuals(values)
        if not np.isfinite(e).all():
            return math.inf
        s = spread_of(e, self.tails)
        tails = 0.0
        if math.isfinite(self.tails):
            tails = (self.tails + 1.0) * float(np.mean(np.log1p(e * e / (self.tails * s * s))))
        return len(e) * self.worth * (2.0 * math.log(s) + tails) + self.prior(values)


def weights_of(e: Array, spread: float, tails: float = TAILS) -> Array:
    """Weights (n,) of squared residuals: the weighted sum of squares falls where -2 log L falls."""
    if not math.isfinite(tails):
        return np.ones(len(e))
    return (tails + 1.0) / (tails + (e / spread) ** 2)


def spread_of(e: Array, tails: float = TAILS) -> float:
    """The most likely scale of residuals (n,) by Student's distribution, rad/s^2."""
    if not math.isfinite(tails):
        return math.sqrt(max(float(np.mean(e * e)), 1e-12))
    square = max(float(np.median(e * e)), 1e-12)
    for _ in range(30):
        new = float(np.mean(weights_of(e, math.sqrt(square), tails) * e * e))
        done = abs(new - square) < 1e-7 * square
        square = max(new, 1e-12)
        if done:
            break
    return math.sqrt(square)


def _looked_at(
    squares: WindowLikelihood, had: Sequence[Effect], values: Values, closely: Sequence[Effect]
) -> tuple[Fit, dict[str, str], dict[str, float]]:
    """Replace effects by closer models where these explain more. Fits start at the values of the plain models.

    Returns the fit, the earlier name of each closer model, and its gain of -2 log L."""
    current = fit(squares, had, {c.name: values[c.name] for c in had})
    before, gains = dict[str, str](), dict[str, float]()
    for c in had:
        rest = [x for x in current.candidates if x is not c]
        known, here = {x.name: current.values[x.name] for x in rest}, current.values[c.name]
        near = [x for x in closely if x.name in (c.name, *c.rivals)]
        ways = [(x, _closer(squares, rest, x, {**known, c.name: here})) for x in near]
        if not ways:
            continue
        best, found = min(ways, key=lambda way: way[1].minus2 + price(squares, way[0]))
        gain = current.minus2 - found.minus2 - price(squares, best) + price(squares, c)
        without = fit_without(squares, current, c).minus2 - current.minus2
        if gain > max(ACCEPT, SHARE * without):
            current, before[best.name], gains[best.name] = found, c.name, gain
    return current, before, gains


def _closer(squares: WindowLikelihood, rest: Sequence[Effect], c: Effect, values: Values) -> Fit:
    """Fit of a closer model c together with the other effects; it starts at the values of the plain model."""
    if c.name in values:
        usual = {name: spec.default for name, spec in c.parameters.items()}
        return fit(squares, [*rest, c], {**values, c.name: {**usual, **values[c.name]}})
    usual = start_of(c)
    (plain,) = (values[name] for name in c.rivals)
    known = {x.name: values[x.name] for x in rest}
    starts = ({**known, c.name: {**usual, "rotation": plain["rotation"] + off}} for off in ASIDE)
    return min((fit(squares, [*rest, c], start) for start in starts), key=lambda found: found.minus2)


def by_windows(
    likelihood: Likelihood, library: Sequence[Effect], tell: Words, closely: Sequence[Effect],
) -> tuple[Finding, Likelihood]:  # fmt: skip
    """The finding of a record of smoothed accelerations without commands, and the likelihood of its fit.

    Forces that act all the time come first, then effects of blows. At the end, the filter finds the noise of the final
    model, for roll-outs.

    closely: closer models that may replace plain ones; only blows show the difference"""
    system, rows = likelihood.system, likelihood.rows
    tell("forces")
    steady = Search(WindowLikelihood(system, library, rows), library, tell).run()
    had, values = steady.final.candidates, steady.final.values
    tell("blows")
    squares = WindowLikelihood(system, [*library, *closely], rows, math.inf)
    rest = [c for c in library if c.name not in values and c.named]
    found = Search(squares, rest, tell, free=[c for c in had if c.named]).run(values)
    best, before, gains = _looked_at(squares, found.final.candidates, found.final.values, closely)
    values = best.values
    q = best_q(likelihood, values)
    e = likelihood.whitened(values, q)
    final = replace(best, q=q, noise=float(np.sqrt(np.mean(e * e))))
    worth = {**steady.worth, **found.worth}
    worth |= {name: gain + worth.get(before[name], 0.0) for name, gain in gains.items()}
    alike = still_alike(steady.alike + found.alike, values)
    return replace(steady, final=final, alike=alike, worth=worth), squares
