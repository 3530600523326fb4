"""Cubature Kalman filter for a ball modelled as a rigid body: state (x, y, vx, vy, w) of `physics.dynamics.rigid_body`.

    points     mean +- sqrt(5) times the columns of the Cholesky factor of P: ten points of equal weight
    motion     each point through `physics.dynamics.rigid_body.step` at the moments that the camera shows: t - delay
    picture    y = scale Rot(angle) (x, y) + offset + noise; linear, so the update is exact
    noise      white accelerations in x, y and w; a contact with a wall adds an error of the velocities, which is a
               share of the change that the contact made

This is the third-degree cubature rule (Arasaratnam and Haykin, IEEE Trans. Automatic Control 54, 2009). Without a
picture the prediction goes on for up to `BRIDGED` s. A picture that is far off does not correct the state, and counts
in the likelihood like a picture at the limit. Several such pictures in a row restart the filter.

A ball that just misses an edge of an opening takes another way than one that just hits it. So the velocity gets noise
where the record shows the ball at an edge (`at_edges`). Without it, the likelihood jumps by about 100 between near
parameters, and a fit stops at any of them. Which pictures count depends on the record alone, for the same reason.

    -2 log L = sum over pictures of nu' S^-1 nu + log det S
"""

from __future__ import annotations

import math
from collections import OrderedDict
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numba import njit

from mazeplan.core.maths.compiled import CALLEE, KERNEL, pointer_to
from mazeplan.core.records import Array, IntArray
from mazeplan.physics.dynamics.plate import ROW, TIME_AT, PlateMotion, Tilting, plate_rows
from mazeplan.physics.dynamics.rigid_body import STATE, Ball, advance, begin_step, body_core, effects_of, step
from mazeplan.physics.dynamics.walls import Walls, corners
from mazeplan.physics.effect import Term

SUBSTEPS, SUBSTEP_S = 5, 1.0 / 150.0  # most steps per picture; s, of a step. Shorter ones change only the roughness
POINTS = 2 * STATE
BRIDGED = 0.5  # s without a picture after which the filter starts again
SETTLING = 8  # pictures after a start that correct the state however far off they are
EARLY = 24  # first pictures of a stretch that do not count; more than those that show the time before it
AT_EDGE, EDGE_NOISE = 0.8e-3, 0.1  # m from touching an edge of an opening; noise of the velocity there, over the speed
FAR = 36.0  # limit of nu' S^-1 nu; a picture beyond it is rejected
REJECTED_TO_RESTART = 3  # number of rejected pictures in a row that restart the filter
START_SPEED, START_SPIN = 0.15, 0.10  # m/s, one sigma, when the filter starts
STRAIGHTENED = 4  # fixed-point iterations that remove the distortion of the lens
LEAST = 1e-18  # minimum variance, so that a Cholesky factor exists
REMEMBERED = 1.2e8  # bytes of innovations that a filter keeps
ALIKE = 12  # two models are the same if their numbers agree in this many significant digits


class CameraView(NamedTuple):
    """The camera: seen = offset + d (1 + bend |d|^2), d = scale Rot(angle) (x, y).

    offset_x, offset_y:  m
    angle, scale:        rotation, rad, and scale
    delay, noise:        s; one sigma, m"""

    offset_x: float = 0.0
    offset_y: float = 0.0
    angle: float = 0.0
    scale: float = 1.0
    delay: float = 0.06
    noise: float = 1e-3
    bend: float = 0.0  # distortion of the lens, 1/m^2


class ProcessNoise(NamedTuple):
    """Unexplained motion.

    plane, spin:  intensity of white accelerations in the plane and of the spin, m^2/s^3"""

    plane: float = 1e-4
    spin: float = 1e-8
    strike: float = 0.05  # standard deviation of the velocity after a contact, over the speed that the wall took away


@dataclass(frozen=True)
class BallPictures:
    """The ball in the pictures of a record.

    t (N,), dt:  time by counting pictures, s"""

    t: Array
    dt: float
    y: Array  # (N, 2): measured position, m; NaN if lost
    begins: np.ndarray  # (N,): whether a stretch begins
    clock: Array | None = None  # (N,): true time, s, for effects that change with time; None if it equals t

    def __len__(self) -> int:
        return len(self.t)


class BodyModel(NamedTuple):
    """The model of the filter. terms: further effects on the ball (`rigid_body.effects_of`)."""

    ball: Ball = Ball()
    tilting: Tilting = Tilting()
    view: CameraView = CameraView()
    wander: ProcessNoise = ProcessNoise()
    terms: tuple[Term, ...] = ()


class Filtered(NamedTuple):
    """Result of the filter.

    state (N, 5), cov (N, 5, 5):  mean and covariance after each picture
    starts, left_out:             number of starts of the filter, and of rejected pictures"""

    nu: Array  # (N, 2): innovations in the plate's axes, m; NaN where nothing counts
    S: Array  # (N, 3): their variances and covariance: xx, yy, xy
    state: Array
    cov: Array
    starts: int
    left_out: int
    minus2: float  # -2 log L

    def whitened(self) -> Array:
        """The K innovations that count, each pair transformed into two independent numbers of variance 1: (K, 2)."""
        keep = np.isfinite(self.nu[:, 0])
        (a, b), (xx, yy, xy) = self.nu[keep].T, self.S[keep].T
        first = a / np.sqrt(xx)
        return np.column_stack([first, (b - xy / xx * a) / np.sqrt(yy - xy * xy / xx)])


NO_STATES = np.empty(0)


class FilterCore(NamedTuple):
    """`CameraView` and `ProcessNoise` for compiled code."""

    offset_x: float
    offset_y: float
    cos: float
    sin: float
    scale: float
    variance: float
    bend: float
    plane: float
    spin: float
    strike: float


def filter_core(view: CameraView, wander: ProcessNoise) -> FilterCore:
    """The numbers of camera and unexplained motion for compiled code."""
    cos, sin = math.cos(view.angle), math.sin(view.angle)
    lens = cos, sin, view.scale, view.noise**2, float(view.bend)
    return FilterCore(view.offset_x, view.offset_y, *lens, *map(float, wander))


@njit(**CALLEE)
def _cholesky(P, L):
    """Lower factor L (5, 5) of P (5, 5)."""
    for i in range(STATE):
        for j in range(i + 1):
            total = P[i, j]
            for n in range(j):
                total -= L[i, n] * L[j, n]
            L[i, j] = math.sqrt(max(total, LEAST)) if i == j else total / L[j, j]


@njit(**CALLEE)
def predict_body(core, rows, first, count, h, mean, P, L, points):
    """Predict mean (5,) and P (5, 5) through `count` sub-steps from row `first` on; points (10, 5), L: scratch space.

    Returns how much walls changed the speed, m/s, on average over the points."""
    _cholesky(P, L)
    spread, width, hits = math.sqrt(float(STATE)), rows.shape[1], 0.0
    for n in range(POINTS):
        sign, column = (spread, n) if n < STATE else (-spread, n - STATE)
        for i in range(STATE):
            points[n, i] = mean[i] + sign * L[i, column]
    for j in range(first, first + count):  # all points in each sub-step: the processor works on several points at once
        row = pointer_to(rows, j * width)
        begin_step(core, row)
        for n in range(POINTS):
            x, y, vx, vy, w, hit = step(
                core, row, h, points[n, 0], points[n, 1], points[n, 2], points[n, 3],
                points[n, 4],
            )  # fmt: skip
            points[n, 0], points[n, 1], points[n, 2], points[n, 3], points[n, 4] = x, y, vx, vy, w
            hits += hit
    for i in range(STATE):
        total = 0.0
        for n in range(POINTS):
            total += points[n, i]
        mean[i] = total / POINTS
    for i in range(STATE):
        for j in range(i + 1):
            total = 0.0
            for n in range(POINTS):
                total += (points[n, i] - mean[i]) * (points[n, j] - mean[j])
            P[i, j] = P[j, i] = total / POINTS
    return hits / POINTS


@njit(**CALLEE)
def add_process_noise(P, kf, dt, hit, edge=0.0):
    """Add to P (5, 5) the white accelerations over dt s, and the noise of contacts that took `hit` m/s away.

    edge: speed of a ball that may have hit an edge at any time of the last dt s, m/s"""
    often = EDGE_NOISE * EDGE_NOISE * edge * edge / dt
    plane = kf.plane + often
    rough = kf.strike * kf.strike * hit * hit
    for i in range(2):
        P[i, i] += plane * dt * dt * dt / 3.0
        P[i, i + 2] += plane * dt * dt / 2.0
        P[i + 2, i] += plane * dt * dt / 2.0
        P[i + 2, i + 2] += plane * dt + rough
    P[4, 4] += (kf.spin + often) * dt + rough


@njit(**CALLEE)
def correct(mean, P, gain, scale, a, b, xx, yy, xy):
    """Correct mean (5,) and P (5, 5) by innovations (a, b) with variances xx, yy and covariance xy.

    gain (5, 2): scratch space."""
    det = xx * yy - xy * xy
    for i in range(STATE):
        c, d = scale * P[i, 0], scale * P[i, 1]
        gain[i, 0], gain[i, 1] = (c * yy - d * xy) / det, (d * xx - c * xy) / det
    for i in range(STATE):
        mean[i] += gain[i, 0] * a + gain[i, 1] * b
    for i in range(STATE):  # P - K S K'
        u = gain[i, 0] * xx + gain[i, 1] * xy
        v = gain[i, 0] * xy + gain[i, 1] * yy
        for j in range(i + 1):
            P[i, j] -= u * gain[j, 0] + v * gain[j, 1]
    for i in range(STATE):
        for j in range(i):
            P[j, i] = P[i, j]


@njit(**KERNEL)
def begin(mean, P, kf, a, b):
    """Start the filter at the place (a, b), which is in the plate's axes times the scale."""
    mean[:], P[:] = 0.0, 0.0
    mean[0], mean[1] = a / kf.scale, b / kf.scale
    P[0, 0] = P[1, 1] = kf.variance / (kf.scale * kf.scale)
    P[2, 2] = P[3, 3] = START_SPEED * START_SPEED
    P[4, 4] = START_SPIN * START_SPIN


@njit(**CALLEE)
def _straightened(kf, u, v):
    """The place (u, v), counted from the camera's middle, without the distortion of the lens; and the magnification of
    the lens there (mean of the radial and the tangential one)."""
    if kf.bend == 0.0:
        return u, v, 1.0
    a, b = u, v
    for _ in range(STRAIGHTENED):
        over = 1.0 + kf.bend * (a * a + b * b)
        a, b = u / over, v / over
    return a, b, 1.0 + 2.0 * kf.bend * (a * a + b * b)


@njit(cache=True, error_model="numpy", nogil=True)
def _run(ball, walls, effects, kf, y, begins, edge, rows, dt, per, late, nu, S, state, cov):
    """Filter pictures y (N, 2). Writes nu, S, state and cov as in `Filtered`. Returns (starts, left_out, minus2)."""
    core = body_core(ball, walls, effects)
    mean, P, L = np.zeros(STATE), np.zeros((STATE, STATE)), np.zeros((STATE, STATE))
    points, gain = np.empty((POINTS, STATE)), np.empty((STATE, 2))
    h, gap = dt / per, int(BRIDGED / dt + 0.5)
    starts = left_out = 0
    unseen, age, doubted, since, minus2, running = 0, 0, 0, 0, 0.0, False
    for k in range(len(y)):
        nu[k, 0] = nu[k, 1] = math.nan
        S[k, 0] = S[k, 1] = 1.0
        S[k, 2] = 0.0
        running = running and not begins[k]
        since = 0 if begins[k] else since + 1
        if running:
            speed = math.hypot(mean[2], mean[3]) if edge[k] else 0.0
            hit = predict_body(core, rows, (k - 1) * per, per, h, mean, P, L, points)
            add_process_noise(P, kf, dt, hit, speed)
        unseen += 1
        if since >= late and math.isfinite(y[k, 0]) and math.isfinite(y[k, 1]):
            u, v, near = _straightened(kf, y[k, 0] - kf.offset_x, y[k, 1] - kf.offset_y)
            a, b = kf.cos * u + kf.sin * v, kf.cos * v - kf.sin * u
            lost, scale = not running or unseen > gap, near * kf.scale
            du, dv = near * a - scale * mean[0], near * b - scale * mean[1]
            square = scale * scale
            xx, yy, xy = square * P[0, 0] + kf.variance, square * P[1, 1] + kf.variance, square * P[0, 1]
            det = xx * yy - xy * xy
            size = (du * du * yy - 2.0 * du * dv * xy + dv * dv * xx) / det
            counts, age = since >= EARLY and not lost, age + 1
            if counts:
                minus2 += math.log(det) + min(size, FAR)
            if lost or doubted >= REJECTED_TO_RESTART:
                begin(mean, P, kf, a, b)
                starts += 1
                unseen, age, doubted, running = 0, 0, 0, True
            elif size > FAR and age > SETTLING:
                doubted += 1
                left_out += 1
            else:
                unseen, doubted = 0, 0
                correct(mean, P, gain, scale, du, dv, xx, yy, xy)
                if counts:
                    nu[k, 0], nu[k, 1], S[k, 0], S[k, 1], S[k, 2] = du, dv, xx, yy, xy
        state[k], cov[k] = mean, P
    return starts, left_out, minus2


def at_edges(y: Array, walls: Walls) -> np.ndarray:
    """Whether the ball is at an edge of an opening in a picture or in the one before, (N,). y: see `BallPictures`"""
    near, size = np.zeros(len(y), dtype=bool), walls.radius + walls.rounding + AT_EDGE
    for corner in corners(walls):
        near |= np.hypot(*(y - corner).T) < size
    return near | np.concatenate([near[:1], near[:-1]])


class BodyFilter:
    """Pictures, the plate's motion and walls, ready to be filtered under any `BodyModel`."""

    def __init__(
        self, pictures: BallPictures, plate: PlateMotion, walls: Walls, soonest: float = -math.inf,
        edge: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        """soonest: smallest delay of the camera behind the motion of the plate that is possible, s
        edge: `at_edges` of these pictures, if it is known"""
        self.pictures, self.plate, self.walls, self.soonest = pictures, plate, walls, soonest
        self.substeps = min(SUBSTEPS, math.ceil(pictures.dt / SUBSTEP_S - 1e-9))
        n = len(pictures)
        self._rows: tuple[object, Array] = None, np.empty((0, ROW))  # replaced, not changed: other threads may read it
        self._y, self._begins = np.ascontiguousarray(pictures.y), np.ascontiguousarray(pictures.begins)
        self._t, self.edge = np.ascontiguousarray(pictures.t), at_edges(pictures.y, walls) if edge is None else edge
        self._known: OrderedDict[tuple[object, ...], Filtered] = OrderedDict()
        self._most = max(int(REMEMBERED / (8.0 * 5 * max(n, 1))), 1)

    def part(self, rows: np.ndarray) -> BodyFilter:
        """A filter for some of the pictures, a mask (N,). A new stretch begins after each gap."""
        p = self.pictures
        begun = np.concatenate([[True], np.diff(np.flatnonzero(rows)) > 1])
        clock = None if p.clock is None else p.clock[rows]
        seen = replace(p, t=p.t[rows], y=p.y[rows], begins=p.begins[rows] | begun, clock=clock)
        return BodyFilter(seen, self.plate, self.walls, self.soonest, self.edge[rows])

    def rows(self, tilting: Tilting, delay: float) -> Array:
        """Rows (N substeps, ROW) of `physics.dynamics.plate` between the pictures.

        delay: time after which the camera shows them, s"""
        key, (known, rows) = (tilting, delay), self._rows
        if key != known:
            h, rows = self.pictures.dt / self.substeps, np.empty((len(self.pictures) * self.substeps, ROW))
            plate_rows(self.plate, tilting, self._t - delay, h, self.substeps, rows)
            if self.pictures.clock is not None:
                rows[:, TIME_AT] += np.repeat(self.pictures.clock - self._t, self.substeps)
            self._rows = key, rows
        return rows

    def run(self, model: BodyModel) -> Filtered:
        """Filter all pictures. Raises ValueError for a term that cannot act on a body."""
        n, view, kf = len(self.pictures), model.view, filter_core(model.view, model.wander)
        nu, S, state, cov = np.empty((n, 2)), np.empty((n, 3)), np.empty((n, STATE)), np.empty((n, STATE, STATE))
        rows = self.rows(model.tilting, view.delay)
        late = math.ceil(view.delay / self.pictures.dt - 1e-9)  # pictures that show the time before their stretch
        found = _run(
            Ball(*map(float, model.ball)), self.walls, effects_of(model.terms), kf, self._y, self._begins,
            self.edge, rows, self.pictures.dt, self.substeps, late, nu, S, state, cov,
        )  # fmt: skip
        return Filtered(nu, S, state, cov, *found)

    def innovations(self, model: BodyModel) -> Filtered:
        """As `run`, without states. Results of recent models are kept, because a search returns to the same points."""
        key = _key(model)
        known = self._known.pop(key, None) or self.run(model)._replace(state=NO_STATES, cov=NO_STATES)
        self._known[key] = known  # the last one of the order
        if len(self._known) > self._most:
            self._known.popitem(last=False)
        return known

    def rolled_out(self, model: BodyModel, states: Array, starts: IntArray, steps: int) -> Array:
        """Roll-outs as the camera would see the ball, (W, steps + 1, 2), m, along the plate's motion.

        They begin at the pictures `starts` (W,), with the states (N, 5) of all pictures."""
        rows, per, view = self.rows(model.tilting, model.view.delay), self.substeps, model.view
        ball, effects, out = Ball(*map(float, model.ball)), effects_of(model.terms), np.empty((steps * per, STATE))
        places = np.empty((len(starts), steps + 1, 2))
        for places_, start in zip(places, starts, strict=True):
            part = rows[start * per : (start + steps) * per]
            advance(ball, self.walls, effects, part, self.pictures.dt / per, states[start], out)
            places_[0], places_[1:] = states[start, :2], out[per - 1 :: per, :2]
        cos, sin = math.cos(view.angle), math.sin(view.angle)
        seen = view.scale * places @ np.array([[cos, -sin], [sin, cos]]).T
        bent = 1.0 + view.bend * np.sum(seen * seen, axis=-1, keepdims=True)
        return seen * bent + np.array([view.offset_x, view.offset_y])


def _key(model: BodyModel) -> tuple[object, ...]:
    """Key of a model for its results. It leaves out the last digits of a number: a search that takes a logarithm and
    its inverse changes them."""
    terms = [term for term in model.terms if not term.idle]
    sizes = (number for term in terms for number in term.numbers)
    numbers = (*model.ball, *model.tilting, *model.view, *model.wander, *sizes)
    return *(f"{float(number):.{ALIKE}g}" for number in numbers), *(term.effect for term in terms)
