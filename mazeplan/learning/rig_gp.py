"""Gaussian processes for a rig: the residual of the effects of a fitted model, ring by ring.

The model comes from `identification` (kind pi). For sp, the linear part of the Gaussian process corrects the effects,
which keep their names and units; the Gaussian process takes the rest. For np, the Gaussian process replaces the
effects. Rates and accelerations are smoothed, because a planner needs the rate of a state. The tilt is delayed like the
camera.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mazeplan.core.errors import TableError
from mazeplan.core.logs.table import Table
from mazeplan.core.progress import Advance, Words, led_by, no_advance, no_words, piece
from mazeplan.core.records import Array
from mazeplan.learning.features import DRY_WIDTH, EFFECTS, PLANNED_TERMS, effect_features, inputs
from mazeplan.learning.fitting import FitOptions, inflate_noise
from mazeplan.learning.gaussian_process import GaussianProcess, Hyperparameters
from mazeplan.learning.gp_file import rounded
from mazeplan.learning.gp_training import train
from mazeplan.learning.identification import effect_ball
from mazeplan.learning.rig_model import RigModel
from mazeplan.learning.samples import RingSamples, SampleOptions, ring_samples
from mazeplan.learning.smoothing import Smoothing
from mazeplan.learning.split import block_split, uniform_downsample
from mazeplan.maze.geometry import Maze
from mazeplan.physics.ball_model import BallModel, RingKinematics, acceleration, kinematic_terms

MOST_FRICTION = 20.0  # 1/s and rad/s^2; upper bound of the effects
MIN_SAMPLES = 300  # samples; a ring with fewer gets no learned part
SMOOTHING = Smoothing("rts", model="snap")
TRAINED = 0.8  # share of the training in the duration of a ring


def learn_processes(
    table: Table,
    maze: Maze,
    model: RigModel,
    kind: str,
    options: FitOptions | None = None,
    *,
    progress: Words = no_words,
    advance: Advance = no_advance,
) -> RigModel:
    """The model with Gaussian processes for each ring with enough samples, and their nRMSE of theta_dd on test blocks.

    A ring keeps the effects alone if they predict these blocks better; without any learned part, the kind is pi.

    kind:       np or sp
    progress:   receives each step in words
    advance:    receives the share done

    Raises TableError if no ring has enough samples."""
    options = options or FitOptions()
    found = ring_samples(table, maze, SMOOTHING, SampleOptions(delay=model.camera_delay, recompute=True))
    balls, processes, errors = dict(model.balls), {}, {}
    enough = {ring: samples for ring, samples in sorted(found.items()) if int(samples.good.sum()) >= MIN_SAMPLES}
    for i, (ring, samples) in enumerate(enough.items()):
        words, share = led_by(f"ring {ring}: ", progress), piece(advance, i, 1, len(enough))
        parts = _learn_ring(samples, model.ball(ring), kind, options, words, share)
        balls[ring], processes[ring], errors[ring] = parts
    if not processes:
        problem = f"in no ring are there {MIN_SAMPLES} samples, which kind {kind} needs; record more, or learn kind pi"
        raise TableError(problem, file=table.place)
    scores = {
        **model.scores,
        "smoothing": {"method": SMOOTHING.method, "model": SMOOTHING.model},
        "nrmse_test_effects": {f"ring{ring}": round(alone, 4) for ring, (alone, _) in errors.items()},
        f"nrmse_test_{kind}": {f"ring{ring}": round(after, 4) for ring, (_, after) in errors.items()},
    }
    if kind == "sp":
        processes = {ring: part for ring, part in processes.items() if errors[ring][1] <= errors[ring][0]}
    return replace(model, kind=kind if processes else "pi", balls=balls, processes=processes, scores=scores)


def _learn_ring(
    samples: RingSamples, ball: BallModel, kind: str, options: FitOptions, progress: Words, advance: Advance
) -> tuple[BallModel, GaussianProcess, tuple[float, float]]:
    """Learn one ring: hyperparameters from a split of the record, the Gaussian process from all of it; and the nRMSE on
    the other rows, by the effects alone and with the learned part."""
    split = block_split(samples.segment, samples.dt, block_s=5.0, test_share=0.25, guard=8)
    rows = np.flatnonzero(split.train & samples.good)
    rows = rows[uniform_downsample(len(rows), options.most)]
    k, target = samples.at(rows), samples.theta_ddot[rows]
    x, rest = inputs(k), target - (planned(ball, k) if kind == "sp" else kinematic_terms(k))
    features = effect_features(k) if kind == "sp" else np.zeros((len(rows), 0))
    chosen = replace(options.training, seed=options.seed, terms=PLANNED_TERMS)
    hyper = train(x, features, rest, chosen, progress=progress, advance=piece(advance, 0.0, TRAINED, 1.0))
    hyper = inflate_noise(hyper, x, features, rest)
    if kind == "sp":  # the prior of a correction is no wider than the standard error of its effect, see `effect_sigma`
        hyper = replace(hyper, weight_sigma=np.minimum(hyper.weight_sigma, effect_sigma(ball, math.inf)))
    better, process = _condition(k, target, ball, kind, hyper)
    held = np.flatnonzero(split.test & samples.good)
    kt, truth, spread = samples.at(held), samples.theta_ddot[held], float(np.std(samples.theta_ddot[held]))
    predicted = (planned(better, kt) if kind == "sp" else kinematic_terms(kt)) + process.mean(inputs(kt))
    alone, after = (float(np.sqrt(np.mean((truth - p) ** 2))) / spread for p in (ball.acceleration(kt), predicted))
    progress("conditioning on the whole record")
    every = np.flatnonzero(samples.good)
    every = every[uniform_downsample(len(every), options.most)]
    better, process = _condition(samples.at(every), samples.theta_ddot[every], ball, kind, hyper)
    advance(1.0, 1.0)
    return better, process, (alone, after)


def effect_sigma(ball: BallModel, unknown: float) -> Array:
    """Standard errors (5,) of the effects in the units of `effect_features`; `unknown` for missing ones.

    Identification integrates the motion over stretches without impacts. The smoothed accelerations for a Gaussian
    process contain all impacts: without this prior, the corrections would overestimate friction by half."""
    factor = ball.parameter("rolling_inertia", "factor", 1.0)
    found = [ball.stderr.get(effect, {}).get(name, unknown) for effect, name in (key.split(".") for key in EFFECTS)]
    return np.array(found) * [1.0, 1.0, 1.0, factor, factor]


def _condition(
    k: RingKinematics, target: Array, ball: BallModel, kind: str, h: Hyperparameters
) -> tuple[BallModel, GaussianProcess]:
    """Effects corrected by the linear part, and the Gaussian process for the rest, on inputs rounded as in the file."""
    x = rounded(inputs(k))
    alone = replace(h, weight_sigma=np.zeros(0))
    none = np.zeros((len(x), 0))
    if kind == "np":
        return ball, GaussianProcess.condition(alone, x, none, target - kinematic_terms(k))
    whole = GaussianProcess.condition(h, x, effect_features(k), target - planned(ball, k))
    better = corrected(ball, whole.weights, np.sqrt(np.diag(whole.covariance)))
    return better, GaussianProcess.condition(alone, x, none, target - planned(better, k))


def planned(ball: BallModel, k: RingKinematics) -> Array:
    """theta_dd (N,) of the effects as in the planner: dry friction has tanh in place of the sign."""
    return acceleration(ball.planned, k, DRY_WIDTH)


def corrected(ball: BallModel, weights: Array, sigma: Array) -> BallModel:
    """The ball with its effects changed by weights (5,) of `effect_features`, within physical bounds.

    sigma (5,): standard deviations of the weights. Other effects stay as they are."""
    factor = float(np.clip(ball.parameter("rolling_inertia", "factor", 1.0) + weights[0], 0.05, 1.5))
    friction = [
        float(np.clip(ball.parameter(name, "coefficient", 0.0) + weight, 0.0, MOST_FRICTION))
        for name, weight in (("viscous_friction", weights[1]), ("dry_friction", weights[2]))
    ]
    offset = [
        ball.parameter("tilt_offset", axis, 0.0) + float(weight) / factor
        for axis, weight in (("beta", weights[3]), ("gamma", weights[4]))
    ]
    per_unit = np.array([1.0, 1.0, 1.0, factor, factor])
    new = effect_ball([factor, *friction, *offset], sigma / per_unit, ball.parameter("dry_friction", "asymmetry", 0.0))
    kept = tuple(e for e in ball.effects if e.name not in new.stderr)
    return BallModel((*new.effects, *kept), {**ball.stderr, **new.stderr})
