"""Hyperparameters of a Gaussian process by maximum posterior: exact, by Cholesky and L-BFGS, seeded.

Inputs, features and target are scaled. Log-normal priors on the length scales keep undetermined ones bounded. A few
starts use `first` rows, and the refinement of the best start uses `rows` rows, both evenly spread over the record.
`gp_likelihood` gives the likelihood and its derivatives. The search is over logarithms, so that all numbers stay
positive; the noise stays above its floor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mazeplan.core.errors import InputError, ModelError, SettingsError
from mazeplan.core.progress import Advance, Words, no_advance, no_words, piece
from mazeplan.core.records import Array
from mazeplan.learning.features import STATE_TERMS, KernelColumns
from mazeplan.learning.gaussian_process import FAMILIES, Hyperparameters, KernelTerm
from mazeplan.learning.gp_likelihood import log_likelihood
from mazeplan.learning.split import uniform_downsample

NOISE_FLOOR = 0.15  # minimum noise over the target's spread: impacts leave more, and a rough kernel would interpolate
LOOKS = 1.25  # maximum evaluations of the likelihood per iteration
LOG_SCALE, LOG_WIDTH = 0.7, 1.5  # mean and deviation of the prior on log length scales, in deviations of the input
STEP = 20.0  # bound on the logarithms, where nothing overflows


@dataclass(frozen=True)
class TrainingOptions:
    """Settings of the training. Raises SettingsError.

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

    def __post_init__(self) -> None:
        for name in ("first", "rows", "starts", "iterations", "refinement"):
            if not (isinstance(getattr(self, name), int) and getattr(self, name) >= 1):
                raise SettingsError(f"got {getattr(self, name)!r}, expected a whole number >= 1", key=name)
        if self.family not in FAMILIES:
            raise SettingsError(f"got {self.family!r}, expected one of {', '.join(FAMILIES)}", key="family")


@dataclass(frozen=True)
class Training:
    """Result of the training.

    starts:   log posterior per row (of the scaled values) after each start
    refined:  the same after the refinement
    rows:     number of rows of the refinement"""

    hyper: Hyperparameters
    starts: tuple[float, ...]
    refined: float
    rows: int


def train(
    inputs: Array,
    features: Array,
    y: Array,
    options: TrainingOptions | None = None,
    *,
    progress: Words = no_words,
    advance: Advance = no_advance,
) -> Training:
    """Hyperparameters for inputs (N, D), features (N, M) and values y (N,); M may be 0.

    progress:  receives each step in words
    advance:   receives the share done

    Raises InputError if a sample is not finite, or if the samples have no likelihood."""
    options = options or TrainingOptions()
    bad = ~np.isfinite(np.column_stack([inputs, features, y])).all(axis=1)
    if bad.any():
        raise InputError(f"sample {int(np.argmax(bad))}: got a value that is not a finite number")
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
    return Training(scale.plain(posterior.hyper(best)), tuple(value for value, _ in found), refined, len(many))


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
        self._data, self._terms, self._family = data, terms, family
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
        value, slopes = log_likelihood(h, *self._data)
        logs = q[: self._lengths]
        off = (logs - LOG_SCALE) / LOG_WIDTH
        prior = -logs - 0.5 * off**2 - math.log(LOG_WIDTH * math.sqrt(2.0 * math.pi))
        by_length = np.concatenate(slopes.lengthscales) * np.exp(logs) - 1.0 - off / LOG_WIDTH
        others = [*slopes.variances, slopes.noise, *slopes.weights] * np.exp(q[self._lengths :])
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
        minimize(loss, q, jac=True, method="L-BFGS-B", bounds=[(-STEP, STEP)] * len(q), options=limits)
        advance(1, 1)
        return reached, best
