"""Finds the rings from positions of the ball: bands of radius between walls, with the camera's noise and offset.

The ball's centre stays at least the ball's radius R_b away from walls. So in ring k the radius r of the centre lies in
the band [inner + R_b, outer - R_b]. The ball mostly touches one of the two walls. The model of the measured radius in
and around a band, with its edges `inner` and `outer`, is therefore

    p(r) = w_1 N(r; inner, s) + w_2 N(r; outer, s) + w_3 (U[inner, outer] * N(0, s))(r) + w_4 U[window](r)

(at either wall, between them, passing through an opening), with one camera noise s for all bands. Expectation
maximisation fits edges, s and the centre of the circles. Quantiles of r would depend on the noise and on how often the
ball touches which wall.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.special import ndtr

from mazeplan.core.errors import TableError
from mazeplan.core.records import Array

CELL = math.radians(2.0)  # width in angle of the cells that count how much of a circle was visited
BIN = 1e-3  # m, width of these cells in radius; less than the play of a ball in a tight channel
MARGIN = 3e-3  # m; the fit of a band also uses samples this far to either side: six times the noise of a webcam
OFFSET_REACH = 8e-3  # m that a camera may be off centre; a person sees a larger offset at a glance
FARTHEST = 2.0  # m; twice the radius of the largest maze that a map may describe
LEAST_SAMPLES = 200  # 7 s at 30 Hz; fewer show no band
MOST_SAMPLES = 200_000  # more are thinned out: this many already give the edges to micrometres
FIRST_NOISE = 5e-4  # m, that of a webcam; start value of the fit
LEAST_NOISE = 2e-5  # m; with less, likelihoods of a noiseless log overflow
MODEL_ERROR = 5e-5  # m, of an edge: near walls the ball is not evenly spread; seen in simulated logs of known maps
STEPS, SETTLED = 300, 1e-7  # maximum steps of the fit; it ends when edges change by less than this, m


@dataclass(frozen=True)
class Edges:
    """One band: radii of its edges, m, and in how many samples the ball was at each (sums of probabilities)."""

    low: float
    high: float
    low_touches: float
    high_touches: float


@dataclass(frozen=True)
class Bands:
    """All bands, and what the camera adds.

    edges: from the outermost band inwards; low: the edge towards the centre, 0 in the disc
    centre: centre of the circles in the camera's frame (x, y), m
    noise: of the camera, 1 sigma per axis, m
    """

    edges: tuple[Edges, ...]
    centre: tuple[float, float]
    noise: float


def fit_bands(x: Array, y: Array, ball_radius: float) -> Bands:
    """Bands and the circles' centre from positions of the ball: x and y (N,), m, without NaN.

    Raises TableError if the data show fewer than two rings, or no disc.
    """
    if len(x) < LEAST_SAMPLES:
        raise TableError(f"the ball was seen in {len(x)} samples, expected at least {LEAST_SAMPLES}")
    if (farthest := float(np.max(np.hypot(x, y)))) > FARTHEST:
        raise TableError(f"the ball was seen {farthest:g} m from the centre, expected at most {FARTHEST:g} m")
    thin = slice(None, None, -(-len(x) // MOST_SAMPLES))
    x, y = x[thin], y[thin]
    centre = _rough_centre(x, y)
    rough = _rough_bands(x - centre[0], y - centre[1], ball_radius)
    if len(rough) < 2:
        seen = f"{len(rough)} ring{'s' * (len(rough) != 1)}"
        raise TableError(f"the ball was seen in {seen}, expected at least 2: record with `mazeplan collect --rings`")
    if rough[-1][0] > 0.0:
        raise TableError(
            f"the innermost ring in which the ball was for long has a radius of {500.0 * sum(rough[-1]):.0f} mm, "
            "expected a disc: the ball must also go to the centre"
        )
    return _fit(x, y, np.array(rough), centre)


def _responsibilities(r: Array, low, high, weights, noise: float, width) -> Array:
    """Probability that each sample was at the low wall, at the high wall, between them, or passing an opening: (4, N).

    The other arguments broadcast to (N,)."""
    peak = 1.0 / (noise * math.sqrt(2.0 * math.pi))
    densities = np.stack(
        [
            peak * np.exp(-0.5 * ((r - low) / noise) ** 2),
            peak * np.exp(-0.5 * ((r - high) / noise) ** 2),
            (ndtr((r - low) / noise) - ndtr((r - high) / noise)) / np.maximum(high - low, 0.1 * noise),
            np.broadcast_to(1.0 / np.asarray(width), r.shape),
        ]
    )
    parts = densities * weights
    return parts / np.maximum(parts.sum(axis=0), 1e-300)


# Finding bands. At a radius inside a ring the ball comes by at all angles; inside a wall only at those of openings.


def _rough_centre(x: Array, y: Array) -> tuple[float, float]:
    """The centre, on a 1 mm grid, for which the histogram of the radii has the lowest entropy."""
    steps = np.arange(-OFFSET_REACH, OFFSET_REACH + BIN / 2, BIN)
    thin = slice(None, None, -(-len(x) // 10_000))  # enough for a histogram
    x, y = x[thin], y[thin]
    best, least = (0.0, 0.0), math.inf
    for cx in steps:
        for cy in steps:
            counts = np.bincount((np.hypot(x - cx, y - cy) / BIN).astype(int))
            share = counts[counts > 0] / len(x)
            entropy = -float(np.sum(share * np.log(share))) + 0.02 * math.hypot(cx, cy) / BIN  # in doubt: small offset
            if entropy < least:
                best, least = (float(cx), float(cy)), entropy
    return best


def _rough_bands(x: Array, y: Array, ball_radius: float) -> list[tuple[float, float]]:
    """(inner, outer) in m of each band, from the outermost inwards. A radius is in a band if the ball visited much of
    its circle."""
    r = np.hypot(x, y)
    cells = np.unique(np.stack([r // BIN, np.arctan2(y, x) // CELL]), axis=1)
    visited = np.bincount(cells[0].astype(int)).astype(float)
    reach = 2 * round(1.25 * 2.0 * ball_radius / BIN) + 1  # wide enough for a channel and a wall beside it
    most, least = maximum_filter1d(visited, reach), np.maximum(minimum_filter1d(visited, reach), 1.0)
    inside = (visited >= np.sqrt(most * least)) & (visited >= max(5.0, 0.1 * visited.max()))
    ends = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(int), [0]])))
    apart = 2.0 * ball_radius  # minimum distance of bands: on either side the ball's centre is R_b away from the wall
    merged: list[tuple[float, float]] = []
    for start, end in zip(ends[::2] * BIN, ends[1::2] * BIN, strict=True):
        if merged and start - merged[-1][1] < apart - BIN:
            merged[-1] = (merged[-1][0], float(end))
        else:
            merged.append((float(start), float(end)))
    if not merged:
        return []
    return [_dense(r, run) for run in _with_disc(merged, r, np.arctan2(y, x), apart + BIN)[::-1]]


def _with_disc(runs: list[tuple[float, float]], r: Array, theta: Array, room: float) -> list[tuple[float, float]]:
    """The runs from the innermost outwards. If the innermost is the disc, it becomes one run that begins at 0.

    In a disc the ball rolls along the wall and seldom crosses the middle. So the disc may show as two runs, like a ring
    with a disc inside. But the ball crosses a disc at all angles, and a wall only at one or two openings.

    runs: (low, high) of the radii, m
    room: width that another ring inside would need, m
    """
    first = runs[0][0]
    if first < room:
        runs = [(0.0, runs[0][1]), *runs[1:]]
        inside, outside = runs[0][1], runs[1][0] if len(runs) > 1 else math.inf
    else:
        inside, outside = 0.0, first
    between = theta[(r > inside) & (r < outside)]
    if outside < 2.0 * room and len(between) >= 12:
        sectors = np.sort(np.bincount(((between + math.pi) // (math.pi / 6.0)).astype(int), minlength=12))
        if sectors[-4:].sum() < 0.75 * len(between):  # the fullest third of the circle holds less than three quarters
            return [(0.0, runs[1][1]), *runs[2:]] if first < room else [(0.0, runs[0][1]), *runs[1:]]
    return runs


def _dense(r: Array, run: tuple[float, float]) -> tuple[float, float]:
    """The part of a run of radii where the ball mostly was. It leaves out the tails from noise and passages, from which
    a fit would start on the wrong side of the walls."""
    r = r[(r >= run[0]) & (r < run[1])]
    count = np.bincount((r / BIN).astype(int))
    low, high = np.quantile(r[count[(r / BIN).astype(int)] >= 0.1 * count.max()], [0.1, 0.9])
    return (0.0 if run[0] == 0.0 else float(low)), float(high)


def _fit(x: Array, y: Array, edges: Array, centre: tuple[float, float]) -> Bands:
    """Refine edges (K, 2) in m, centre and noise together."""
    disc = edges[:, 0] == 0.0
    window = np.stack([np.where(disc, 0.0, edges[:, 0] - MARGIN), edges[:, 1] + MARGIN], axis=1)
    start, (low, high), noise = edges, edges.T.copy(), FIRST_NOISE
    weights = np.full((len(edges), 4), 0.25)
    weights[disc, 0] = 0.0
    touches = np.zeros((len(edges), 4))
    for _ in range(STEPS):
        dx, dy = x - centre[0], y - centre[1]
        r = np.hypot(dx, dy)
        ring = np.argmax((r[:, None] > window[:, 0]) & (r[:, None] < window[:, 1]), axis=1)
        use = (r > window[ring, 0]) & (r < window[ring, 1])
        r, k, cos, sin = r[use], ring[use], dx[use] / r[use], dy[use] / r[use]
        share = _responsibilities(r, low[k], high[k], weights[k].T, noise, (window[:, 1] - window[:, 0])[k])
        touches = np.stack([np.bincount(k, part, len(edges)) for part in share], axis=1)
        weights = (touches + 1e-6) / (touches + 1e-6).sum(axis=1, keepdims=True)
        weights[disc, 0] = 0.0
        before = np.concatenate([low, high, centre])
        low = np.where(touches[:, 0] > 1e-3, np.bincount(k, share[0] * r, len(edges)) / touches[:, 0].clip(1e-9), low)
        high = np.where(touches[:, 1] > 1e-3, np.bincount(k, share[1] * r, len(edges)) / touches[:, 1].clip(1e-9), high)
        low = np.where(disc, 0.0, np.clip(low, start[:, 0] - MARGIN, start[:, 0] + MARGIN))
        high = np.maximum(np.clip(high, start[:, 1] - MARGIN, start[:, 1] + MARGIN), low)
        leaning = np.concatenate([share[0], share[1]])
        off = np.concatenate([r - low[k], r - high[k]])
        noise = max(math.sqrt(np.dot(leaning, off**2) / max(leaning.sum(), 1.0)), LEAST_NOISE)
        centre = _shifted(centre, np.tile(cos, 2), np.tile(sin, 2), off, leaning)
        if np.max(np.abs(np.concatenate([low, high, centre]) - before)) < SETTLED:
            break
    found = zip(low.tolist(), high.tolist(), touches[:, 0].tolist(), touches[:, 1].tolist(), strict=True)
    return Bands(tuple(Edges(*edge) for edge in found), centre, noise)


def _shifted(centre: tuple[float, float], cos: Array, sin: Array, off: Array, weight: Array) -> tuple[float, float]:
    """The centre that explains best how far samples at a wall are off its edge: off = r - edge = dx cos + dy sin."""
    a, b, c = np.dot(weight, cos * cos), np.dot(weight, cos * sin), np.dot(weight, sin * sin)
    if a * c - b * b < 1e-3 * (a + c) ** 2:  # samples on one side do not separate centre and radius
        return centre
    p, q = np.dot(weight, cos * off), np.dot(weight, sin * off)
    det = a * c - b * b
    x = centre[0] + (c * p - b * q) / det
    y = centre[1] + (a * q - b * p) / det
    limit = OFFSET_REACH + MARGIN
    return float(np.clip(x, -limit, limit)), float(np.clip(y, -limit, limit))
