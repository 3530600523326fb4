"""A rig's model that learns between runs: what changed of friction and gravity, and what the effects leave over.

Each ring has an `OnlineProcess`. Its first rows are those that the model was learned from, as what its effects left
over, and they have age 0; later rows are what the effects of the *first* model leave over of them. So the weights of
the features say by how much the effects have changed since, and the process says the rest. A model without processes
begins with none, on its effects as they are, with hyperparameters about as the packaged models have them.

The clock by which rows age goes by one of PACES from run to run: by that under which the rows of the new run, of all
rings together, are the likeliest, a long step being thought less likely beforehand. A model of a rig that stays as it
is thus keeps what it knows, and that of one that changes forgets within a run or two.

A row enters as `learn` would take it from the log, but for three kinds. Where the ball rests, friction is anything up
to its coefficient: no equation of the motion. At the ends of a stretch, of which a run has many, the smoothing is a
guess: accelerations scatter three times as much there. And what is further than MISFIT deviations from what was
expected is an impact: it says nothing of the floor.

The model of before goes along. Rows are predicted by both before they are learned, and where the one that learns was
the worse over the last WATCHED runs, the other one is the model until that has changed.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mazeplan.data.table import Table
from mazeplan.errors import InputError, ModelError, SettingsError
from mazeplan.maze.geometry import Maze
from mazeplan.models.features import PLANNED_TERMS, effect_features, inputs
from mazeplan.models.gaussian_process import JITTER, Hyperparameters, Term, kernel
from mazeplan.models.modelfile import RigModel
from mazeplan.models.online import SCORES, OnlineProcess, Walk
from mazeplan.models.processfile import rounded
from mazeplan.models.rig_learning import MOST_FRICTION, SMOOTHING, corrected, planned
from mazeplan.models.samples import RingSamples, SampleOptions, ring_samples
from mazeplan.physics.arrays import RingKinematics, kinematic_terms
from mazeplan.physics.ball import dry_friction, tilt_offset, viscous_friction
from mazeplan.physics.ball_model import BallModel
from mazeplan.records import Array, IntArray

# medians over rings and packaged models; amplitude and noise times the radius of the track, m/s^2, rate times it, m/s
LENGTHS = (0.044, 0.37, 0.39, 0.45, 0.24, 0.034, 0.046)  # of PLANNED_TERMS
AMPLITUDE, NOISE = 0.043, 0.073  # half of the median amplitude: what effects can explain is theirs
PACES = ((0.05, 0.99), (1.0, 1e-2), (9.0, 1e-5))  # units of the clock from run to run, and how likely beforehand
RESTING = 0.15  # rad/s; slower than this the sign of dry friction is not sure
ENDS = 2  # samples at either end of a stretch
MISFIT = 4.0  # deviations
WATCHED, WORSE = 5, 1.1  # runs, and how much more error, squared, in the mean over them is worse
FEWEST = 400  # rows of a ring, at least, that are kept
FIXED = ("rolling_inertia", "viscous_friction", "dry_friction", "tilt_offset")  # what features stand for


@dataclass(frozen=True)
class OnlineOptions:
    """How fast a rig may change, deviations of the step in a unit of the clock: factor, of gravity; viscous, 1/s;
    dry, m/s^2 along the track; tilt, rad; process: variance of the rest, over its own. most: rows kept of each ring,
    None: as many as the model was learned from; keep: how they are chosen, a name of `SCORES`. Raises SettingsError."""

    factor: float = 5e-4
    viscous: float = 0.01
    dry: float = 0.02
    tilt: float = 5e-5
    process: float = 5e-3
    most: int | None = None
    keep: str = "novelty"

    def __post_init__(self) -> None:
        for name in ("factor", "viscous", "dry", "tilt", "process"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise SettingsError(f"got {getattr(self, name)!r}, expected a finite number >= 0", key=name)
        if self.most is not None and self.most < 1:
            raise SettingsError(f"got {self.most!r}, expected a whole number >= 1", key="most")
        if self.keep not in SCORES:
            raise SettingsError(f"got {self.keep!r}, expected one of {', '.join(SCORES)}", key="keep")

    def walk(self, kind: str, radius: float) -> Walk:
        """Of a ring; radius: m."""
        steps = [] if kind == "np" else [self.factor, self.viscous, self.dry / radius, self.tilt, self.tilt]
        return Walk(self.process, np.array(steps))


@dataclass(frozen=True)
class Lesson:
    """What one run taught. run: its number, from 1; rows: taken, by ring; impacts: left out; why: not learned from,
    empty where it was; error, fixed: rms of what model and first model expected of these rows before they were
    learned, m/s^2 along the track, NaN without rows; pace: by which the clock went on; trusted: whether the model that
    learned is used in the next."""

    run: int
    rows: dict[int, int] = field(default_factory=dict)
    impacts: int = 0
    why: str = ""
    error: float = math.nan
    fixed: float = math.nan
    pace: float = 0.0
    trusted: bool = True


class OnlineModel:
    """A model that learns. start: the model to begin with; maze: whose rings are those of the model. Raises InputError
    for a model that cannot learn."""

    def __init__(self, start: RigModel, maze: Maze, options: OnlineOptions | None = None) -> None:
        if not start.delay_known:
            advice = "fit one with `mazeplan collect` and `mazeplan learn --kind pi`, and give it with --model"
            raise InputError(f"nominal physics do not tell how late the camera is, so nothing can be learned: {advice}")
        self.start, self.maze, self.options = start, maze, options or OnlineOptions()
        self.kind = start.kind if start.kind in ("np", "sp") else "sp"
        self.now, self.clock = 0, 0.0
        self.rings: dict[int, OnlineProcess] = {}
        self.watched: deque[tuple[float, float]] = deque(maxlen=WATCHED)
        for ring in maze.rings:
            if not ring.is_disc and (self.kind == "sp" or ring.number in start.processes):
                self.rings[ring.number] = self._beginning(ring.number)
        if not self.rings:
            raise InputError("the model has no process for any ring of the map, so nothing can be learned")

    def _beginning(self, ring: int) -> OnlineProcess:
        process, radius = self.start.processes.get(ring), self.maze.track_radius(ring)
        walk = self.options.walk(self.kind, radius)
        if process is None:
            return OnlineProcess.begin(usual(radius), walk)
        h, x = process.hyper, process.inputs
        own = process.alpha * (h.noise**2 + JITTER * h.only.amplitude**2)
        y = kernel(x, x, h) @ process.alpha + own  # what it was conditioned on: C alpha
        features = _features(x, radius)[:, : len(walk.weights)]
        return OnlineProcess.begin(h, walk).added(x, features, y, np.zeros(len(y)))

    @property
    def trusted(self) -> bool:
        """Whether what was learned has not been worse than the first model."""
        sums = np.sum(self.watched, axis=0) if self.watched else np.zeros(2)
        return bool(sums[0] <= WORSE * sums[1])

    @property
    def model(self) -> RigModel:
        """The model as it is now: the first one where what was learned is not trusted."""
        return self.learned if self.trusted and self.now else self.start

    @property
    def learned(self) -> RigModel:
        """What was learned, trusted or not. Raises ModelError where it is no number."""
        balls, processes = {r.number: self.start.ball(r.number) for r in self.maze.rings}, {}
        balls |= self.start.balls
        for ring, rows in self.rings.items():
            weights, covariance = rows.weights(self.clock)
            if not np.isfinite(weights).all():
                raise ModelError(f"ring {ring}: the weights came out as no numbers")
            if len(weights):
                balls[ring] = _changed(balls[ring], weights, np.diag(covariance))
            if len(rows):
                processes[ring] = rows.process(self.clock)
        if self.kind == "sp":
            for ring in self.maze.rings:
                if ring.number not in self.rings:  # a disc: no row of it can be learned
                    balls[ring.number] = self._as_near(ring.number, balls)
        kind = self.kind if processes else self.start.kind
        told = {"runs": self.now, "rows": {f"ring{ring}": len(rows) for ring, rows in self.rings.items()}}
        scores = {**self.start.scores, "learned_while_running": told}
        return replace(self.start, kind=kind, balls=balls, processes=processes, scores=scores)

    def _as_near(self, ring: int, balls: dict[int, BallModel]) -> BallModel:
        """The ball of a ring of which nothing can be learned: floor and table have changed there as in the nearest."""
        near = min(self.rings, key=lambda number: abs(number - ring))
        place, ball, before = self.maze.ring(ring), balls[ring], self.start.ball(near)
        scale = self.maze.track_radius(near) / max(place.track_radius, 0.5 * place.outer_radius)

        def change(effect: str, parameter: str) -> float:
            return balls[near].parameter(effect, parameter, 0.0) - before.parameter(effect, parameter, 0.0)

        dry = ball.parameter("dry_friction", "coefficient", 0.0) + scale * change("dry_friction", "coefficient")
        viscous = ball.parameter("viscous_friction", "coefficient", 0.0)
        viscous += change("viscous_friction", "coefficient")
        tilt = [ball.parameter("tilt_offset", a, 0.0) + change("tilt_offset", a) for a in ("beta", "gamma")]
        viscous, dry = (min(max(c, 0.0), MOST_FRICTION) for c in (viscous, dry))
        asymmetry = ball.parameter("dry_friction", "asymmetry", 0.0)
        new = (viscous_friction(viscous), dry_friction(dry, asymmetry), tilt_offset(*tilt))
        kept = tuple(e for e in ball.effects if e.name not in FIXED[1:])
        return BallModel((*kept, *new), ball.stderr)

    # -- a run ---------------------------------------------------------------------------------------------------------

    def skipped(self, why: str) -> Lesson:
        """A run of which nothing is learned."""
        self.now += 1
        return Lesson(self.now, why=why, trusted=self.trusted)

    def learn(self, table: Table, camera_delay: float | None = None) -> Lesson:
        """Learn from the record of a run that has ended. camera_delay: s, where it was measured of the rig. Nothing is
        changed by a record of which nothing can be learned."""
        delay = self.start.camera_delay if camera_delay is None else camera_delay
        try:
            found = ring_samples(
                _put_right(table, self.start), self.maze, SMOOTHING, SampleOptions(delay=delay, recompute=True)
            )
        except InputError as problem:
            return self.skipped(problem.problem)  # who tells a lesson names its run
        told = {ring: self._rows(ring, some) for ring, some in found.items() if ring in self.rings}
        told = {ring: rows for ring, rows in told.items() if rows is not None}
        if not told:
            return self.skipped("the ball was not seen moving in any ring for long enough")
        try:
            pace = max(PACES, key=lambda pace: self._evidence(told, pace[0]) + math.log(pace[1]))[0]
            rings = self._with(told, self.clock + pace)
        except ModelError as problem:
            return self.skipped(str(problem))
        self.now, self.clock, self.rings = self.now + 1, self.clock + pace, rings
        count = sum(len(rows.y) for rows in told.values())
        along = np.sum([[np.sum((e * rows.radius) ** 2) for e in rows.errors] for rows in told.values()], axis=0)
        over = np.sum([[np.sum((e / rows.deviation) ** 2) for e in rows.errors] for rows in told.values()], axis=0)
        self.watched.append((float(over[0]) / count, float(over[1]) / count))
        error, fixed = np.sqrt(along / count)
        taken, impacts = {ring: len(rows.y) for ring, rows in told.items()}, sum(r.impacts for r in told.values())
        return Lesson(self.now, taken, impacts, "", float(error), float(fixed), pace, self.trusted)

    def _evidence(self, told: Mapping[int, _Rows], pace: float) -> float:
        """Log likelihood of a run's rows if the clock has gone on by so much."""
        return sum(
            self.rings[ring].evidence(rows.inputs, rows.features, rows.y, np.full(len(rows.y), self.clock + pace))
            for ring, rows in told.items()
        )

    def _with(self, told: Mapping[int, _Rows], clock: float) -> dict[int, OnlineProcess]:
        """The rings with a run's rows, each within its budget. Raises ModelError where one is no number."""
        rings = dict(self.rings)
        for ring, rows in told.items():
            most = self.options.most or max(len(self.start.processes.get(ring, ())), FEWEST)
            new = rings[ring].added(rows.inputs, rows.features, rows.y, np.full(len(rows.y), clock))
            rings[ring] = new.within(most, clock, SCORES[self.options.keep])
            rings[ring].process(clock)
        return rings

    def _rows(self, ring: int, samples: RingSamples) -> _Rows | None:
        """What a run tells of a ring; None where that is nothing."""
        rows = self.rings[ring]
        moving = samples.good & (np.abs(samples.k.theta_dot) > RESTING) & _inside(samples.segment)
        if not moving.any():
            return None
        k, ball = samples.at(moving), self.start.ball(ring)
        x, phi = rounded(inputs(k)), effect_features(k)[:, : rows.features.shape[1]]
        left = samples.theta_ddot[moving] - (kinematic_terms(k) if self.kind == "np" else expected(ball, k))
        mean, variance = rows.predict(x, phi, self.clock + 1.0)
        first = self.start.processes.get(ring)
        fixed = left if first is None else left - first.mean(x)
        deviation = np.sqrt(variance + rows.hyper.noise**2)
        fits = np.abs(left - mean) < MISFIT * deviation
        if not fits.any():
            return None
        errors = (left - mean)[fits], fixed[fits]
        return _Rows(x[fits], phi[fits], left[fits], errors, deviation[fits], int(np.sum(~fits)), k.radius)


@dataclass(frozen=True)
class _Rows:
    """Rows of a ring: inputs (N, D), features (N, M), y (N,); errors (N,) of model and first model before they are
    learned; deviation (N,): to be expected of the former; impacts: how many were left out; radius: m."""

    inputs: Array
    features: Array
    y: Array
    errors: tuple[Array, Array]
    deviation: Array
    impacts: int
    radius: float


def _inside(segment: IntArray) -> np.ndarray:
    """Which rows (N,) are further than ENDS from either end of their stretch."""
    rows = np.arange(len(segment))
    begin, end = (np.searchsorted(segment, segment, side) for side in ("left", "right"))
    return np.asarray((rows - begin >= ENDS) & (end - 1 - rows >= ENDS))


def usual(radius: float) -> Hyperparameters:
    """Hyperparameters for a ring (radius: of its track, m) of which nothing was learned yet."""
    columns = PLANNED_TERMS[0][0]
    lengths = np.array([LENGTHS[0] / radius, *LENGTHS[1:]])
    return Hyperparameters((Term(columns, lengths, AMPLITUDE / radius),), NOISE / radius, np.zeros(0))


def expected(ball: BallModel, k: RingKinematics) -> Array:
    """theta_dd (N,) of all effects as the planner has them."""
    return planned(ball, k)


def accelerations(model: RigModel, ring: int, k: RingKinematics) -> Array:
    """theta_dd (N,) of a model, process and all."""
    process = model.processes.get(ring)
    base = kinematic_terms(k) if model.kind == "np" and process is not None else expected(model.ball(ring), k)
    return base if process is None else base + process.mean(inputs(k))


def _features(x: Array, radius: float) -> Array:
    """`effect_features` (N, 5) of rows of which only the inputs (N, 9) are known."""
    none = np.zeros(len(x))
    theta, beta, gamma = (np.arctan2(x[:, i], x[:, i + 1]) for i in (3, 5, 7))
    k = RingKinematics(radius, theta, x[:, 0], beta, x[:, 1], none, gamma, x[:, 2], none)
    return effect_features(k)


def _changed(ball: BallModel, weights: Array, variance: Array) -> BallModel:
    """The ball with its effects changed by weights (5,) of some variance (5,); effects without a feature stay."""
    scale = ball.parameter("rolling_inertia", "factor", 1.0)  # an error of a tilt as its weight has it
    parts = (
        ("rolling_inertia", "factor", 1.0),
        ("viscous_friction", "coefficient", 1.0),
        ("dry_friction", "coefficient", 1.0),
        ("tilt_offset", "beta", scale),
        ("tilt_offset", "gamma", scale),
    )
    before = np.array([s * ball.stderr.get(effect, {}).get(name, 0.0) for effect, name, s in parts])
    return corrected(ball, weights, np.sqrt(before**2 + np.maximum(variance, 0.0)))


def _put_right(table: Table, model: RigModel) -> Table:
    """The table with what the model knows of camera and tilt sensor taken off."""
    columns, camera, sensor = dict(table.columns), model.camera, model.tilt_sensor
    if "x" in table:
        place: Any = camera.true(columns["x"], columns["y"])  # pyright: ignore[reportArgumentType]
        x, y = place
        columns.update(x=x, y=y, theta=np.arctan2(y, x), r=np.hypot(x, y))
    columns.update(beta=columns["beta"] / sensor.gain_beta, gamma=columns["gamma"] / sensor.gain_gamma)
    return Table(columns, table.source)
