"""Fit any kind of ball model to the samples of a ring."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from mazeplan.data.split import uniform_downsample
from mazeplan.errors import InputError
from mazeplan.models.features import FEATURES, INPUT_SETS, TERMS, inputs
from mazeplan.models.gaussian_process import GaussianProcess, Hyperparameters
from mazeplan.models.gp_training import Training, TrainingOptions, train
from mazeplan.models.heavy_tails import typical
from mazeplan.models.learned import AccelerationModel, ForestBall, GaussianBall, LinearBall, PhysicsBall
from mazeplan.models.linear import fit_linear
from mazeplan.models.samples import RingSamples
from mazeplan.physics.arrays import RingKinematics, kinematic_terms
from mazeplan.physics.ball import rolling_inertia
from mazeplan.physics.ball_model import BallModel
from mazeplan.progress import Advance, Words
from mazeplan.records import Array, IntArray

KINDS = ("rf", "p", "pi", "np", "sp")
MOST = 5000  # training rows of a process
TREES = 100
FEW = 1000  # rows of the process that is asked what it leaves over
LONGEST, SHORT = 30, 0.1  # rows, and share of the power below which neighbours have nothing in common
LEAF = 5  # samples in a leaf of the forest: fewer and it learns the noise


@dataclass(frozen=True)
class FitOptions:
    """most: training rows of a process, spread evenly; inputs: state (what a planner can use), or local (what predicts
    best); heavy_tails: what is typical, too (see `heavy_tails`); training: of its hyperparameters; seed: of forest and
    starts."""

    most: int = MOST
    inputs: str = "state"
    heavy_tails: bool = False
    training: TrainingOptions = field(default_factory=TrainingOptions)
    seed: int = 0


@dataclass(frozen=True)
class Fitted:
    """A model, for processes how its hyperparameters were found, and with heavy tails the same for what is typical."""

    model: AccelerationModel
    training: Training | None = None
    robust: AccelerationModel | None = None

    @property
    def typical(self) -> AccelerationModel:
        """What is judged by absolute errors: the robust model where there is one."""
        return self.model if self.robust is None else self.robust


def fit_kind(
    kind: str,
    samples: RingSamples,
    rows: IntArray,
    options: FitOptions | None = None,
    *,
    progress: Words | None = None,
    advance: Advance | None = None,
) -> Fitted:
    """The model of a kind for the training rows (indices into the samples). Raises InputError for an unknown kind."""
    options = options or FitOptions()
    k, target = samples.at(rows), samples.theta_ddot[rows]
    if kind == "p":
        return Fitted(PhysicsBall(BallModel((rolling_inertia(1.0),))))
    if kind == "pi":
        return Fitted(LinearBall(fit_linear(FEATURES["paper"](k), target)))
    if kind == "rf":
        return Fitted(ForestBall(fit_forest(inputs(k), target, options.seed)))
    if kind in ("np", "sp"):
        features = "" if kind == "np" else "effects" if options.inputs == "state" else "wall"
        rest = target - kinematic_terms(k)
        process, training = fit_process(k, rest, features, options, progress, advance=advance)
        model, robust = GaussianBall(process, features, options.inputs), None
        if options.heavy_tails:
            robust = replace(model, process=typical(process, rest[uniform_downsample(len(rest), options.most)]))
        return Fitted(model, training, robust)
    raise InputError(f"got kind {kind!r}, expected one of {', '.join(KINDS)}")


def fit_forest(x: Array, target: Array, seed: int) -> object:
    """scikit-learn's random forest."""
    from sklearn.ensemble import RandomForestRegressor

    forest = RandomForestRegressor(TREES, min_samples_leaf=LEAF, max_features=0.5, random_state=seed, n_jobs=1)
    return forest.fit(x, target)


def fit_process(
    k: RingKinematics,
    target: Array,
    features: str,
    options: FitOptions,
    progress: Words | None = None,
    *,
    odd: Array | None = None,
    advance: Advance | None = None,
) -> tuple[GaussianProcess, Training]:
    """A process for targets (N,) in states k, trained and conditioned on at most `options.most` rows of them; odd
    (N, E): further inputs behind those of the state, for all terms, that change their sign in a mirror."""
    picked = uniform_downsample(len(target), options.most)
    x, terms = INPUT_SETS[options.inputs](k)[picked], TERMS[options.inputs]
    if odd is not None:
        new = tuple(range(x.shape[1], x.shape[1] + odd.shape[1]))
        x = np.hstack([x, odd[picked]])
        terms = tuple((columns + new, flip + (-1.0,) * len(new) if flip else flip) for columns, flip in terms)
    phi = FEATURES[features](k)[picked] if features else np.zeros((len(picked), 0))
    training = train(
        x,
        phi,
        target[picked],
        replace(options.training, seed=options.seed, terms=terms),
        progress=progress,
        advance=advance,
    )
    if progress is not None:
        progress(f"conditioning on {len(picked)} rows")
    hyper = honest_noise(training, x, phi, target[picked])
    return GaussianProcess.condition(hyper, x, phi, target[picked]), training


def honest_noise(training: Training, x: Array, phi: Array, target: Array) -> Hyperparameters:
    """Hyperparameters whose noise counts what neighbouring rows have in common.

    What a process leaves over in one row it leaves over in the next ones too: smoothing spreads noise and impacts over
    rows. Taken as independent they would be believed as often as they are repeated. The autocorrelation of what is left
    in rows that had no part in it says how often: the noise variance is multiplied by as much."""
    own = uniform_downsample(len(target), min(FEW, len(target) // 3))
    process = GaussianProcess.condition(training.hyper, x[own], phi[own], target[own])
    left = target - process.mean(x, phi)
    left[own] = np.nan
    power, repeats = float(np.nanmean(left**2)), 1.0
    for lag in range(1, LONGEST):
        share = float(np.nanmean(left[lag:] * left[:-lag])) / power
        if not share > SHORT:
            break
        repeats += 2.0 * share
    return replace(training.hyper, noise=training.hyper.noise * math.sqrt(repeats))
