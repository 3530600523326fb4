"""Hyperparameters of a Gaussian process by maximum posterior: exact, by Cholesky and L-BFGS, seeded.

    L = -y' C^-1 y / 2 - log det C / 2 - n log(2 pi) / 2                    log marginal likelihood
    dL/dp = sum_ij W_ij dC_ij/dp,   W = (a a' - C^-1) / 2,   a = C^-1 y

Rasmussen, Williams, "Gaussian Processes for Machine Learning", 2006, section 5.4.1. Automatic differentiation through
the factor takes five times as long. Inputs, features and target are scaled. Log-normal priors on the length scales keep
undetermined ones bounded. A few starts use `first` rows, and the refinement of the best start uses `rows` rows, both
evenly spread over the record. The search is over logarithms, so that all numbers stay positive; the noise stays above
its floor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numba import njit
from scipy.linalg import get_lapack_funcs

from mazeplan.core.errors import InputError, ModelError
from mazeplan.core.maths.exponential import exp_below
from mazeplan.core.progress import Advance, Words, no_advance, no_words, piece
from mazeplan.core.records import Array
from mazeplan.learning.features import STATE_TERMS, KernelColumns
from mazeplan.learning.gaussian_process import Hyperparameters, KernelTerm, add, squares
from mazeplan.learning.split import uniform_downsample

NOISE_FLOOR = 0.15  # minimum noise over the target's spread: impacts leave more, and a rough kernel would interpolate
LOOKS = 1.25  # maximum evaluations of the likelihood per iteration
LOG_SCALE, LOG_WIDTH = 0.7, 1.5  # mean and deviation of the prior on log length scales, in deviations of the input
MAX_LOG = 20.0  # bound on the logarithms, where nothing overflows
TINY = 1e-150  # minimum divisor r of a slope


@dataclass(frozen=True)
class TrainingOptions:
    """Settings of the training.

    first, rows:             number of rows for a start, and for the refinement
    starts:                  number of starts
    iterations, refinement:  number of iterations of a start, and of the refinement
    seed:                    for the first values of the starts
    family:                  of the kernel
    terms:                   columns and flip of each term of the kernel"""

    first: int = 600
    rows: int = 1000
    starts: int = 3
    iterations: int = 30
    refinement: int = 15
    seed: int = 0
    family: str = "rbf"
    terms: KernelColumns = STATE_TERMS


def train(
    inputs: Array,
    features: Array,
    y: Array,
    options: TrainingOptions | None = None,
    *,
    progress: Words = no_words,
    advance: Advance = no_advance,
) -> Hyperparameters:
    """Hyperparameters for inputs (N, D), features (N, M) and values y (N,); M may be 0.

    progress:  receives each step in words
    advance:   receives the share done

    Raises InputError if the samples have no likelihood."""
    options = options or TrainingOptions()
    scale = _Scale.of(inputs, features, y, options)
    rng = np.random.default_rng(options.seed)
    few, many = (uniform_downsample(len(y), n) for n in (options.first, options.rows))
    found: list[tuple[float, Array]] = []
    each, last = (n * len(rows) ** 2 for n, rows in ((options.iterations, few), (options.refinement, many)))
    whole = each * options.starts + last  # in proportion to the time
    posterior = Posterior(scale.take(inputs, features, y, few), options.terms, options.family)
    for start in range(options.starts):
        progress(f"start {start + 1} of {options.starts}, {len(few)} rows")
        share = piece(advance, each * len(found), each, whole)
        found.append(posterior.maximise(posterior.start(rng, start), options.iterations, share))
    _, best = max(found, key=lambda result: result[0])
    progress(f"refinement on {len(many)} rows")
    posterior = Posterior(scale.take(inputs, features, y, many), options.terms, options.family)
    refined, best = posterior.maximise(best, options.refinement, piece(advance, whole - last, last, whole))
    if not math.isfinite(refined):
        raise InputError("the likelihood of these samples has no finite maximum: are they all alike?")
    return scale.plain(posterior.hyper(best))


@dataclass(frozen=True)
class _Scale:
    """Offset and units of the inputs, units of features and target, for the optimiser."""

    middle: Array
    spread: Array
    features: Array
    y: float

    @classmethod
    def of(cls, inputs: Array, features: Array, y: Array, options: TrainingOptions) -> _Scale:
        def safe(values: Array) -> Array:
            return np.where(values > 1e-12, values, 1.0)

        spread, rms = safe(np.std(inputs, axis=0)), safe(np.sqrt(np.mean(features**2, axis=0)))
        middle = np.mean(inputs, axis=0)
        for columns, flip in options.terms:  # a flipped column is flipped about zero
            middle[[c for c, sign in zip(columns, flip, strict=False) if sign < 0.0]] = 0.0
        return cls(middle, spread, rms, float(safe(np.sqrt(np.mean(y**2)))))

    def take(self, inputs: Array, features: Array, y: Array, rows: Any) -> tuple[Array, Array, Array]:
        """Scaled inputs, features and target of some rows."""
        return (inputs[rows] - self.middle) / self.spread, features[rows] / self.features, y[rows] / self.y

    def plain(self, h: Hyperparameters) -> Hyperparameters:
        """The hyperparameters in the units of the data."""
        spreads = [self.spread[list(term.columns)] for term in h.terms]
        terms = tuple(
            replace(term, lengthscales=term.lengthscales * spread, amplitude=term.amplitude * self.y)
            for term, spread in zip(h.terms, spreads, strict=True)
        )
        return replace(h, terms=terms, noise=h.noise * self.y, weight_sigma=h.weight_sigma * self.y / self.features)


class Posterior:
    """Log posterior per row as a function of q: logarithms of the length scales and amplitude^2 of each term, of the
    noise variance above its floor, and of the variances of the weights."""

    def __init__(self, data: tuple[Array, Array, Array], terms: KernelColumns, family: str) -> None:
        self._data = data
        self._terms = terms
        self._family = family
        self._lengths = sum(len(columns) for columns, _ in terms)

    def start(self, rng: np.random.Generator, number: int) -> Array:
        """The first values of a start: typical values for start 0, else a draw around them."""
        random, weights = float(number > 0), self._data[1].shape[1]
        lengths, variances = [], []
        for columns, _ in self._terms:
            lengths.append(0.7 + 0.8 * random * rng.standard_normal(len(columns)))
            variances.append(math.log(0.3) + 0.7 * random * rng.standard_normal())
        noise = 0.1 * math.exp(0.7 * random * rng.standard_normal())
        above = math.log(max(noise - NOISE_FLOOR**2, 1e-3))
        return np.concatenate([*lengths, variances, [above], np.full(weights, math.log(0.3))])

    def hyper(self, q: Array) -> Hyperparameters:
        """The hyperparameters in the scaled units."""
        terms, at = [], 0
        for i, (columns, flip) in enumerate(self._terms):
            lengths = np.exp(q[at : at + len(columns)])
            terms.append(KernelTerm(tuple(columns), lengths, math.exp(0.5 * q[self._lengths + i]), tuple(flip)))
            at += len(columns)
        end = self._lengths + len(self._terms)
        noise = math.sqrt(NOISE_FLOOR**2 + math.exp(q[end]))
        return Hyperparameters(tuple(terms), noise, np.exp(0.5 * q[end + 1 :]), self._family)

    def __call__(self, q: Array) -> tuple[float, Array]:
        """Log posterior per row, and its gradient by q."""
        h = self.hyper(q)
        value, (by_length, *by_others) = log_likelihood(h, *self._data)
        logs = q[: self._lengths]
        off = (logs - LOG_SCALE) / LOG_WIDTH
        prior = -logs - 0.5 * off**2 - math.log(LOG_WIDTH * math.sqrt(2.0 * math.pi))
        by_length = by_length * np.exp(logs) - 1.0 - off / LOG_WIDTH
        others = np.concatenate(by_others) * np.exp(q[self._lengths :])
        n = len(self._data[2])
        return (value + float(np.sum(prior))) / n, np.concatenate([by_length, others]) / n

    def maximise(self, q: Array, iterations: int, advance: Advance = no_advance) -> tuple[float, Array]:
        """Maximise by L-BFGS. Returns the log posterior per row that it reached, and where."""
        reached, looks, best = -math.inf, 0, q

        def loss(at: Array) -> tuple[float, Array]:
            nonlocal reached, looks, best
            try:
                value, slope = self(at)
            except ModelError:  # of the covariance
                return 1e6, np.zeros(len(at))
            looks += 1
            if value > reached:
                reached, best = value, at.copy()
            advance(looks, LOOKS * iterations)
            return -value, -slope

        from scipy.optimize import minimize  # slow to import

        limits = {"maxiter": iterations, "maxcor": 20, "ftol": 1e-12, "gtol": 1e-7}
        minimize(loss, q, jac=True, method="L-BFGS-B", bounds=[(-MAX_LOG, MAX_LOG)] * len(q), options=limits)
        advance(1, 1)
        return reached, best


def log_likelihood(h: Hyperparameters, inputs: Array, features: Array, y: Array) -> tuple[float, list[Array]]:
    """Log likelihood for inputs (N, D), features (N, M) and values y (N,), and its derivatives by the length scales of
    all terms, by their amplitude^2, by the noise variance, and by the variances of the weights.

    Raises ModelError if the covariance is not positive definite."""
    n, rbf = len(y), h.family == "rbf"
    wide = np.ascontiguousarray(features * h.weight_sigma)
    C = (wide @ wide.T).T  # in LAPACK's order; it is symmetric
    C[np.diag_indices(n)] += h.noise**2
    pairs = [term.scaled(inputs, inputs) for term in h.terms]
    for term, (x, others) in zip(h.terms, pairs, strict=True):
        for sign, z in others:
            add(x, z, sign * term.amplitude**2, rbf, True, C.T)
    potrf, potrs, potri = get_lapack_funcs(("potrf", "potrs", "potri"), (C,))
    factor, info = potrf(C, lower=0, overwrite_a=1)
    if info:
        raise ModelError("the covariance of the training rows is not positive definite")
    a, _ = potrs(factor, y, lower=0)
    log_det = 2.0 * float(np.sum(np.log(np.diag(factor))))
    value = -0.5 * (float(y @ a) + log_det + n * math.log(2.0 * math.pi))
    inverse, _ = potri(factor, lower=0, overwrite_c=1)
    W = inverse.T  # rows of its lower triangle
    _weigh(a, W)
    lengths, variances = [], np.zeros(len(h.terms))
    for t, (term, (x, others)) in enumerate(zip(h.terms, pairs, strict=True)):
        by = np.zeros(1 + len(x))
        for sign, z in others:
            _project(x, z, sign, rbf, W, by)
        variances[t] = by[0]
        lengths.append(term.amplitude**2 * by[1:] / term.lengthscales)
    by_weight = np.array([_quadratic(W, np.ascontiguousarray(column)) for column in features.T])
    return value, [np.concatenate(lengths), variances, np.array([np.trace(W)]), by_weight]


@njit(cache=True, error_model="numpy", fastmath=True)
def _weigh(a, W):
    """Turn the lower triangle W of C^-1 into that of (a a' - C^-1) / 2, with elements off the diagonal doubled."""
    for i in range(len(a)):
        row = W[i]
        for j in range(i):
            row[j] = a[i] * a[j] - row[j]
        row[i] = 0.5 * (a[i] * a[i] - row[i])


@njit(cache=True, error_model="numpy", fastmath=True)
def _project(x, z, sign, rbf, W, out):
    """Add sign sum W c to out[0], sign sum W dc/dlog(l_d) to out[1 + d]."""
    n = len(W)
    gaps, part = np.empty(n), np.empty(n)
    for i in range(n):
        squares(x, z, i, i + 1, gaps)
        row, total = W[i], 0.0
        if rbf:
            for j in range(i + 1):
                part[j] = row[j] * exp_below(max(-0.5 * gaps[j], -700.0))
                total += part[j]
        else:
            for j in range(i + 1):
                r = math.sqrt(gaps[j])
                c = row[j] * exp_below(max(-r, -700.0))
                total += c
                part[j] = c / max(r, TINY)
        out[0] += sign * total
        for d in range(len(x)):
            column, here, along = z[d], x[d, i], 0.0
            for j in range(i + 1):
                gap = here - column[j]
                along += part[j] * gap * gap
            out[1 + d] += sign * along


@njit(cache=True, error_model="numpy", fastmath=True)
def _quadratic(W, phi):
    """Sum of W phi phi' over the lower triangle."""
    total = 0.0
    for i in range(len(phi)):
        row, along = W[i], 0.0
        for j in range(i + 1):
            along += row[j] * phi[j]
        total += phi[i] * along
    return total
