"""A record of one axis of the stage, and fits of an axis of a given kind to it, by output error.

`stage_fit` chooses the kind."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from mazeplan.core.records import Array, IntArray
from mazeplan.physics.rig.stage import StageAxis, actuator_output, simulate_axis

MIN_NOISE = 2e-4  # rad; no tilt sensor of such a rig is known better: a clinometer shows 0.1 degree
POLES = (2.0, 4.0, 8.0, 16.0, 32.0, 64.0)  # rad/s, starts
DAMPINGS, DEAD_TIMES = (0.2, 0.5, 1.0, 2.0), (0.0, 1.0 / 30.0, 1.0 / 15.0, 0.1, 0.15, 0.2, 0.3)  # -, s
LOOKED_AT = 3000  # maximum number of samples for the choice among starts
STARTS = 3  # number of starts: a fast axis with a dead time resembles a slow axis without
SHORTEST = 30  # minimum number of samples of a stretch; shorter ones are left out
SETTLE_S = 0.5  # minimum s left out at the beginning of a stretch, because the motion before it is unknown
SETTLE_TIMES = 3.5  # time constants of the slowest pole left out there (3 % remain), up to a third of the stretch
BLOCK_S, HELD_OUT = 10.0, 4  # s of a block; every how many-th block is held out
CLEAR, TIMES = 15.0, 2.5  # minimum gain of -2 log L on held-out blocks, and in its standard errors; or CLEAR in each
PLAYS = (0.002, 0.004, 0.008, 0.016, 0.032, 0.064)  # rad, backlash tried
LIKELY = 2  # number of these at which fits start
BANDS = np.geomspace(1e-3, 0.08, 24)  # rad, dead bands tried; the first one is the smallest that is worth a word
NEAR_BANDS, FINER = 4, 48  # number of these that are refined; number of finer ones between the neighbours of each
LAG, FASTEST = 3, 0.995  # samples; quantile of rates that counts as the fastest turn
DETERMINED = 0.5  # maximum standard error of a frequency, a damping or a rate limit, as a share of it
CORRELATED_S, STEADY_S = 1.0, 0.3  # s; residuals are alike over this time at most; what the floor stands for is
FREE = (
    ("gain", "offset"),
    ("gain", "natural_frequency", "dead_time", "offset"),
    ("gain", "natural_frequency", "damping", "dead_time", "offset"),
)  # fmt: skip; by order
LIMITS = {  # bounds of a fit
    "gain": (0.1, 10.0), "natural_frequency": (0.5, 240.0), "damping": (0.05, 7.0), "dead_time": (0.0, 0.5),
    "offset": (-0.3, 0.3), "rate_limit": (0.1, 50.0), "backlash": (0.0, 0.08),
}  # fmt: skip
LOGARITHMIC = ("natural_frequency", "damping", "rate_limit")
SCALE = {"dead_time": 0.01, "offset": 0.01, "backlash": 0.003}
REACHED = 1.1  # times the fastest turn of a record: it does not show a limit beyond


def resolution_of(angle: Array) -> float:
    """Step to which angles (N,) are rounded, rad; 0 if they are not."""
    values = np.unique(np.round(angle[np.isfinite(angle)], 9))
    if len(values) < 2 or len(values) > len(angle) / 4:
        return 0.0
    return float(np.median(np.diff(values)))


def fastest_turn(angle: Array, dt: float) -> float:
    """A rate that angles (N,), rad, hardly exceed, rad/s: over LAG samples, because noise seems fast."""
    return float(np.nanquantile(np.abs(angle[LAG:] - angle[:-LAG]) / (LAG * dt), FASTEST))


@dataclass(frozen=True)
class AxisRecord:
    """A record of one axis.

    used (N,):    rows after the start of each stretch
    block (N,):   number of the block of each row
    fitted (N,):  rows of the blocks that are not held out
    step:         resolution of the angles, rad"""

    u: Array
    angle: Array
    dt: float
    firsts: IntArray
    pieces: list[tuple[int, int]]
    used: np.ndarray
    block: IntArray
    fitted: np.ndarray
    step: float

    @classmethod
    def of(cls, u: Array, angle: Array, dt: float, breaks: Array | None, near: StageAxis | None) -> AxisRecord:
        """The record of commands u (N,) and angles (N,); arguments as of `stage_fit.fit_axis`."""
        firsts = np.array([0, *(np.flatnonzero(breaks[1:]) + 1 if breaks is not None else ())], dtype=np.int64)
        pieces = [(a, b) for a, b in itertools.pairwise([*firsts.tolist(), len(u)]) if b - a >= SHORTEST]
        block = np.arange(len(u)) // max(round(min(BLOCK_S, len(u) * dt / (3 * HELD_OUT)) / dt), 1)
        used = np.isfinite(angle)
        whole = cls(u, angle, dt, firsts, pieces, used, block, used, resolution_of(angle))
        settled = SETTLE_TIMES / (near or whole.fit(whole.starts(2)[0], whole.few())).slowest()
        kept = np.zeros(len(u), dtype=bool)
        for a, b in pieces:
            kept[a + min(round(max(settled, SETTLE_S) / dt), max((b - a) // 3, round(SETTLE_S / dt))) : b] = True
        used = used & kept
        return replace(whole, used=used, fitted=used & (block % HELD_OUT != HELD_OUT - 1))

    @property
    def noise(self) -> float:
        """Least noise of the tilt sensor, rad."""
        return max(self.step / math.sqrt(12.0), MIN_NOISE)

    def few(self) -> np.ndarray:
        """The first rows of those that are fitted."""
        return self.fitted & (np.cumsum(self.fitted) <= LOOKED_AT)

    def residual(self, axis: StageAxis) -> Array:
        """Simulated minus measured angle (N,), rad."""
        return simulate_axis(axis, actuator_output(self.u, axis), self.dt, self.firsts) - self.angle

    def rms(self, axis: StageAxis, rows: np.ndarray) -> float:
        """Root mean square of the residual on some rows (N,), rad."""
        return float(np.sqrt(np.mean(self.residual(axis)[rows] ** 2)))

    def fastest_rate(self) -> float:
        """A rate that the plate hardly exceeds, rad/s."""
        return float(np.clip(fastest_turn(np.where(self.used, self.angle, math.nan), self.dt), *LIMITS["rate_limit"]))

    def fit(self, start: StageAxis, rows: np.ndarray, only: tuple[str, ...] | None = None) -> StageAxis:
        """The axis of the same kind that fits some rows best, with standard errors."""
        names, rows = only or free_numbers(start), rows & self.used
        low, high = (np.array([_inner(name, LIMITS[name][end]) for name in names]) for end in (0, 1))

        def error(x: Array) -> Array:
            return self.residual(_with(start, names, x))[rows] / self.noise

        x0 = np.clip([_inner(name, getattr(start, name)) for name in names], low, high)
        scale = np.array([SCALE.get(name, 0.1) for name in names])
        steps = scale * (1e-2 if start.rate_limit < math.inf or start.backlash else 1e-5)

        def jacobian(x: Array) -> Array:
            signs = np.where(x + steps > high, -1.0, 1.0)
            here, moves = error(x), np.diag(steps * signs)
            return np.column_stack([(error(x + move) - here) / move.sum() for move in moves])

        x0 = np.clip(x0, low + 1e-9, high - 1e-9)
        how: dict[str, Any] = {"jac": jacobian, "bounds": (low, high), "x_scale": scale, "max_nfev": 40}
        found = least_squares(error, x0, **how)
        axis = _with(start, names, found.x)
        stderr = self._stderr(axis, names, found.jac, found.fun, rows)
        if axis.deadband:
            stderr["deadband"] = start.stderr.get("deadband", math.inf)
        return replace(axis, stderr=stderr)

    def with_limit(self, axis: StageAxis, rate: float) -> StageAxis:
        """The axis with a limited rate that starts at this one, rad/s."""
        return self.fit(replace(axis, rate_limit=rate), self.fitted)

    def with_play(self, axis: StageAxis, behind: tuple[bool, ...] = (False, True)) -> StageAxis:
        """The axis with the backlash that fits best, in front of its lag or behind."""
        few, fits = self.few(), []
        for at in behind:
            loose = [replace(axis, backlash=b, behind=at) for b in PLAYS]
            fits += [self.fit(one, few) for one in sorted(loose, key=lambda one: self.rms(one, few))[:LIKELY]]
        return self.fit(min(fits, key=lambda one: self.rms(one, few)), self.fitted)

    def with_band(self, axis: StageAxis) -> StageAxis:
        """The axis with the dead band that fits best, from grids; as it is if none fits better."""
        few, width = self.few(), math.log(BANDS[1] / BANDS[0])
        bands = [float(band) for band in BANDS if band < 0.5 * float(np.ptp(self.u))]

        def off(axis: StageAxis, rows: np.ndarray = few) -> float:
            return self.rms(axis, rows)

        def finer(one: StageAxis, low: float, high: float, count: int) -> StageAxis:
            grid = np.geomspace(low, high, count)
            best = min((replace(one, deadband=float(band)) for band in grid), key=lambda a: off(a, self.fitted))
            width = best.deadband * (float(grid[1] / grid[0]) - 1.0)
            return self.fit(replace(best, stderr={"deadband": width}), self.fitted)

        if min((off(replace(axis, deadband=band)) for band in bands), default=math.inf) > off(axis):
            return axis
        # the lag stands in for a band that is not there, so the axis is fitted again with each
        coarse = sorted((self.fit(replace(axis, deadband=band), few) for band in bands), key=off)[:NEAR_BANDS]
        found = [finer(axis, bands[0], bands[-1], FINER * len(bands))]
        found += [finer(a, a.deadband * math.exp(-width), a.deadband * math.exp(width), FINER) for a in coarse]
        return min(found, key=lambda a: off(a, self.fitted))

    def _stderr(
        self, axis: StageAxis, names: tuple[str, ...], jac: Array, e: Array, rows: np.ndarray
    ) -> dict[str, float]:
        """Standard errors: a sandwich over blocks of CORRELATED_S, and at least those of the floor."""
        per = max(round(CORRELATED_S / self.dt), 1)
        # pinv would drop directions without information, so that they would seem certain
        _, sizes, turn = np.linalg.svd(jac, full_matrices=False)
        root = turn.T / np.maximum(sizes, 1e-12 * max(sizes[0], 1e-300))
        bread = root @ root.T
        at = np.flatnonzero(rows) // per
        starts = np.flatnonzero(np.diff(at, prepend=-1))
        scores = np.add.reduceat(jac * e[:, None], starts, axis=0)
        robust = np.diag(bread @ scores.T @ scores @ bread)
        sigma = np.sqrt(np.maximum(robust, max(STEADY_S / self.dt, 1.0) * np.diag(bread)))
        out = {
            name: float(s * (getattr(axis, name) if name in LOGARITHMIC else 1.0))
            for name, s in zip(names, sigma, strict=True)
        }
        if "dead_time" not in out:  # the samples only show between which two of them the axis jumps
            out["dead_time"] = self.dt / math.sqrt(12.0)
        return out

    def determines(self, axis: StageAxis) -> bool:
        """Whether the record determines all numbers of an axis, and reaches its limited rate."""
        reached = math.isinf(axis.rate_limit) or axis.rate_limit < REACHED * self.fastest_rate()
        return reached and determined(axis)

    def beats(self, other: StageAxis, axis: StageAxis) -> bool:
        """Whether `other` predicts the held-out blocks better beyond doubt."""
        held = self.used & ~self.fitted
        errors = [self.residual(one)[held] ** 2 for one in (other, axis)]
        variance = max(min(float(np.mean(e)) for e in errors), self.noise**2)
        _, at = np.unique(self.block[held], return_inverse=True)
        gain = np.bincount(at, weights=errors[1] - errors[0]) / variance
        spread = float(np.std(gain)) * math.sqrt(len(gain))
        return bool(gain.sum() > max(CLEAR, TIMES * spread) or gain.min() > CLEAR)

    def from_starts(self, order: int) -> StageAxis:
        """The best axis of this order, from several starts."""
        fits = [self.fit(start, self.fitted) for start in self.starts(order)]
        return min(fits, key=lambda axis: self.rms(axis, self.fitted))

    def starts(self, order: int) -> list[StageAxis]:
        """The best axes of a grid with different poles; gain and offset by least squares."""
        skip, left, chosen = round(SETTLE_S / self.dt), LOOKED_AT, list[tuple[int, int]]()
        for a, b in self.pieces:
            if left > 0:
                chosen.append((a, min(b, a + left)))
                left -= b - a
        rows = np.concatenate([np.arange(a, b) for a, b in chosen])
        firsts = np.flatnonzero(np.isin(rows, [a for a, _ in chosen]))
        used = np.concatenate([np.arange(b - a) >= skip for a, b in chosen]) & np.isfinite(self.angle[rows])
        commands, target = self.u[rows], self.angle[rows][used]
        best: dict[float, tuple[float, StageAxis]] = {}
        for axis in self._grid(order):
            moved = simulate_axis(axis, commands, self.dt, firsts)[used]
            basis = np.column_stack([moved, np.ones(len(moved))])
            (gain, offset), *_ = np.linalg.lstsq(basis, target, rcond=None)
            gain, offset = float(np.clip(gain, *LIMITS["gain"])), float(np.clip(offset, *LIMITS["offset"]))
            rest = float(np.sum((basis @ [gain, offset] - target) ** 2))
            if axis.natural_frequency not in best or rest < best[axis.natural_frequency][0]:
                best[axis.natural_frequency] = rest, replace(axis, gain=gain, offset=offset)
        return [axis for _, axis in sorted(best.values(), key=lambda found: found[0])[:STARTS]]

    def _grid(self, order: int) -> Iterator[StageAxis]:
        if order == 0:  # all dead times between two samples look alike: take the middle
            most = LIMITS["dead_time"][1]
            yield from (StageAxis.prompt(dead_time=(lag + 0.5) * self.dt) for lag in range(int(most / self.dt)))
            return
        for pole, damping, dead in itertools.product(POLES, DAMPINGS if order == 2 else (1.0,), DEAD_TIMES):
            yield StageAxis(1.0, pole, damping, dead, order=order)


def determined(axis: StageAxis) -> bool:
    """Whether a record determines all numbers of an axis: none is at its bound, or as uncertain as it is large."""
    for name in free_numbers(axis):
        value, (low, high) = getattr(axis, name), LIMITS[name]
        if name in LOGARITHMIC:
            if not 1.01 * low < value < 0.99 * high or axis.stderr[name] > DETERMINED * value:
                return False
        elif name == "backlash" and not value > 2.0 * axis.stderr[name]:
            return False
    return True


def free_numbers(axis: StageAxis) -> tuple[str, ...]:
    """Names of the numbers that are fitted."""
    limited = axis.rate_limit < math.inf
    names = FREE[axis.order] + (("dead_time",) if limited and axis.order == 0 else ())
    return names + (("rate_limit",) if limited else ()) + (("backlash",) if axis.backlash else ())


def _inner(name: str, value: float) -> float:
    """Coordinate of a fit: the value, or its logarithm."""
    return math.log(value) if name in LOGARITHMIC else float(value)


def _with(axis: StageAxis, names: tuple[str, ...], x: Array) -> StageAxis:
    """The axis with the coordinates x of the numbers of these names."""
    values = {
        name: float(np.clip(math.exp(v) if name in LOGARITHMIC else v, *LIMITS[name]))
        for name, v in zip(names, x, strict=True)
    }
    return replace(axis, **values)
