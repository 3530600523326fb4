"""The numbers of a rigid ball: by name, from and to a rig's model, and fitted to a record.

The names are those of `learning.rigid_body_entries`; numbers of further effects are named EFFECT.PARAMETER.

A fit is the maximum likelihood by the innovations of a whole record, all rings at once.

The filter (`rigid_body_filter`) gives innovations nu_k with covariances S_k under parameters p; -2 log L is the sum of
nu' S^-1 nu + log det S. Fisher scoring, damped as by Levenberg and Marquardt (an index: the derivative by a parameter):

    F_ij = sum_k nu_i' S^-1 nu_j + tr(S^-1 S_i S^-1 S_j) / 2,     (F + damping diag F) dp = -sum_k g_k
    cov  = F^-1 (sum over blocks of s s') F^-1,                   s = sum of g_k over a block of BLOCK_S

with g_k half of the gradient of picture k. The same steps find noise and physics. Standard errors hold for residuals
that are not quite white (the sandwich; White, Econometrica 50, 1982).

-2 log L is a little rough: it jumps by about 20 between near points (`rigid_body_filter`, on edges). Derivatives are
central differences over several standard errors (WIDTH), which smooths the jumps. A gain below 20 means nothing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from mazeplan.control.estimation.rigid_body_filter import BodyFilter, BodyModel, Filtered
from mazeplan.core.records import Array
from mazeplan.core.side_by_side import side_by_side
from mazeplan.learning.modelfile import RigModel
from mazeplan.learning.rig_model import part_stderr, part_values
from mazeplan.learning.rigid_body_entries import (
    ABSENT,
    KEPT,
    PARAMETERS,
    RADIUS_M,
    Body,
    Number,
    determined,
    stamp,
    to_body_unit,
)
from mazeplan.maze.geometry import Maze
from mazeplan.physics.effect import BALL
from mazeplan.physics.registry import PACKAGED

STEPS, ENOUGH = 20, 1.0  # maximum number of scoring steps; minimum gain of -2 log L for a further step
WIDTH = 4.0  # of the differences by parameters of physics, in their steps
MOST, MOST_LOG = 3.0, 0.7  # most that a scoring step moves: in widths of the differences, or of a logarithm
DIVERGED = 1e6  # factor of the covariance from which a picture says nothing about a derivative
DAMPING = (1e-4, 1e6)
BLOCK_S = 10.0  # s; blocks of this length are independent of one another
FLOOR = 1e-12  # minimum diagonal element of the information, so that a parameter without influence does no harm
LEFT_OVER = ("cross_beta", "cross_gamma")  # of the coupling, only what the fitted stage does not have already
FRICTION = ("rolling", "viscous", "quadratic")  # a bead has f times these values; f: rolling_inertia.factor
DEFAULT_FREE = (
    "rolling", "spin", "wall", "restitution", "hold", "tilt_beta", "tilt_gamma", "offset_x", "offset_y", "delay",
    "noise", "plane", "strike",
)  # fmt: skip


def number_of(model: BodyModel, name: str) -> Number:
    """Unit, bounds and description of a number. Raises KeyError for an unknown name."""
    if name in PARAMETERS:
        return PARAMETERS[name]
    i, key = _term(model, name)
    p = model.terms[i].effect.parameters[key]
    return Number("terms", name, p.unit, p.low, p.high, p.smallest or p.step, p.words or name, effect=name)


def _term(model: BodyModel, name: str) -> tuple[int, str]:
    """Index of the term, and name of its parameter, for a name EFFECT.PARAMETER. Raises KeyError."""
    effect, _, key = name.partition(".")
    for i, term in enumerate(model.terms):
        if term.name == effect and key in term.effect.parameters:
            return i, key
    raise KeyError(name)


def value_of(model: BodyModel, name: str) -> float:
    """A number of a model by its name, in its unit."""
    if name not in PARAMETERS:
        i, key = _term(model, name)
        return model.terms[i].values()[key]
    where = PARAMETERS[name]
    return float(getattr(getattr(model, where.part), where.field))


def with_values(model: BodyModel, values: Mapping[str, float]) -> BodyModel:
    """The model with other values of some numbers, in their units."""
    for name, value in values.items():
        if name in PARAMETERS:
            where = PARAMETERS[name]
            part = getattr(model, where.part)._replace(**{where.field: value})
            model = model._replace(**{where.part: part})
            continue
        i, key = _term(model, name)
        term, terms = model.terms[i], list(model.terms)
        terms[i] = replace(term, numbers=tuple((term.values() | {key: value}).values()))
        model = model._replace(terms=tuple(terms))
    return model


def bead_values(rig: RigModel, maze: Maze, name: str) -> tuple[float, ...]:
    """Values of a number in a model of beads, in the unit of the rigid ball.

    There is one value for each ring with the effect, one for a number of the whole rig, none if the model does not
    have the number."""
    where = PARAMETERS[name]
    effect, _, key = where.effect.partition(".")
    if not effect or name in LEFT_OVER:
        return ()
    power = where.origin[1]
    if PACKAGED[effect].acts not in BALL:
        return (to_body_unit(part_values(rig, PACKAGED[effect])[key], where.how, power, RADIUS_M),)
    found = []
    for ring in sorted(rig.balls):
        ball, radius = rig.balls[ring], maze.track_radius(ring)
        value = ball.parameter(effect, key, math.nan)
        if not math.isfinite(value) or radius <= 0.0:
            continue
        share = ball.parameter("rolling_inertia", "factor", 1.0) if name in FRICTION else 1.0
        found.append(to_body_unit(value, where.how, power, radius) / share)
    return tuple(found[:1] if PACKAGED[effect].common else found)


def bead_stderr(rig: RigModel, maze: Maze) -> dict[str, float]:
    """Standard errors of the numbers in a model of beads, by name: the largest over the rings."""
    out = {}
    for name, number in PARAMETERS.items():
        effect, _, key = number.effect.partition(".")
        if not effect or name in LEFT_OVER:
            continue
        if PACKAGED[effect].acts not in BALL:
            errors = [part_stderr(rig, PACKAGED[effect]).get(key, math.nan)]
        else:
            known = ((b.stderr.get(effect, {}).get(key, math.nan), maze.track_radius(r)) for r, b in rig.balls.items())
            errors = [error / (radius or RADIUS_M) ** number.origin[1] for error, radius in known]
        if errors := [error for error in errors if math.isfinite(error)]:
            out[name] = max(errors)
    return out


def body_of(rig: RigModel) -> BodyModel | None:
    """The rigid ball of a rig's model; None if there is none, or if it was identified with other effects."""
    if rig.body is None or rig.body.of != stamp(rig.balls):
        return None
    values = {**ABSENT, **rig.body.values}
    values["delay"] = max(rig.camera_delay + values["delay"], -rig.stage.dead_time)
    return with_values(BodyModel(), values)._replace(terms=rig.body.terms)


def with_body(rig: RigModel, model: BodyModel, stderr: Mapping[str, float]) -> RigModel:
    """The rig's model with this rigid ball. It keeps only the terms that a run can use for prediction."""
    terms = tuple(term for term in model.terms if term.effect.planned and not term.idle)
    values = {name: value_of(model, name) for name in KEPT}
    values["delay"] -= rig.camera_delay
    for name, value in values.items():  # a search of logarithms may end beside a bound, by rounding
        number = PARAMETERS[name]
        values[name] = min(max(value, -number.high if name == "delay" else number.low), number.high)
    known = {name: value for name, value in values.items() if determined(name, value, stderr.get(name))}
    return replace(rig, body=Body(known, stamp(rig.balls), {k: s for k, s in stderr.items() if k in known}, terms))


@dataclass(frozen=True)
class BodyFit:
    """The result of a fit."""

    model: BodyModel  # the model with the likeliest values
    stderr: dict[str, float]  # standard errors of the free parameters, by name, in their units
    free: tuple[str, ...]  # names of the free parameters
    cov: Array  # (J, J): their covariance, in the coordinates of the search
    minus2: float  # -2 log L
    filtered: Filtered  # result of the filter with this model

    def value(self, name: str) -> float:
        """A parameter by its name, in its unit."""
        return value_of(self.model, name)


def autocorrelation(filtered: Filtered, lags: int = 3) -> Array:
    """Autocorrelation of the whitened innovations at lags of 1 to `lags` pictures, (lags,)."""
    e = np.full(filtered.nu.shape, np.nan)
    e[np.isfinite(filtered.nu[:, 0])] = filtered.whitened()
    power = float(np.nanmean(e * e))
    return np.array([float(np.nanmean(e[lag:] * e[:-lag])) / power for lag in range(1, lags + 1)])


class Gradient(NamedTuple):
    """Half of the gradient of -2 log L."""

    each: Array  # (N, J): its part from each picture
    information: Array  # (J, J): Fisher information


class _Search:
    """The filter in the coordinates x (J,) of the search: values, or their logarithms."""

    def __init__(self, body: BodyFilter, model: BodyModel, free: Sequence[str]) -> None:
        self.body, self.model, self.free = body, model, tuple(free)
        self.kinds = [number_of(model, name) for name in free]
        self.low = np.array([math.log(k.low) if k.log else k.low for k in self.kinds])
        self.high = np.array([math.log(k.high) if k.log else k.high for k in self.kinds])
        late = np.array([name == "delay" for name in self.free])
        self.low = np.where(late, np.maximum(self.low, body.soonest), self.low)
        logs = np.array([k.log for k in self.kinds])
        self.step = np.array([k.step for k in self.kinds]) * np.where(logs, 1.0, WIDTH)
        self.reach = np.where(logs, MOST_LOG, MOST * self.step)

    def point(self) -> Array:
        values = (value_of(self.model, name) for name in self.free)
        x = [math.log(v) if k.log else v for v, k in zip(values, self.kinds, strict=True)]
        return np.clip(np.array(x), self.low, self.high)

    def model_at(self, x: Array) -> BodyModel:
        values = (math.exp(v) if k.log else float(v) for v, k in zip(x, self.kinds, strict=True))
        return with_values(self.model, dict(zip(self.free, values, strict=True)))

    def run(self, x: Array) -> Filtered:
        return self.body.innovations(self.model_at(x))

    def scores(self, x: Array, here: Filtered) -> Gradient:
        """Gradient and information at x; here: the innovations at x."""
        keep, moved = np.isfinite(here.nu[:, 0]), []
        steps = np.diag(self.step)
        up, down = (np.clip(x + sign * steps, self.low, self.high) for sign in (1.0, -1.0))
        points = [np.where(steps > 0.0, moved_to, x)[j] for j in range(len(x)) for moved_to in (up, down)]
        every = side_by_side(self.run, points)
        for j in range(len(x)):
            ends, way = every[2 * j : 2 * j + 2], up[j, j] - down[j, j]
            both = np.logical_and(*(np.isfinite(end.nu[:, :1]) & (end.S < DIVERGED * here.S)[:, :1] for end in ends))
            slopes = ((ends[0].nu - ends[1].nu) / way, (ends[0].S - ends[1].S) / way)
            moved.append([np.where(both, slope, 0.0)[keep] for slope in slopes])
        (a, b), (xx, yy, xy) = here.nu[keep].T, here.S[keep].T
        det = xx * yy - xy * xy
        u, v = (yy * a - xy * b) / det, (xx * b - xy * a) / det  # S^-1 nu
        inverse = np.stack([yy, xx, -xy]) / det
        count = len(self.free)
        each, information = np.zeros((len(keep), count)), np.zeros((count, count))
        white = [_over(inverse, dS) for _, dS in moved]
        for i, (dn, dS) in enumerate(moved):
            quadratic = dS[:, 0] * u * u + dS[:, 1] * v * v + 2.0 * dS[:, 2] * u * v
            each[keep, i] = dn[:, 0] * u + dn[:, 1] * v + 0.5 * (white[i][0] + white[i][3] - quadratic)
            for j in range(i + 1):
                other, (c, d, e, f), (p, q, r, s) = moved[j][0], white[i], white[j]
                means = dn[:, 0] * (inverse[0] * other[:, 0] + inverse[2] * other[:, 1])
                means += dn[:, 1] * (inverse[2] * other[:, 0] + inverse[1] * other[:, 1])
                spreads = 0.5 * (c * p + d * r + e * q + f * s)
                information[i, j] = information[j, i] = np.sum(means + spreads)
        return Gradient(each, information)


def _over(inverse: Array, dS: Array) -> tuple[Array, Array, Array, Array]:
    """S^-1 dS as (11, 12, 21, 22), each (K,); inverse (3, K): xx, yy, xy of S^-1; dS (K, 3)."""
    (ixx, iyy, ixy), (xx, yy, xy) = inverse, dS.T
    return ixx * xx + ixy * xy, ixx * xy + ixy * yy, ixy * xx + iyy * xy, ixy * xy + iyy * yy


def score_search(body: BodyFilter, model: BodyModel, free: Sequence[str]) -> Gradient:
    """Gradient with respect to some parameters, in the coordinates of a search. Raises KeyError for an unknown name."""
    search = _Search(body, model, free)
    x = search.point()
    return search.scores(x, search.run(x))


def fit_body(
    body: BodyFilter, model: BodyModel, free: Sequence[str] = DEFAULT_FREE, steps: int = STEPS, enough: float = ENOUGH
) -> BodyFit:
    """The likeliest values of the `free` parameters. Raises KeyError for an unknown name.

    model:   start of the fit
    steps:   maximum number of scoring steps
    enough:  minimum gain of -2 log L for a further step"""
    search = _Search(body, model, free)
    x, damping = search.point(), 1e-2
    best = search.run(x)
    scores = search.scores(x, best)
    for _ in range(steps):
        gained = 0.0
        while damping <= DAMPING[1]:
            new = _stepped(search, x, scores, damping)
            there = search.run(new)
            if there.minus2 < best.minus2:
                gained, x, best = best.minus2 - there.minus2, new, there
                damping = max(damping / 10.0, DAMPING[0])
                break
            damping *= 10.0
        damping = min(damping, 1.0)
        if gained < enough:
            break
        scores = search.scores(x, best)
    plain = _inverse(scores.information)
    blocks = np.arange(0, len(scores.each), round(BLOCK_S / body.pictures.dt))
    sums = np.add.reduceat(scores.each, blocks, axis=0)  # s of each block
    cov = plain @ (sums.T @ sums) @ plain
    found = search.model_at(x)
    sigma = np.sqrt(np.diag(cov))
    scale = [value_of(found, name) if kind.log else 1.0 for name, kind in zip(free, search.kinds, strict=True)]
    stderr = {name: float(s * k) for name, s, k in zip(free, sigma, scale, strict=True)}
    return BodyFit(found, stderr, tuple(free), cov, best.minus2, body.run(found))


def _stepped(search: _Search, x: Array, scores: Gradient, damping: float) -> Array:
    """The next point, inside the bounds. A parameter that is pulled against its bound stays there.

    None moves far beyond the width of its differences: the derivatives do not hold there, and a step that ends at a
    bound may not come back."""
    scale = np.sqrt(np.maximum(np.diag(scores.information), FLOOR))
    A, g = scores.information / np.outer(scale, scale), scores.each.sum(axis=0) / scale
    held = ((x <= search.low) & (g > 0.0)) | ((x >= search.high) & (g < 0.0))
    A[held], A[:, held], g[held] = 0.0, 0.0, 0.0
    move = np.linalg.solve(A + damping * np.eye(len(x)), g) / scale
    return np.clip(x - np.clip(move, -search.reach, search.reach), search.low, search.high)


def _inverse(information: Array) -> Array:
    """The covariance: the inverse of the information, very large in directions without information."""
    scale = np.sqrt(np.maximum(np.diag(information), FLOOR))
    sizes, axes = np.linalg.eigh(information / np.outer(scale, scale))
    return (axes / np.maximum(sizes, 1e-12)) @ axes.T / np.outer(scale, scale)
