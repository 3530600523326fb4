"""Fit any kind of ball model to the samples of a ring; np and sp also with heavy-tailed noise.

| kind | model of theta_dd |
|---|---|
| p | the ball's equation, of a point that slides |
| pi | the terms of the equation, each with a fitted weight: Bayesian linear regression |
| np | Gaussian process on the local inputs |
| sp | Gaussian process with an additional linear kernel on the wall features |
| rf | random forest on the nine inputs (scikit-learn) |
| npd | Gaussian processes on the discrete map x_k -> x_{k+1}, without an equation of motion: the counter-example |

np and sp learn the difference to `kinematic_terms`: the part due to the motion of the plate, without gravity. The map
of npd is nearly the identity, and its error adds up with each step.

Linear regression: the marginal likelihood (evidence) determines prior and noise of y = Phi w + e, e ~ N(0, s^2),
w ~ N(0, diag(1 / a)). a (one for each feature) and s follow from the fixed-point rules of MacKay, "Bayesian
interpolation", Neural Computation 1992. Features without influence get a weight of zero.

Heavy tails: Student's t noise in place of normal noise.

    y_i = f(x_i) + e_i,  e_i = s t_i,  t with nu degrees of freedom: normal of variance s^2 / lambda_i, lambda_i random
    z_i = (y_i - f_i) / spread,        f_i without row i and its neighbours; nu and spread by maximum likelihood
    s_i^2 = s^2 (nu + z_i^2) / (nu + 1)

At the edge of an opening, a ball is thrown back or not, and no input of a model tells which. For squared errors, the
mean of both outcomes is the best prediction. Roll-outs are scored by absolute errors and need the typical acceleration:
a few impacts must not change the prediction for all states nearby. s_i^2 is one step of expectation maximisation
(Lange, Little, Taylor, "Robust Statistical Modeling Using the t Distribution", JASA 84, 1989). On measured data, a
second step changed nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from mazeplan.core.maths.angles import nearest
from mazeplan.core.progress import Advance, Words, no_advance, no_words
from mazeplan.core.records import Array, IntArray
from mazeplan.learning.features import LOCAL_TERMS, inputs, local_inputs, paper_features, wall_features
from mazeplan.learning.gaussian_process import GaussianProcess, Hyperparameters
from mazeplan.learning.gp_training import TrainingOptions, train
from mazeplan.learning.rollout import STEPS, Accelerate, Rollout
from mazeplan.learning.samples import RingSamples, pick
from mazeplan.learning.split import uniform_downsample
from mazeplan.physics.ball_model import BallModel, RingKinematics, kinematic_terms
from mazeplan.physics.effects.ball import rolling_inertia

KINDS = ("rf", "p", "pi", "np", "sp")
MAX_ROWS = 5000  # maximum number of training rows of a Gaussian process
TREES, LEAF = 100, 5  # number of trees; minimum samples in a leaf, because a forest with fewer learns the noise
EXAMINED_ROWS = 1000  # maximum number of rows of the Gaussian process whose residuals are examined
LAGS, SHORT = 30, 0.1  # maximum lag, rows; share of the power below which residuals count as uncorrelated
FREEDOM = (1.0, 30.0)  # bounds of nu; measured rings have 2 to 3, simulated ones 5 to 7
FOLDS, BLOCK = 4, 10  # number of folds; rows of a block, because smoothing spreads an impact over its neighbours
ROUNDS = 200
PRECISION_TOLERANCE = 1e-6  # relative change of the precisions that ends the rounds
SMALLEST = 1e-100  # minimum of a divisor
DIGITS = 1e-14  # share of the target's square; a smaller rest is rounding
LARGEST = 1e12  # maximum precision, in units of the scaled feature; the weight is then practically zero


@dataclass(frozen=True)
class FitOptions:
    """Settings of a fit.

    most:      maximum number of training rows of a Gaussian process, evenly spread
    training:  settings for the hyperparameters
    seed:      for forest and starts"""

    most: int = MAX_ROWS
    training: TrainingOptions = field(default_factory=TrainingOptions)
    seed: int = 0


@dataclass(frozen=True)
class Fitted:
    """A fitted model: its expectation of theta_dd, and what is typical: of np and sp, the expectation with heavy
    tails."""

    mean: Accelerate
    typical: Accelerate


def fit_kind(
    kind: str, samples: RingSamples, rows: IntArray, options: FitOptions | None = None, *,
    progress: Words = no_words, advance: Advance = no_advance,
) -> Fitted:  # fmt: skip
    """Fit a kind of model, one of KINDS, to the training rows (indices into the samples)."""
    options = options or FitOptions()
    k, target = samples.at(rows), samples.theta_ddot[rows]
    if kind in ("np", "sp"):
        return _fit_gaussian(kind, k, target, options, progress, advance)
    if kind == "p":
        mean = BallModel((rolling_inertia(1.0),)).acceleration
    else:
        mean = _linear(k, target) if kind == "pi" else _forest(k, target, options.seed)
    return Fitted(mean, mean)


def _linear(k: RingKinematics, target: Array) -> Accelerate:
    weights = fit_linear(paper_features(k), target)
    return lambda k: paper_features(k) @ weights


def _forest(k: RingKinematics, target: Array, seed: int) -> Accelerate:
    from sklearn.ensemble import RandomForestRegressor

    forest = RandomForestRegressor(TREES, min_samples_leaf=LEAF, max_features=0.5, random_state=seed, n_jobs=1)
    forest.fit(inputs(k), target)
    return lambda k: np.asarray(forest.predict(inputs(k)), dtype=float)


def _fit_gaussian(
    kind: str, k: RingKinematics, target: Array, options: FitOptions, progress: Words, advance: Advance
) -> Fitted:
    """Train and condition a Gaussian process on at most `options.most` rows, without and with heavy tails."""

    def features(k: RingKinematics) -> Array:
        return wall_features(k) if kind == "sp" else np.zeros((len(k.theta), 0))

    def predicted_by(process: GaussianProcess) -> Accelerate:
        return lambda k: kinematic_terms(k) + process.mean(local_inputs(k), features(k))

    picked = uniform_downsample(len(target), options.most)
    x, phi, y = local_inputs(k)[picked], features(k)[picked], (target - kinematic_terms(k))[picked]
    chosen = replace(options.training, seed=options.seed, terms=LOCAL_TERMS)
    hyper = train(x, phi, y, chosen, progress=progress, advance=advance)
    progress(f"conditioning on {len(picked)} rows")
    process = GaussianProcess.condition(inflate_noise(hyper, x, phi, y), x, phi, y)
    return Fitted(predicted_by(process), predicted_by(typical(process, y)))


def inflate_noise(hyper: Hyperparameters, x: Array, phi: Array, target: Array) -> Hyperparameters:
    """The hyperparameters with a larger noise, because neighbouring residuals are correlated.

    Smoothing spreads noise and impacts over neighbouring rows. If rows counted as independent, each disturbance would
    count several times. The residuals are those of a Gaussian process on at most EXAMINED_ROWS of the rows."""
    own = uniform_downsample(len(target), min(EXAMINED_ROWS, len(target) // 3))
    process = GaussianProcess.condition(hyper, x[own], phi[own], target[own])
    left = target - process.mean(x, phi)
    left[own] = np.nan
    return replace(hyper, noise=hyper.noise * math.sqrt(correlation_time(left)))


def correlation_time(left: Array) -> float:
    """How many of the residuals (..., N) count as one independent residual, by their autocorrelation; at least 1.

    NaN marks an unknown residual."""
    power, repeats = float(np.nanmean(left**2)) if left.size else 0.0, 1.0
    for lag in range(1, LAGS):
        share = float(np.nanmean(left[..., lag:] * left[..., :-lag])) / power if power > 0.0 else 0.0
        if not share > SHORT:
            break
        repeats += 2.0 * share
    return repeats


def typical(process: GaussianProcess, y: Array) -> GaussianProcess:
    """The Gaussian process conditioned again on its values y (N,), in order of time, with heavy tails."""
    noise = row_noise(process.hyper, process.inputs, process.features, y)
    return GaussianProcess.condition(process.hyper, process.inputs, process.features, y, noise)


def row_noise(hyper: Hyperparameters, x: Array, phi: Array, y: Array) -> Array:
    """Standard deviation (N,) of the noise of each row, in units of y, for inputs x (N, D), features phi (N, M) and
    values y (N,), in order of time; M may be 0."""
    left = cross_residuals(hyper, x, phi, y)
    if not np.any(left):  # an exact fit has no tails
        return np.full(len(y), hyper.noise)
    from scipy import stats  # slow to import

    found, _, spread = stats.t.fit(left, floc=0.0)
    nu = float(np.clip(found, *FREEDOM))
    return hyper.noise * np.sqrt((nu + (left / spread) ** 2) / (nu + 1.0))


def cross_residuals(hyper: Hyperparameters, x: Array, phi: Array, y: Array) -> Array:
    """Residual (N,) of each row, in units of y, from a Gaussian process on EXAMINED_ROWS rows of the other folds."""
    n = len(y)
    fold = np.arange(n) // max(1, min(BLOCK, n // FOLDS)) % FOLDS
    left = y.copy()
    for own in range(FOLDS):
        mine, others = np.flatnonzero(fold == own), np.flatnonzero(fold != own)
        if len(mine) and len(others):
            some = others[uniform_downsample(len(others), EXAMINED_ROWS)]
            process = GaussianProcess.condition(hyper, x[some], phi[some], y[some])
            left[mine] -= process.mean(x[mine], phi[mine])
    return left


def fit_linear(features: Array, target: Array) -> Array:
    """Weights (M,) of features (N, M) for a target (N,). Raises ValueError if there are no more rows than features."""
    n, m = features.shape
    if n <= m:
        raise ValueError(f"got {n} samples, expected more than {m}")
    scale = np.sqrt(np.mean(features**2, axis=0))
    scale = np.where(scale > 0.0, scale, 1.0)
    X = features / scale
    gram, moment, power = X.T @ X, X.T @ target, float(target @ target)
    precision, noise = np.ones(m) / max(float(np.var(target)), SMALLEST), max(0.1 * power / n, SMALLEST)
    mean = np.zeros(m)
    for _ in range(ROUNDS):
        covariance = np.linalg.inv(gram / noise + np.diag(precision))
        mean = covariance @ moment / noise
        known = 1.0 - precision * np.diag(covariance)  # 1 for a weight that the data determine
        before = precision
        precision = np.minimum(np.maximum(known, 1e-12) / np.maximum(mean**2, SMALLEST), LARGEST)
        rest = max(power - 2.0 * float(mean @ moment) + float(mean @ gram @ mean), DIGITS * power)
        noise = max(rest / max(n - float(known.sum()), 1.0), SMALLEST)
        if np.max(np.abs(np.log(precision / before))) < PRECISION_TOLERANCE:
            break
    return mean / scale


@dataclass(frozen=True)
class DiscreteMap:
    """Gaussian processes for sin theta, cos theta and theta_dot, one sample later."""

    sine: GaussianProcess
    cosine: GaussianProcess
    rate: GaussianProcess

    def next(self, k: RingKinematics) -> tuple[Array, Array]:
        """Angle (on the turn of the present one) and rate (N,) one sample later."""
        x = inputs(k)
        angle = np.arctan2(self.sine.mean(x), self.cosine.mean(x))
        return nearest(angle, k.theta), self.rate.mean(x)


def fit_discrete(samples: RingSamples, rows: IntArray, options: FitOptions) -> DiscreteMap:
    """Fit the map to pairs of neighbouring training rows."""
    following = np.append(samples.good[1:] & (samples.segment[1:] == samples.segment[:-1]), False)
    rows = rows[following[rows]]
    rows = rows[uniform_downsample(len(rows), options.most)]
    x, none = inputs(samples.at(rows)), np.zeros((len(rows), 0))
    theta = samples.k.theta[rows + 1]
    training = TrainingOptions(starts=1, seed=options.seed)

    def process(target: Array) -> GaussianProcess:
        return GaussianProcess.condition(train(x, none, target, training), x, none, target)

    return DiscreteMap(process(np.sin(theta)), process(np.cos(theta)), process(samples.k.theta_dot[rows + 1]))


def roll_out_discrete(
    model: DiscreteMap, samples: RingSamples, start: IntArray, theta: Array, theta_dot: Array
) -> Rollout:
    """Roll the map out from (theta, theta_dot) (W,) at rows `start` along the measured tilt."""
    angle, rate = np.empty((len(start), STEPS + 1)), theta_dot
    angle[:, 0] = theta
    for i in range(STEPS):
        k = replace(pick(samples.k, start + i), theta=angle[:, i], theta_dot=rate)
        angle[:, i + 1], rate = model.next(k)
    return Rollout.against(angle, samples.k.theta, start)
