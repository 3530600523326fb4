"""Gaussian processes for a rig: what the effects of a fitted model leave over, ring by ring.

The model comes from `identification` (kind pi): stage, camera delay, effects. For sp the linear part of the process
corrects the effects, which keep their names and units, and the rest stays with the process; for np the process stands
in for the effects. Rates and accelerations are smoothed (what a state is, for the planner); the tilt is as late as
the camera is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from mazeplan.data.smoothing import Smoothing
from mazeplan.data.split import block_split, uniform_downsample
from mazeplan.data.table import Table
from mazeplan.errors import TableError
from mazeplan.maze.geometry import Maze
from mazeplan.models.features import DRY_WIDTH, PLANNED_TERMS, effect_features, inputs
from mazeplan.models.fitting import FitOptions, honest_noise
from mazeplan.models.gaussian_process import GaussianProcess, Hyperparameters
from mazeplan.models.gp_training import Training, train
from mazeplan.models.modelfile import RigModel
from mazeplan.models.processfile import rounded
from mazeplan.models.samples import RingSamples, SampleOptions, ring_samples
from mazeplan.physics.arrays import RingKinematics, acceleration, kinematic_terms
from mazeplan.physics.ball import dry_friction, rolling_inertia, tilt_offset, viscous_friction
from mazeplan.physics.ball_model import BallModel
from mazeplan.progress import Advance, Words, no_advance, no_words, piece
from mazeplan.records import Array

MOST_FRICTION = 20.0  # 1/s and rad/s^2; what effects allow
FEWEST = 300  # samples; a ring with less has no process
SMOOTHING = Smoothing("rts", model="snap")
TRAINED = 0.8  # of the time that a ring takes: then its process is conditioned


@dataclass(frozen=True)
class RingLearning:
    """How a ring was learned: training rows, nRMSE of theta_dd on test blocks by effects alone and with the process."""

    rows: int
    before: float
    after: float
    training: Training


def learn_processes(
    table: Table,
    maze: Maze,
    model: RigModel,
    kind: str,
    options: FitOptions | None = None,
    *,
    smoothing: Smoothing = SMOOTHING,
    progress: Words | None = None,
    advance: Advance | None = None,
) -> tuple[RigModel, dict[int, RingLearning]]:
    """The model with processes of kind sp or np for all rings of which there are enough samples, and their scores.
    Raises TableError when there is no such ring."""
    options, tell, advance = options or FitOptions(), progress or no_words, advance or no_advance
    found = ring_samples(table, maze, smoothing, SampleOptions(delay=model.camera_delay, recompute=True))
    balls, processes, learned = dict(model.balls), {}, {}
    enough = {ring: samples for ring, samples in sorted(found.items()) if int(samples.good.sum()) >= FEWEST}
    for i, (ring, samples) in enumerate(enough.items()):

        def report(text: str, ring: int = ring) -> None:
            tell(f"ring {ring}: {text}")

        balls[ring], processes[ring], learned[ring] = _learn_ring(
            samples, model.ball(ring), kind, options, report, piece(advance, i, 1, len(enough))
        )
    if not processes:
        problem = f"in no ring are there {FEWEST} samples, which kind {kind} needs; record more, or learn kind pi"
        raise TableError(problem, file=table.source.get("file"))
    scores = {
        **model.scores,
        "smoothing": {"method": smoothing.method, "model": smoothing.model},
        "nrmse_test_effects": {f"ring{ring}": round(x.before, 4) for ring, x in learned.items()},
        f"nrmse_test_{kind}": {f"ring{ring}": round(x.after, 4) for ring, x in learned.items()},
    }
    return replace(model, kind=kind, balls=balls, processes=processes, scores=scores), learned


def _learn_ring(
    samples: RingSamples, ball: BallModel, kind: str, options: FitOptions, tell: Words, advance: Advance
) -> tuple[BallModel, GaussianProcess, RingLearning]:
    """Hyperparameters and scores from a split of the record, the process itself from all of it."""
    split = block_split(samples.segment, samples.dt, block_s=5.0, test_share=0.25, guard=8)
    rows = np.flatnonzero(split.train & samples.good)
    rows = rows[uniform_downsample(len(rows), options.most)]
    k, target = samples.at(rows), samples.theta_ddot[rows]
    base = planned(ball, k) if kind == "sp" else kinematic_terms(k)
    features = effect_features(k) if kind == "sp" else np.zeros((len(rows), 0))
    chosen = replace(options.training, seed=options.seed, terms=PLANNED_TERMS)
    training = train(
        inputs(k), features, target - base, chosen, progress=tell, advance=piece(advance, 0.0, TRAINED, 1.0)
    )
    hyper = honest_noise(training, inputs(k), features, target - base)
    if kind == "sp":
        hyper = replace(hyper, weight_sigma=_known(ball, hyper.weight_sigma))
    better, process = _condition(k, target, ball, kind, hyper)
    held = np.flatnonzero(split.test & samples.good)
    kt, truth, spread = samples.at(held), samples.theta_ddot[held], float(np.std(samples.theta_ddot[held]))
    predicted = (planned(better, kt) if kind == "sp" else kinematic_terms(kt)) + process.mean(inputs(kt))
    scores = [float(np.sqrt(np.mean((truth - p) ** 2))) / spread for p in (ball.acceleration(kt), predicted)]
    tell("conditioning on the whole record")
    every = np.flatnonzero(samples.good)
    every = every[uniform_downsample(len(every), options.most)]
    better, process = _condition(samples.at(every), samples.theta_ddot[every], ball, kind, hyper)
    advance(1.0, 1.0)
    return better, process, RingLearning(len(every), scores[0], scores[1], training)


def _known(ball: BallModel, trained: Array) -> Array:
    """Prior deviations (5,) of the corrections to effects: the standard errors with which they were identified, or what
    the training found where those are not known.

    Identification integrates the motion over stretches without impacts; smoothed accelerations, which a process is
    trained on, have all impacts in them. Left free, friction would come out too large by half."""
    factor = ball.parameter("rolling_inertia", "factor", 1.0)
    sigma = [
        ball.stderr.get(effect, {}).get(parameter, math.inf) * scale
        for effect, parameter, scale in (
            ("rolling_inertia", "factor", 1.0),
            ("viscous_friction", "coefficient", 1.0),
            ("dry_friction", "coefficient", 1.0),
            ("tilt_offset", "beta", factor),
            ("tilt_offset", "gamma", factor),
        )
    ]
    return np.minimum(trained, sigma)


def _condition(
    k: RingKinematics, target: Array, ball: BallModel, kind: str, h: Hyperparameters
) -> tuple[BallModel, GaussianProcess]:
    """Effects corrected by the linear part, and the process of what they leave, on inputs as the file holds them."""
    x = rounded(inputs(k))
    alone = replace(h, weight_sigma=np.zeros(0))
    none = np.zeros((len(x), 0))
    if kind == "np":
        return ball, GaussianProcess.condition(alone, x, none, target - kinematic_terms(k))
    whole = GaussianProcess.condition(h, x, effect_features(k), target - planned(ball, k))
    better = corrected(ball, whole.weights, np.sqrt(np.diag(whole.covariance)))
    return better, GaussianProcess.condition(alone, x, none, target - planned(better, k))


def planned(ball: BallModel, k: RingKinematics) -> Array:
    """theta_dd (N,) of the effects as the planner has them: dry friction with tanh for the sign."""
    return acceleration(ball.planned, k, DRY_WIDTH)


def corrected(ball: BallModel, weights: Array, sigma: Array) -> BallModel:
    """The ball with its effects changed by the weights of their features (5,), each within what is physically possible;
    sigma (5,): their deviations."""
    factor = float(np.clip(ball.parameter("rolling_inertia", "factor", 1.0) + weights[0], 0.05, 1.5))
    viscous, dry = (
        float(np.clip(ball.parameter(name, "coefficient", 0.0) + weight, 0.0, MOST_FRICTION))
        for name, weight in (("viscous_friction", weights[1]), ("dry_friction", weights[2]))
    )
    offset = [
        ball.parameter("tilt_offset", axis, 0.0) + float(w) / factor
        for axis, w in (("beta", weights[3]), ("gamma", weights[4]))
    ]
    stderr = {
        "rolling_inertia": {"factor": float(sigma[0])},
        "viscous_friction": {"coefficient": float(sigma[1])},
        "dry_friction": {"coefficient": float(sigma[2])},
        "tilt_offset": {"beta": float(sigma[3]) / factor, "gamma": float(sigma[4]) / factor},
    }
    asymmetry = ball.parameter("dry_friction", "asymmetry", 0.0)
    effects = (rolling_inertia(factor), viscous_friction(viscous), dry_friction(dry, asymmetry), tilt_offset(*offset))
    kept = tuple(e for e in ball.effects if e.name not in stderr)
    return BallModel((*effects, *kept), {**ball.stderr, **stderr})
