"""Samples of each ring from a table: uninterrupted stretches with theta unwrapped, rates and accelerations.

A stretch ends if the ball changes its ring or is not seen, or if the record is interrupted. Rates and accelerations of
the table are used unchanged. If they are missing, they come from a smoothing, which is acausal: for training and scores
only. The tilt is taken `delay` earlier than the ball, because the camera is late.

A model may use one of two rates of theta, even for a smoothed target:

    smoothed    acausal, of the same moment: the rate of a state
    delayed     (theta_{k-2} - theta_{k-3}) / dt: causal, before the samples that the target averages. At an impact on
                an edge, the smoothed rate is nearly zero for either direction; this rate separates them. The tilt is
                averaged with the same weights as the acceleration of the target
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from mazeplan.core.errors import TableError
from mazeplan.core.logs.table import Table, stretches
from mazeplan.core.records import Array, IntArray
from mazeplan.learning.features import paper_features
from mazeplan.learning.smoothing import Smoothing, acceleration_kernel, derivatives, unwrapped
from mazeplan.maze.geometry import Maze
from mazeplan.physics.ball_model import RingKinematics

SLACK = 2e-3  # m; the camera's noise may move the ball this far into a wall
SHORTEST = 8  # samples; a shorter stretch has no derivatives
LAG = 2  # delay of the delayed rate, samples
PAST = np.arange(-9, -2)  # lags of the earlier samples whose mean tilt moved the ball across the ring


@dataclass(frozen=True)
class RingSamples:
    """Samples of one ring in order of time, arrays of shape (N,).

    dt:          time from sample to sample, s
    k:           state, with rates and accelerations of the tilt
    theta_ddot:  target of the models, rad/s^2
    measured:    theta as measured, unwrapped in its stretch, rad
    segment:     number of the stretch
    row:         row in the record
    good:        whether no value is missing; other rows stay in place, so that neighbours remain neighbours"""

    ring: int
    dt: float
    k: RingKinematics
    theta_ddot: Array
    measured: Array
    segment: IntArray
    row: IntArray
    good: np.ndarray

    def __len__(self) -> int:
        return len(self.theta_ddot)

    def at(self, rows: Array | IntArray | np.ndarray) -> RingKinematics:
        """The state in some rows (mask or indices)."""
        return pick(self.k, rows)


@dataclass(frozen=True)
class MatchedKinematics(RingKinematics):
    """States with the earlier tilt, a mean over PAST, rad. With delayed rates, the tilt itself is averaged, too."""

    beta_past: Array
    gamma_past: Array


def columns_of(k: RingKinematics) -> tuple[str, ...]:
    """Names of the arrays in a state."""
    return tuple(f.name for f in fields(k) if f.name != "radius")


def pick(k: RingKinematics, rows: Array | IntArray | np.ndarray) -> RingKinematics:
    """Some rows of a state (mask or indices)."""
    return replace(k, **{name: getattr(k, name)[rows] for name in columns_of(k)})


@dataclass(frozen=True)
class SampleOptions:
    """Information in addition to the table.

    delay:      delay of the ball behind the tilt, s
    ring:       the only ring to use; in a table without rings, the ring of all rows
    radius:     in place of the map's radius, m
    recompute:  whether to ignore derivatives of the table
    rates:      smoothed or delayed, see above"""

    delay: float = 0.0
    ring: int | None = None
    radius: float | None = None
    recompute: bool = False
    rates: str = "smoothed"


def ring_samples(
    table: Table, maze: Maze | None, smoothing: Smoothing | None = None, options: SampleOptions | None = None
) -> dict[int, RingSamples]:
    """Samples by ring, for rings with samples. Raises TableError if there are none, or if the rings are unknown."""
    smoothing, options = smoothing or Smoothing(), options or SampleOptions()
    numbers = rings_wanted(table, maze, options)
    signals = _signals(table, smoothing, options)
    found, here = {}, np.isfinite(table["theta"]) & (numbers > 0)
    starts = np.zeros(len(table), dtype=bool)  # of uninterrupted stretches
    starts[[part.start for part in stretches(table)]] = True
    starts[1:] |= (numbers[1:] != numbers[:-1]) | (here[1:] != here[:-1])
    run = np.cumsum(starts)
    for number in np.unique(numbers[here]).tolist():
        rows = np.flatnonzero(here & (numbers == number))
        values, counts = np.unique(run[rows], return_counts=True)
        rows = rows[np.isin(run[rows], values[counts >= SHORTEST])]
        if len(rows):
            r = options.radius if options.radius is not None else _radius(table, maze, number, rows)
            found[int(number)] = _collect(table, signals, rows, run[rows], int(number), r, smoothing, options)
    if not found:
        raise TableError(f"no ring has {SHORTEST} samples in a row", file=table.place)
    return found


def _radius(table: Table, maze: Maze | None, ring: int, rows: IntArray) -> float:
    if maze is not None and 1 <= ring <= len(maze.rings):
        if maze.ring(ring).is_disc:
            raise TableError(f"ring {ring} is a disc: its track has no radius", file=table.place)
        return maze.ring(ring).track_radius
    if "r" in table:
        return float(np.nanmedian(table["r"][rows]))
    raise TableError(f"ring {ring} is not in the map: its radius is needed", file=table.place)


def rings_wanted(table: Table, maze: Maze | None, options: SampleOptions) -> IntArray:
    """Ring of each row (N,); 0 for none, and for any ring other than that of the options.

    If neither a column nor r and the map tell it, it is that of the options. A given radius is of another map."""
    if options.ring is None:
        return rings_of(table, maze)
    if "ring" not in table and (maze is None or "r" not in table or options.radius is not None):
        return np.full(len(table), options.ring)
    numbers = rings_of(table, maze) if options.radius is None else table["ring"]  # the map may lack this ring
    return np.where(numbers == options.ring, options.ring, 0)


def rings_of(table: Table, maze: Maze | None) -> IntArray:
    """Ring of each row (N,), 0 for none: by column, or by radius and map.

    With radius and map, the ball must be in the channel, because it moves differently when it is half in an opening. A
    disc has no channel. Raises TableError for a ring that the map does not have, or if those columns are missing."""
    highest = int(table["ring"].max(initial=0)) if "ring" in table and maze is not None else 0
    if maze is not None and highest > len(maze.rings):
        problem = f"ring: got {highest}, expected 1 to {len(maze.rings)}: the rings of the map {maze.name}"
        raise TableError(problem, file=table.place)
    if "r" not in table or maze is None:
        if "ring" in table:
            discs = [] if maze is None else [place.number for place in maze.rings if place.is_disc]
            return np.where(np.isin(table["ring"], discs), 0, table["ring"]).astype(np.int64)
        raise TableError("the ring of a row is unknown: expected a column ring, or r (or x, y)", file=table.place)
    numbers, reach = np.zeros(len(table), dtype=np.int64), maze.ball.radius - SLACK
    for place in maze.rings:
        if not place.is_disc:
            inside = (table["r"] > place.inner_radius + reach) & (table["r"] < place.outer_radius - reach)
            numbers[inside] = place.number
    if "ring" in table:
        numbers[numbers != table["ring"]] = 0
    return numbers


def _signals(table: Table, smoothing: Smoothing, options: SampleOptions) -> dict[str, Array]:
    """Tilts with rates and accelerations, at the time of the ball, by name."""
    segment, out = table.segment, {}
    for axis in ("beta", "gamma"):
        names = (axis, f"{axis}_dot", f"{axis}_ddot")
        if not options.recompute and all(name in table for name in names):
            columns = [table[name] for name in names]
        else:
            smooth = derivatives(table[axis], table.dt, smoothing, segment=segment)
            columns = [table[axis], smooth.rate, smooth.acceleration]
        if options.delay:
            columns = [_late(column, table["t"], segment, options.delay) for column in columns]
        out[f"{axis}_past"] = _averaged(columns[0], segment, PAST, np.full(len(PAST), 1.0 / len(PAST)))
        if options.rates == "delayed":
            weights = acceleration_kernel(smoothing.window, smoothing.order)
            around = np.arange(len(weights)) - len(weights) // 2
            columns = [_averaged(column, segment, around, weights) for column in columns]
        out.update(zip(names, columns, strict=True))
    return out


def _averaged(values: Array, segment: Array, lags: IntArray, weights: Array) -> Array:
    """Weighted mean (N,) over the rows of the same segment at these lags (negative: earlier)."""
    total, sum_of_weights, n = np.zeros(len(values)), np.zeros(len(values)), len(values)
    for lag, weight in zip(lags.tolist(), weights.tolist(), strict=True):
        at = np.clip(np.arange(n) + lag, 0, n - 1)
        there = (segment[at] == segment) & (at == np.arange(n) + lag) & np.isfinite(values[at])
        total += np.where(there, weight * values[at], 0.0)
        sum_of_weights += np.where(there, weight, 0.0)
    return np.where(sum_of_weights > 1e-9, total / np.maximum(sum_of_weights, 1e-9), values)


def _late(values: Array, t: Array, segment: Array, delay: float) -> Array:
    """The signal `delay` earlier; NaN outside its segment."""
    out = np.full(len(values), np.nan)
    for number in np.unique(segment):
        rows = np.flatnonzero(segment == number)
        out[rows] = np.interp(t[rows] - delay, t[rows], values[rows], left=np.nan, right=np.nan)
    return out


def _collect(
    table: Table, signals: dict[str, Array], rows: IntArray, run: IntArray, ring: int, radius: float,
    smoothing: Smoothing, options: SampleOptions,
) -> RingSamples:  # fmt: skip
    """The samples of one ring; rows: rows of the table; run: stretch of each row."""
    dt, measured = table.dt, unwrapped(table["theta"][rows], run)
    if not options.recompute and "theta_dot" in table and "theta_ddot" in table:
        theta, rate, target = measured, table["theta_dot"][rows], table["theta_ddot"][rows]
    else:
        smooth = derivatives(measured, dt, smoothing, segment=run)
        theta, rate, target = smooth.value, smooth.rate, smooth.acceleration
    if options.rates == "delayed":
        rate = delayed(measured, run, dt)
    state = {name: values[rows] for name, values in signals.items()}
    k = MatchedKinematics(radius=radius, theta=theta, theta_dot=rate, **state)
    good = np.isfinite(target)
    for name in columns_of(k):
        good &= np.isfinite(getattr(k, name))
    _, segment = np.unique(run, return_inverse=True)
    return RingSamples(ring, dt, k, target, measured, segment.astype(np.int64), rows, good)


def delayed(angle: Array, run: Array | IntArray, dt: float) -> Array:
    """Rate (N,) LAG samples ago, by the backward difference; NaN at the beginning of a stretch."""
    out = np.full(len(angle), np.nan)
    out[LAG + 1 :] = (angle[1 : len(angle) - LAG] - angle[: len(angle) - LAG - 1]) / dt
    same = np.zeros(len(angle), dtype=bool)
    same[LAG + 1 :] = run[LAG + 1 :] == run[: len(angle) - LAG - 1]
    return np.where(same, out, np.nan)


def orientation(found: dict[int, RingSamples]) -> tuple[int, int]:
    """Sign of beta and gamma relative to the ball's equation, each 1 or -1.

    Gravity pulls the ball downhill. If the weight of an axis' gravity term is negative by more than 8 standard errors
    (of independent rows), the tilt of this axis has the opposite sign."""
    X, y = [], []
    for samples in found.values():
        k = samples.at(samples.good)
        X.append(paper_features(k)[:, 4:] * k.radius)  # m/s^2, similar in all rings
        y.append(samples.theta_ddot[samples.good] * k.radius)
    A, b = np.concatenate(X), np.concatenate(y)
    if not len(b):
        return 1, 1
    inverse = np.linalg.pinv(A.T @ A)
    w = inverse @ A.T @ b
    sigma = np.sqrt(np.diag(inverse) * np.mean((b - A @ w) ** 2))
    signs = np.where(w < -8.0 * sigma, -1, 1)
    return int(signs[0]), int(signs[1])


def oriented(samples: RingSamples, signs: tuple[int, int]) -> RingSamples:
    """The samples with beta and gamma multiplied by these signs, as in the ball's equation."""
    changed = {
        name: sign * getattr(samples.k, name)
        for axis, sign in zip(("beta", "gamma"), signs, strict=True)
        for name in columns_of(samples.k)
        if name.startswith(axis)
    }
    return replace(samples, k=replace(samples.k, **changed))


def joined(parts: Sequence[RingSamples]) -> RingSamples:
    """Samples of one ring from several records, one after the other; stretches stay separate."""
    if len(parts) == 1:
        return parts[0]
    first, segments, rows = parts[0], [parts[0].segment], [parts[0].row]
    for part in parts[1:]:
        segments.append(part.segment + int(segments[-1].max()) + 1)
        rows.append(part.row + int(rows[-1].max()) + 1)
    state = {name: np.concatenate([getattr(part.k, name) for part in parts]) for name in columns_of(first.k)}
    same = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in ("theta_ddot", "measured", "good")
    }
    k = replace(first.k, **state)
    return replace(first, k=k, segment=np.concatenate(segments), row=np.concatenate(rows), **same)


def joined_samples(
    tables: Iterable[Table], maze: Maze, smoothing: Smoothing, options: SampleOptions
) -> dict[int, RingSamples]:
    """Samples of all tables by ring, one table after the other; see `ring_samples`."""
    found: dict[int, list[RingSamples]] = {}
    for table in tables:
        for ring, part in ring_samples(table, maze, smoothing, options).items():
            found.setdefault(ring, []).append(part)
    return {ring: joined(parts) for ring, parts in found.items()}
