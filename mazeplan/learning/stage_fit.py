"""Fit the axes of the stage (`physics.rig.stage`) to a log, by output error, and choose their kind.

The fit simulates the axis under the recorded commands (zero-order hold) and compares angles, so that noise of the tilt
sensor causes no bias. It tries axes that follow at once, with a first-order lag, and as second-order servos, and takes
the highest order whose numbers the record determines; then a limited rate, backlash, and steps of the command. Every
fourth block of the record takes no part in these fits. A richer kind is kept only if it predicts these blocks better
beyond doubt, and if the record determines its numbers. The chosen kind is then fitted to the whole record.

Both axes get fits of one order, each with the share of the other one's command that the axis follows, too: what a
fitted axis leaves of the measured angle is regressed on how it follows its own command and the other one's.

The noise is at least that of the sensor's resolution (Q / sqrt(12) for angles rounded to Q), and at least MIN_NOISE.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from mazeplan.core.logs.table import Table
from mazeplan.core.records import Array
from mazeplan.core.side_by_side import in_processes
from mazeplan.learning.axis_record import CLEAR, MIN_NOISE, AxisRecord, determined, free_numbers
from mazeplan.physics.effects.rig import axis_coupling
from mazeplan.physics.rig.stage import StageAxis, actuator_output, simulate_axis

MIN_SAMPLES = 60  # minimum number of samples
LEAST_RANGE = 1e-3  # rad; minimum range of the commands
FASTEST_POLES = (0.0, 1.5, 1.2)  # fastest pole that samples usually show, times their rate, by order
NO_DEAD_TIME = 1e-4  # s
DOUBTFUL = 4.0  # of -2 log L, by a dead time that may be none
BLOCK_S, SURE = 1.0, 5.0  # s, block of correlated residuals; minimum coupling, in standard errors
SMALLEST_COUPLING = axis_coupling.parameters["beta_from_gamma"].smallest
NEARLY = 1.1  # times the rms of a fit: another fit of the axis that leaves less is as good
MOST_COUPLING = axis_coupling.parameters["beta_from_gamma"].high
LAG_S, EXCHANGED = 0.4, 0.6  # s, of a servo; size of a correlation that only exchanged or turned tilts have
FEWEST_TILTS = 20  # rows with both tilts, by which they are compared with the commands


@dataclass(frozen=True)
class StageFit:
    """An axis fitted to a log.

    rms:      of measured minus simulated angle, rad; NaN if the tilt is not measured
    samples:  number of samples used
    noise:    of the sensor: its white noise, at least its resolution / sqrt(12) and MIN_NOISE, rad"""

    axis: StageAxis
    rms: float
    samples: int
    noise: float = MIN_NOISE

    @property
    def times_noise(self) -> float:
        """rms over the noise: 1 if the kind of axis explains the record; NaN if the tilt is not measured."""
        return float(np.maximum(self.rms / self.noise, 1.0))


def fit_axis(
    u: Array, angle: Array, dt: float, breaks: Array | None = None, near: StageAxis | None = None,
    kind: StageAxis | None = None, only: tuple[str, ...] | None = None,
) -> StageFit:  # fmt: skip
    """Fit one axis to commands u (N,) and measured angles (N,), sampled every dt s.

    breaks:  True where a new record begins
    near:    a similar axis: only its numbers are fitted, its kind stays
    kind:    an axis of the same order, with whose numbers those found can be compared; None: all kinds are tried. With
             a kind, a limited rate, backlash and a dead band are looked for beside it
    only:    names of the numbers to fit, with `near`; None: all of its kind

    Raises ValueError for fewer than MIN_SAMPLES samples or a constant command."""
    if len(u) < MIN_SAMPLES:
        raise ValueError(f"got {len(u)} samples, expected at least {MIN_SAMPLES}: record for longer")
    if np.ptp(u) < LEAST_RANGE:
        got = f"commands within {np.ptp(u):.2g} rad"
        raise ValueError(f"got {got}, expected at least {LEAST_RANGE:g} rad: tilt the plate, as `collect` does")
    data = AxisRecord.of(u, angle, dt, breaks, near)
    if near is not None:
        return _finished(data, data.fit(near, data.used, only))
    if kind is not None:
        return _finished(data, data.fit(_of_kind(data, kind), data.used))
    return _finished(data, _without_doubtful_dead_time(data, data.fit(_chosen(data), data.used)))


def _without_doubtful_dead_time(data: AxisRecord, axis: StageAxis) -> StageAxis:
    """The axis without a dead time if none does as well.

    A faster axis that starts later moves nearly alike, and a plan that trusts its speed commands too late."""
    names = tuple(name for name in free_numbers(axis) if name != "dead_time")
    if not axis.order or not 0.0 < axis.dead_time < 2.0 * axis.stderr["dead_time"]:
        return axis
    plain = data.fit(replace(axis, dead_time=0.0), data.used, names)
    if 2.0 * data.used.sum() * math.log(data.rms(plain, data.used) / data.rms(axis, data.used)) > DOUBTFUL:
        return axis
    return replace(plain, stderr={**plain.stderr, "dead_time": axis.stderr["dead_time"]})


def _chosen(data: AxisRecord) -> StageAxis:
    """The kind of axis that predicts held-out blocks best, fitted to the others."""
    orders = [data.from_starts(order) for order in (0, 1, 2)]
    best = _of_order(data, orders)
    if data.rms(best, data.used) > 1.1 * data.noise:
        rate = data.fastest_rate()
        best = _simplest(data, [best, *(data.with_limit(axis, rate) for axis in orders)])
    if data.rms(best, data.used) > 1.1 * data.noise:
        of = {axis.order: axis for axis in (*orders, best)}
        best = _simplest(data, [best, *(data.with_play(of[order]) for order in range(best.order + 1))])
    best = _richer(data, best, (best.behind,))
    if data.step > 0.0 and data.rms(best, data.used) > 1.1 * data.step / math.sqrt(12.0):
        best = _simplest(data, [best, data.fit(replace(best, resolution=data.step / best.gain), data.fitted)])
    return best


def _of_kind(data: AxisRecord, kind: StageAxis) -> StageAxis:
    """The axis of a kind, with a limited rate and backlash if the record shows them."""
    best = data.from_starts(kind.order)
    if math.isfinite(kind.rate_limit):
        limited = [data.with_limit(best, rate) for rate in (kind.rate_limit, data.fastest_rate())]
        best = min(limited, key=lambda axis: data.rms(axis, data.fitted))
    if kind.backlash:
        plain, best = best, data.with_play(best, (kind.behind,))
        if data.rms(best, data.used) > 1.1 * data.noise:  # with play alone, play stands in for a dead band
            best = _simplest(data, [best, data.with_play(data.with_band(plain), (kind.behind,))])
    return _richer(data, best, (False, True), band=True)


def _richer(data: AxisRecord, best: StageAxis, behind: tuple[bool, ...], band: bool = False) -> StageAxis:
    """The axis with a limited rate, backlash and a dead band, if it lacks them and they predict held-out blocks better.

    behind: where gears may be; band: whether there may be a dead band"""

    def likelier(other: StageAxis, axis: StageAxis) -> bool:
        """Overtaxed servos jump with a dead band at moments that differ from block to block."""
        return 2.0 * data.used.sum() * math.log(data.rms(axis, data.used) / data.rms(other, data.used)) > CLEAR

    while data.rms(best, data.used) > 1.1 * data.noise:
        more = [] if math.isfinite(best.rate_limit) else [data.with_limit(best, data.fastest_rate())]
        more += [] if best.backlash else [data.with_play(best, behind)]
        more += [data.with_band(best)] if band and not best.deadband else []
        better = [a for a in more if data.determines(a) and (data.beats(a, best) or (a.deadband and likelier(a, best)))]
        if not better:
            break
        best = min(better, key=lambda axis: data.rms(axis, data.fitted))
    return best


def _of_order(data: AxisRecord, orders: list[StageAxis]) -> StageAxis:
    """The axis of the highest order that the record determines, unless one of lower order predicts better: servos of
    machines are of second order, as far as one can see it."""
    best = orders[0]
    for axis in orders[1:]:
        seen = max(abs(pole) for pole in axis.poles()) < FASTEST_POLES[axis.order] / data.dt
        if data.determines(axis) and (data.beats(axis, best) or (seen and not data.beats(best, axis))):
            best = axis
    return best


def _simplest(data: AxisRecord, candidates: list[StageAxis]) -> StageAxis:
    """The first of the candidates that no later one beats on the held-out blocks; the later ones are richer."""
    best = candidates[0]
    for other in candidates[1:]:
        if data.determines(other) and data.beats(other, best):
            best = other
    return best


def _finished(data: AxisRecord, axis: StageAxis) -> StageFit:
    """The result, without a dead time that the record does not tell from none."""
    freedom = len(free_numbers(axis))
    if axis.dead_time < NO_DEAD_TIME:
        axis = replace(axis, dead_time=0.0)
    residual, used, n = data.residual(axis), data.used, int(data.used.sum())
    bend = np.diff(residual, 2)[used[2:] & used[1:-1] & used[:-2]]
    white = math.sqrt(float(np.mean(bend**2)) / 6.0) if len(bend) else 0.0  # a second difference has 6 times this
    rms = float(np.sqrt(np.sum(residual[used] ** 2) / max(n - freedom, 1)))
    return StageFit(axis, rms, n, max(data.noise, min(white, rms)))


def check_axes(table: Table) -> None:
    """Raise ValueError if the measured tilts are exchanged or turned round, beside commands up to LAG_S before."""
    angles = np.column_stack([table["beta"], table["gamma"]])
    commands = np.column_stack([table["u_beta"], table["u_gamma"]])
    size, high = np.zeros((2, 2)), np.zeros((2, 2))  # most of the correlations of each angle (row) with each command
    seen = np.isfinite(angles[:, 0]) & np.isfinite(angles[:, 1])
    for lag in range(round(LAG_S / table.dt)):
        rows = np.flatnonzero(seen[lag:])
        if len(rows) < FEWEST_TILTS:
            return
        here = _unit(angles[lag:][rows]).T @ _unit(commands[rows])
        size, high = np.maximum(size, np.abs(here)), np.maximum(high, here)
    if min(size[0, 1], size[1, 0]) > EXCHANGED > max(size[0, 0], size[1, 1]):
        raise ValueError("beta follows u_gamma and gamma follows u_beta: are the two measured tilts exchanged?")
    # a sine has both signs: it follows its command, and half a period later the opposite of it
    turned = [name for i, name in enumerate(("beta", "gamma")) if size[i, i] > EXCHANGED > high[i, i]]
    if turned:
        raise ValueError(f"the measured tilt of {' and '.join(turned)} has the opposite sign of its command")


def _unit(x: Array) -> Array:
    """Columns (N, 2) around their means, each of length 1; 0 where nothing changes."""
    x = x - x.mean(axis=0)
    return np.asarray(x / np.maximum(np.linalg.norm(x, axis=0), 1e-12), dtype=np.float64)


def fit_axes(u: Array, angles: Array, dt: float, breaks: np.ndarray) -> tuple[StageFit, StageFit]:
    """The fits of beta and gamma. The servos of a rig are of one kind: both axes get the same order if the axis that
    changes for it fits nearly as well. Raises ValueError as `fit_axis`.

    u, angles: commands and measured angles (N, 2), rad
    breaks: True (N,) where a new record begins"""

    def fitted(i: int, kind: StageAxis | None = None) -> StageFit:
        return _coupled(u[:, i], u[:, 1 - i], angles[:, i], dt, breaks, kind)

    beta, gamma = in_processes(fitted, (0, 1))
    if beta.axis.order == gamma.axis.order:
        return beta, gamma
    like_gamma, like_beta = fitted(0, gamma.axis), fitted(1, beta.axis)
    ways = [(like_gamma, beta, (like_gamma, gamma)), (like_beta, gamma, (beta, like_beta))]
    alike = [(new.rms / old.rms, both) for new, old, both in ways if determined(new.axis)]
    more, both = min(alike, default=(math.inf, (beta, gamma)), key=lambda way: way[0])
    return both if more < NEARLY else (beta, gamma)


def _coupled(own: Array, other: Array, angle: Array, dt: float, breaks: np.ndarray, kind: StageAxis | None) -> StageFit:
    """The fit of an axis, with the share of the other axis's command that it surely follows."""
    found = fit_axis(own, angle, dt, breaks, kind=kind)
    share, sigma, follows = coupling(found.axis, own, other, angle, dt, np.isfinite(angle))
    if not significant(share, sigma):
        return found
    again = fit_axis(own, angle - found.axis.gain * share * follows, dt, breaks, kind=kind)
    stderr = {**again.axis.stderr, "coupling": sigma}
    return replace(again, axis=replace(again.axis, coupling=share, stderr=stderr))


def coupling(
    axis: StageAxis, own: Array, other: Array, angle: Array, dt: float, rows: np.ndarray
) -> tuple[float, float, Array]:
    """Share, its standard error, and how the axis follows the other command (N,), rad.

    own, other: commands (N,), rad
    angle: measured (N,), rad
    rows: rows (N,) to use

    The axis is sure to follow the other command if the share is above SMALLEST_COUPLING and SURE standard errors."""
    unit = replace(axis, gain=1.0, offset=0.0)
    follows, moved = (simulate_axis(one, actuator_output(u, axis), dt) for one, u in ((unit, other), (axis, own)))
    A = np.column_stack([follows, moved, np.ones(len(own))])[rows]
    left = (angle - moved)[rows]
    w, *_ = np.linalg.lstsq(A, left, rcond=None)
    e = left - A @ w
    inverse = np.linalg.inv(A.T @ A)
    block = np.arange(len(e)) // max(round(BLOCK_S / dt), 1)
    scores = np.stack([np.bincount(block, weights=column * e) for column in A.T], axis=1)
    sigma = float(np.sqrt((inverse @ (scores.T @ scores) @ inverse)[0, 0])) / axis.gain  # for correlated neighbours
    return min(max(float(w[0]) / axis.gain, -MOST_COUPLING), MOST_COUPLING), sigma, follows


def significant(share: float, sigma: float) -> bool:
    """Whether a coupling is large enough to change the other numbers of the axis."""
    return abs(share) >= max(SMALLEST_COUPLING, SURE * sigma)
