"""A rig's model that learns between runs: changes of friction and gravity, and the residual of the effects.

Each ring has an `OnlineProcess`. Its first rows are those of the model's Gaussian process, with age 0. In all rows, y
is the acceleration that the effects of the *first* model leave unexplained. So the weights of the features are the
changes of the effects, and the Gaussian process takes the rest. A model without Gaussian processes begins without rows,
with typical hyperparameters.

The clock of the ages advances from run to run by one of PACES. It takes the pace that gives the largest likelihood of
the new rows of all rings, times a prior. So the model of a constant rig keeps its rows. The model of a changed rig
forgets its rows in a run or two.

Rows are made as in `learn`, but three kinds are left out:

    rows of a ball at rest                     its friction is undetermined
    rows at the ends of a stretch              smoothed accelerations scatter three times as much there, and a run has
                                               many stretches
    rows beyond MISFIT standard deviations     they are impacts

Before rows are learned, the first model and the online model predict them. If the online model was worse over the last
WATCHED runs, the first model is used.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mazeplan.core.errors import InputError, ModelError, SettingsError
from mazeplan.core.logs.table import Table
from mazeplan.core.records import Array, IntArray
from mazeplan.learning.features import PLANNED_TERMS, effect_features, inputs
from mazeplan.learning.gaussian_process import JITTER, Hyperparameters, KernelTerm, kernel
from mazeplan.learning.gp_file import rounded
from mazeplan.learning.online_gp import RULES, OnlineProcess, Walk
from mazeplan.learning.rig_gp import MOST_FRICTION, SMOOTHING, corrected, effect_sigma, planned
from mazeplan.learning.rig_model import RigModel
from mazeplan.learning.rigid_body_entries import stamp
from mazeplan.learning.samples import RingSamples, SampleOptions, ring_samples
from mazeplan.maze.geometry import Maze
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.effects.ball import dry_friction, tilt_offset, viscous_friction
from mazeplan.physics.formulas.arrays import RingKinematics, kinematic_terms

# medians over rings and packaged models; AMPLITUDE and NOISE times the radius of the track, m/s^2
LENGTHS = (0.044, 0.37, 0.39, 0.45, 0.24, 0.034, 0.046)  # of PLANNED_TERMS; the first times the radius, m/s
AMPLITUDE, NOISE = 0.043, 0.073  # half of the median amplitude: effects explain the rest
PACES = ((0.05, 0.99), (1.0, 1e-2), (9.0, 1e-5))  # advance of the clock in a run, and its prior probability
RESTING = 0.15  # rad/s; below it the sign of dry friction is uncertain
ENDS = 2  # samples left out at either end of a stretch
MISFIT = 4.0  # standard deviations beyond which a row is an impact
WATCHED, WORSE = 5, 1.1  # runs; ratio of mean squared errors of a worse model
FEWEST = 400  # minimum budget of rows of a ring


@dataclass(frozen=True)
class OnlineOptions:
    """How fast a rig may change, and how many rows are kept. Raises SettingsError.

    factor:   standard deviation of the change of the rolling factor, in a unit of the clock
    viscous:  the same for viscous friction, 1/s
    dry:      the same for dry friction, m/s^2 along the track
    tilt:     the same for each tilt of the table, rad
    process:  relative growth of the variance of the rest, in a unit of the clock
    most:     maximum number of rows of each ring; None: as many as the first model has, at least FEWEST
    keep:     rule that chooses the rows to keep: novelty, or oldest (removes the oldest rows first)"""

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
        if self.keep not in RULES:
            raise SettingsError(f"got {self.keep!r}, expected one of {', '.join(RULES)}", key="keep")

    def walk(self, kind: str, radius: float) -> Walk:
        """The random walk of a ring; radius: of its track, m."""
        steps = [] if kind == "np" else [self.factor, self.viscous, self.dry / radius, self.tilt, self.tilt]
        return Walk(self.process, np.array(steps))


@dataclass(frozen=True)
class Lesson:
    """Result of one run.

    run:      number of the run, from 1
    rows:     number of learned rows, by ring
    impacts:  number of rows left out as impacts
    why:      reason that nothing was learned, or ""
    error:    rms error of the online model on these rows before learning, m/s^2 along the track
    fixed:    the same for the first model
    pace:     advance of the clock
    trusted:  whether the next run uses the online model"""

    run: int
    rows: dict[int, int] = field(default_factory=dict)
    impacts: int = 0
    why: str = ""
    error: float = math.nan
    fixed: float = math.nan
    pace: float = 0.0
    trusted: bool = True


class OnlineModel:
    """A model that learns from run to run. start: the first model. Raises InputError for a model that cannot learn."""

    def __init__(self, start: RigModel, maze: Maze, options: OnlineOptions | None = None) -> None:
        if not start.delay_known:
            advice = "fit one with `mazeplan collect` and `mazeplan learn --kind pi`, and give it with --model"
            raise InputError(f"nominal physics have no delay of the camera, so nothing can be learned: {advice}")
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
            return OnlineProcess.begin(default_hyperparameters(radius), walk)
        h, x = process.hyper, process.inputs
        own = process.alpha * (h.noise**2 + JITTER * h.only.amplitude**2)
        y = kernel(x, x, h) @ process.alpha + own  # the values of its rows: C alpha
        features = _features(x, radius)[:, : len(walk.weights)]
        return OnlineProcess.begin(h, walk).added(x, features, y, np.zeros(len(y)))

    @property
    def trusted(self) -> bool:
        """Whether the online model was not worse than the first model over the last WATCHED runs."""
        sums = np.sum(self.watched, axis=0) if self.watched else np.zeros(2)
        return bool(sums[0] <= WORSE * sums[1])

    @property
    def model(self) -> RigModel:
        """The model to use: the online model if it is trusted, else the first one."""
        return self.learned if self.trusted and self.now else self.start

    @property
    def learned(self) -> RigModel:
        """The online model, trusted or not. Raises ModelError if it is not finite."""
        balls, processes = {r.number: self.start.ball(r.number) for r in self.maze.rings}, {}
        balls |= self.start.balls
        for ring, rows in self.rings.items():
            weights, covariance = rows.weights(self.clock)
            if not np.isfinite(weights).all():
                raise ModelError(f"ring {ring}: the weights are not finite")
            if len(weights):
                sigma = np.sqrt(effect_sigma(balls[ring], 0.0) ** 2 + np.maximum(np.diag(covariance), 0.0))
                balls[ring] = corrected(balls[ring], weights, sigma)
            if len(rows):
                processes[ring] = rows.process(self.clock)
        if self.kind == "sp":
            for ring in self.maze.rings:
                if ring.number not in self.rings:  # a disc has no rows
                    balls[ring.number] = self._disc_ball(ring.number, balls)
        kind = self.kind if processes else self.start.kind
        rows = {f"ring{ring}": len(rows) for ring, rows in self.rings.items()}
        scores = {**self.start.scores, "learned_while_running": {"runs": self.now, "rows": rows}}
        body = self.start.body
        if body is not None and body.of == stamp(self.start.balls):  # it knows place and speed better than the bead
            body = replace(body, of=stamp(balls))
        return replace(self.start, kind=kind, balls=balls, processes=processes, scores=scores, body=body)

    def _disc_ball(self, ring: int, balls: dict[int, BallModel]) -> BallModel:
        """The ball of a disc: its floor and table change like those of the nearest ring."""
        near = min(self.rings, key=lambda number: abs(number - ring))
        place, ball, before = self.maze.ring(ring), balls[ring], self.start.ball(near)
        scale = self.maze.track_radius(near) / max(place.track_radius, 0.5 * place.outer_radius)

        def moved(effect: str, parameter: str, scale: float = 1.0) -> float:
            change = balls[near].parameter(effect, parameter, 0.0) - before.parameter(effect, parameter, 0.0)
            return ball.parameter(effect, parameter, 0.0) + scale * change

        viscous, dry = moved("viscous_friction", "coefficient"), moved("dry_friction", "coefficient", scale)
        viscous, dry = (min(max(c, 0.0), MOST_FRICTION) for c in (viscous, dry))
        tilt = tilt_offset(*(moved("tilt_offset", axis) for axis in ("beta", "gamma")))
        asymmetry = ball.parameter("dry_friction", "asymmetry", 0.0)
        new = (viscous_friction(viscous), dry_friction(dry, asymmetry), tilt)
        kept = tuple(e for e in ball.effects if e.name not in {term.name for term in new})
        return BallModel((*kept, *new), ball.stderr)

    def skipped(self, why: str) -> Lesson:
        """Count a run from which nothing is learned."""
        self.now += 1
        return Lesson(self.now, why=why, trusted=self.trusted)

    def learn(self, table: Table, camera_delay: float | None = None) -> Lesson:
        """Learn from the record of a run. Nothing is learned from an unusable record.

        camera_delay: measured delay of the camera, s; None: that of the first model."""
        delay = self.start.camera_delay if camera_delay is None else camera_delay
        try:
            options = SampleOptions(delay=delay, recompute=True)
            found = ring_samples(_true_values(table, self.start), self.maze, SMOOTHING, options)
        except InputError as problem:
            return self.skipped(problem.problem)
        news = {ring: self._rows(ring, some) for ring, some in found.items() if ring in self.rings}
        news = {ring: rows for ring, rows in news.items() if rows is not None}
        if not news:
            return self.skipped("the ball was not seen moving in any ring for long enough")
        try:
            pace = max(PACES, key=lambda pace: self._evidence(news, pace[0]) + math.log(pace[1]))[0]
            rings = self._with(news, self.clock + pace)
        except ModelError as problem:
            return self.skipped(str(problem))
        self.now, self.clock, self.rings = self.now + 1, self.clock + pace, rings
        count = sum(len(rows.y) for rows in news.values())
        along = np.sum([[np.sum((e * rows.radius) ** 2) for e in rows.errors] for rows in news.values()], axis=0)
        over = np.sum([[np.sum((e / rows.deviation) ** 2) for e in rows.errors] for rows in news.values()], axis=0)
        self.watched.append((float(over[0]) / count, float(over[1]) / count))
        error, fixed = np.sqrt(along / count)
        taken, impacts = {ring: len(rows.y) for ring, rows in news.items()}, sum(r.impacts for r in news.values())
        return Lesson(self.now, taken, impacts, "", float(error), float(fixed), pace, self.trusted)

    def _evidence(self, news: Mapping[int, _Rows], pace: float) -> float:
        """Log likelihood of a run's rows for an advance of the clock."""
        return sum(self.rings[ring].evidence(*rows.at(self.clock + pace)) for ring, rows in news.items())

    def _with(self, news: Mapping[int, _Rows], clock: float) -> dict[int, OnlineProcess]:
        """The rings with the rows of a run, each within its budget. Raises ModelError if a ring is not finite."""
        rings = dict(self.rings)
        for ring, rows in news.items():
            most = self.options.most or max(len(self.start.processes.get(ring, ())), FEWEST)
            rings[ring] = rings[ring].added(*rows.at(clock)).within(most, clock, self.options.keep)
            rings[ring].process(clock)
        return rings

    def _rows(self, ring: int, samples: RingSamples) -> _Rows | None:
        """The rows of a run in one ring; None for none."""
        rows = self.rings[ring]
        moving = samples.good & (np.abs(samples.k.theta_dot) > RESTING) & _inside(samples.segment)
        if not moving.any():
            return None
        k, ball = samples.at(moving), self.start.ball(ring)
        x, phi = rounded(inputs(k)), effect_features(k)[:, : rows.features.shape[1]]
        left = samples.theta_ddot[moving] - (kinematic_terms(k) if self.kind == "np" else planned(ball, k))
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
    """New rows of a ring: inputs (N, D), features (N, M), y (N,).

    errors (N,):     errors of the online model and of the first model before learning
    deviation (N,):  standard deviation that the online model expects
    impacts:         number of rows left out
    radius:          of the track, m"""

    inputs: Array
    features: Array
    y: Array
    errors: tuple[Array, Array]
    deviation: Array
    impacts: int
    radius: float

    def at(self, clock: float) -> tuple[Array, Array, Array, Array]:
        """The rows with their age, for `OnlineProcess`."""
        return self.inputs, self.features, self.y, np.full(len(self.y), clock)


def _inside(segment: IntArray) -> np.ndarray:
    """Which rows (N,) have at least ENDS rows of their stretch on either side."""
    rows = np.arange(len(segment))
    begin, end = (np.searchsorted(segment, segment, side) for side in ("left", "right"))
    return np.asarray((rows - begin >= ENDS) & (end - 1 - rows >= ENDS))


def default_hyperparameters(radius: float) -> Hyperparameters:
    """Typical hyperparameters for a ring without a Gaussian process; radius: of the track, m."""
    lengths = np.array([LENGTHS[0] / radius, *LENGTHS[1:]])
    term = KernelTerm(PLANNED_TERMS[0][0], lengths, AMPLITUDE / radius)
    return Hyperparameters((term,), NOISE / radius, np.zeros(0))


def accelerations(model: RigModel, ring: int, k: RingKinematics) -> Array:
    """theta_dd (N,) of a model, with its learned part."""
    process = model.processes.get(ring)
    base = planned(model.ball(ring), k) if model.by_effects(ring) else kinematic_terms(k)
    return base if process is None else base + process.mean(inputs(k))


def _features(x: Array, radius: float) -> Array:
    """`effect_features` (N, 5) from inputs (N, 9) alone."""
    none = np.zeros(len(x))
    theta, beta, gamma = (np.arctan2(x[:, i], x[:, i + 1]) for i in (3, 5, 7))
    k = RingKinematics(radius, theta, x[:, 0], beta, x[:, 1], none, gamma, x[:, 2], none)
    return effect_features(k)


def _true_values(table: Table, model: RigModel) -> Table:
    """The table without the errors of camera and tilt sensor that the model knows."""
    columns, camera, sensor = dict(table.columns), model.camera, model.tilt_sensor
    if "x" in table:
        place: Any = camera.true(columns["x"], columns["y"])  # pyright: ignore[reportArgumentType]
        x, y = place
        columns.update(x=x, y=y, theta=np.arctan2(y, x), r=np.hypot(x, y))
    columns.update(beta=columns["beta"] / sensor.gain_beta, gamma=columns["gamma"] / sensor.gain_gamma)
    return replace(table, columns=columns)
