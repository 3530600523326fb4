"""Two usual ways to correct a model, for bench_baselines.py: a Gaussian process on the residual acceleration, and
sparse regression of it on the terms by which named effects act (STLSQ of PySINDy, no dependency of the package)."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from bench_plant import DECLARED, SECONDS

from mazeplan.core.constants import GRAVITY
from mazeplan.core.maths.angles import difference
from mazeplan.core.records import Array, IntArray
from mazeplan.diagnosis.coordinate.kalman import SUBSTEPS
from mazeplan.diagnosis.ring.scores import AHEAD
from mazeplan.learning.smoothing import Smoothing, acceleration_kernel, derivatives

MOST, MOST_TRIED = 600, 300  # rows of the Gaussian process; where only a smoothing is tried
FOLDS, TRIED = 5, 0.7  # blocks of the cross-validation; share of the seen part, on whose rest a smoothing is tried
THRESHOLDS = np.geomspace(0.003, 3.0, 31)  # rad/s^2, of a term's root mean square
SMOOTHINGS = tuple(Smoothing(window=w, order=o) for w, o in ((9, 2), (21, 4), (31, 4)))

Force = Callable[[Array, Array, Array, Array], Array]  # x, v, t (n,), motion of the plate (n, 6) -> rad/s^2 (n,)


@dataclass(frozen=True)
class Ground:
    """What all ways share: t, theta as measured (N,); motion (N, NODES, 6) of the plate from each sample to the next;
    the declared model; seen, early (N,): rows for fits, for fits to try a smoothing; states (N, 2) to begin from; rows
    where roll-outs start: held_out (W,), and tried among those seen that are not early."""

    t: Array
    dt: float
    theta: Array
    motion: Array
    declared: Force
    seen: np.ndarray
    early: np.ndarray
    states: Array
    held_out: IntArray
    tried: IntArray


@dataclass(frozen=True)
class Residual:
    """Acceleration that the declared model lacks: x, v, t, value (N,), motion (N, 6); average: what the smoothing did
    to any signal (N,), to be done to regressors as well; known (N,): where all of that is known."""

    x: Array
    v: Array
    t: Array
    motion: Array
    value: Array
    average: Callable[[Array], Array]
    known: np.ndarray


@dataclass(frozen=True)
class Correction:
    """A force to add to the declared model, and the names of its terms."""

    force: Force
    kept: tuple[str, ...] = ()


def declared_model(radius: float) -> Force:
    """The equation of a ball in a ring with DECLARED, written for many states at once."""
    factor, viscous = DECLARED["rolling_inertia"]["factor"], DECLARED["viscous_friction"]["coefficient"]

    def force(x: Array, v: Array, t: Array, motion: Array) -> Array:
        b, bd, bdd, c, cd, _ = motion.T
        sin, cos = np.sin(x), np.cos(x)
        plate = bdd * np.sin(c) + 2.0 * bd * cd * np.cos(c) * sin**2 + (cd**2 - (bd * np.cos(c)) ** 2) * sin * cos
        gravity = factor * GRAVITY / radius * (np.sin(b) * sin + np.sin(c) * np.cos(b) * cos)
        return plate - gravity - viscous * v

    return force


def regressors(x: Array, v: Array, t: Array, motion: Array) -> dict[str, Array]:
    """The terms by which named effects act. The whole of the gravity part is not among them: it is the sum of `beta
    sin` and `gamma cos`, and no regression could tell it from those."""
    b, bd, _, c, cd, _ = motion.T
    sin, cos = np.sin(x), np.cos(x)
    return {
        "v": v, "v abs v": v * np.abs(v), "sign v": np.sign(v), "1": np.ones_like(v), "sin": sin, "cos": cos,
        "sin 2": np.sin(2.0 * x), "cos 2": np.cos(2.0 * x), "t v": t / SECONDS * v, "beta sin": b * sin,
        "gamma cos": c * cos, "beta cos": b * cos, "gamma sin": c * sin, "beta' sin": bd * sin, "beta' cos": bd * cos,
        "gamma' sin": cd * sin, "gamma' cos": cd * cos,
    }  # fmt: skip


NONE = np.empty(0)
TERMS = tuple(regressors(NONE, NONE, NONE, np.empty((0, 6))))
RIGHT: dict[str, set[str] | None] = {  # regressors of an effect at its size in the table; None: no sum of these
    "nothing": set(), "dry_friction": {"sign v"}, "tilt_offset": {"sin", "cos"},
    "rolling_inertia": {"beta sin", "gamma cos"}, "viscous_friction": {"v"}, "quadratic_drag": {"v abs v"},
    "constant_torque": {"1"}, "axis_misalignment": {"beta cos", "gamma sin"},
    "sensor_delay": {"beta' sin", "gamma' cos"}, "friction_drift": {"t v"}, "surface_profile": {"cos", "sin 2"},
    "surface_bump": None, "gate_loss": None, "tilt_gain": {"beta sin", "gamma cos"}, "camera_offset": None,
}  # fmt: skip


def roll_out(ground: Ground, force: Force, starts: IntArray, steps: int = AHEAD[-1]) -> Array:
    """Angles (W,) `steps` samples after each start, by Runge-Kutta 4 in as many steps as the diagnosis takes."""
    x, v = ground.states[starts].T
    h = ground.dt / SUBSTEPS
    for k in range(steps):
        for i in range(SUBSTEPS):
            t = ground.t[starts + k] + i * h
            w0, w1, w2 = (ground.motion[starts + k, 2 * i + j] for j in range(3))
            a1 = force(x, v, t, w0)
            a2 = force(x + 0.5 * h * v, v + 0.5 * h * a1, t + 0.5 * h, w1)
            a3 = force(x + 0.5 * h * v + 0.25 * h * h * a1, v + 0.5 * h * a2, t + 0.5 * h, w1)
            a4 = force(x + h * v + 0.5 * h * h * a2, v + h * a3, t + h, w2)
            x, v = x + h * v + h * h / 6.0 * (a1 + a2 + a3), v + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
    return x


def error_of(ground: Ground, missing: Force, starts: IntArray) -> float:
    """Mean absolute error (rad) of theta after 40 samples, of the declared model with a force added."""

    def force(x: Array, v: Array, t: Array, motion: Array) -> Array:
        return ground.declared(x, v, t, motion) + missing(x, v, t, motion)

    return float(np.mean(np.abs(difference(roll_out(ground, force, starts), ground.theta[starts + AHEAD[-1]]))))


def residual(ground: Ground, smoothing: Smoothing, averaged: bool = True) -> Residual:
    """By Savitzky and Golay. Averaged: the declared acceleration is taken off as the window averaged it, so that a
    blunt window leaves no trace of it; otherwise as it is at the sample, which is what is usually done."""
    smooth = derivatives(ground.theta, ground.dt, smoothing)
    weights = acceleration_kernel(smoothing.window, smoothing.order) if averaged else np.ones(1)

    def average(signal: Array) -> Array:
        out, half = np.full(signal.shape, np.nan), len(weights) // 2
        out[half : len(signal) - half] = np.correlate(signal, weights, mode="valid")
        return out

    motion = ground.motion[:, 0]
    value = smooth.acceleration - average(ground.declared(smooth.value, smooth.rate, ground.t, motion))
    return Residual(smooth.value, smooth.rate, ground.t, motion, value, average, np.isfinite(value))


def chosen(ground: Ground, make: Callable[[Residual, IntArray, bool], Correction], averaged: bool = True) -> Correction:
    """A correction with the smoothing that did best in roll-outs within the seen part; make: from a residual, rows, and
    whether it is only a trial."""
    errors = []
    found = [residual(ground, smoothing, averaged) for smoothing in SMOOTHINGS]
    for r in found:
        trial = make(r, np.flatnonzero(r.known & ground.early), True)
        errors.append(error_of(ground, trial.force, ground.tried))
    best = found[int(np.argmin(errors))]
    return make(best, np.flatnonzero(best.known & ground.seen), False)


def process_inputs(x: Array, v: Array, motion: Array) -> Array:
    """(n, 7)."""
    return np.column_stack([v, np.sin(x), np.cos(x), motion[:, 0], motion[:, 3], motion[:, 1], motion[:, 4]])


def gaussian_process(found: Residual, rows: IntArray, trial: bool = False) -> Correction:
    """The mean of a Gaussian process on the residual of some rows, evenly spread over those given."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    most = min(MOST_TRIED if trial else MOST, len(rows))
    rows = rows[np.linspace(0, len(rows) - 1, most).astype(int)]
    X = process_inputs(found.x[rows], found.v[rows], found.motion[rows])
    middle, scale, size = X.mean(axis=0), X.std(axis=0), found.value[rows].std()
    lengths = RBF(np.full(X.shape[1], 3.0), (0.1, 1e3))  # pyright: ignore[reportArgumentType]
    kernel = ConstantKernel(0.1, (1e-6, 1e3)) * lengths + WhiteKernel(1.0, (1e-4, 10))
    process = GaussianProcessRegressor(kernel, random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # an input that tells nothing has its length at the bound
        process.fit((X - middle) / scale, found.value[rows] / size)

    def force(x: Array, v: Array, t: Array, motion: Array) -> Array:
        return np.asarray(process.predict((process_inputs(x, v, motion) - middle) / scale)) * size

    return Correction(force)


def thresholded(X: Array, y: Array, thresholds: Array) -> Array:
    """Coefficients (T, K) by STLSQ at some thresholds; terms whose part has a root mean square below are left out."""
    from pysindy.optimizers import STLSQ  # pyright: ignore[reportMissingImports]

    scale = np.sqrt(np.mean(X**2, axis=0))
    R = np.asarray(np.linalg.qr(np.column_stack([X / scale, y]), mode="r"))  # has the same solutions, in a few rows
    found = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that nothing is left is an answer, too
        for threshold in thresholds:
            way = STLSQ(threshold=float(threshold), alpha=1e-6 * len(y))
            found.append(np.ravel(way.fit(R[:, :-1], R[:, -1]).coef_) / scale)
    return np.array(found)


def sparse_regression(found: Residual, rows: IntArray, trial: bool = False) -> Correction:
    """STLSQ on the regressors, averaged as the residual was; of the thresholds whose error in cross-validation by
    blocks is within a standard error of the least, the largest."""
    columns = {k: found.average(c) for k, c in regressors(found.x, found.v, found.t, found.motion).items()}
    X, y = np.column_stack([c[rows] for c in columns.values()]), found.value[rows]
    blocks = np.array_split(np.arange(len(rows)), FOLDS)
    errors = np.empty((len(THRESHOLDS), FOLDS))
    for j, block in enumerate(blocks):
        w = thresholded(np.delete(X, block, axis=0), np.delete(y, block), THRESHOLDS)
        errors[:, j] = np.mean((y[block] - w @ X[block].T) ** 2, axis=1)
    means, best = errors.mean(axis=1), int(np.argmin(errors.mean(axis=1)))
    within = means <= means[best] + errors[best].std(ddof=1) / np.sqrt(FOLDS)
    w = thresholded(X, y, THRESHOLDS[np.flatnonzero(within)[-1:]])[0]

    def force(x: Array, v: Array, t: Array, motion: Array) -> Array:
        return np.column_stack(list(regressors(x, v, t, motion).values())) @ w

    return Correction(force, tuple(k for k, c in zip(columns, w, strict=True) if c != 0.0))


def right(effect: str, kept: Sequence[str]) -> bool:
    """Whether just the regressors of an effect were kept; never for one that they cannot make."""
    return RIGHT[effect] == set(kept)
