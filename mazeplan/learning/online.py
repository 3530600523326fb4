"""A rig's model that learns between runs: the effects of each ring follow the rig, the Gaussian processes stay.

    theta_dd = model + phi w + e      phi: `effect_features`; e ~ N(0, s^2)
    w(0) = 0,   w(k+1) = w(k) + N(0, diag(STEPS)^2)

w are the changes of the effects since the *first* model, a random walk from run to run; a Kalman filter estimates them.
Rows are made as in `learn`. Three kinds are left out:

    rows of a ball at rest                     its friction is undetermined
    rows at the ends of a stretch              smoothed accelerations scatter three times as much there, and a run has
                                               many stretches
    rows beyond MISFIT standard deviations     they are impacts

Before rows are learned, the first model and the present one predict them. If the present model was worse over the last
WATCHED runs, the first one is used.
"""

from __future__ import annotations

import json
import math
from collections import deque
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.core.errors import InputError, ModelError
from mazeplan.core.file_format import format_problem
from mazeplan.core.logs.table import Table
from mazeplan.core.records import Array, IntArray
from mazeplan.core.whole_file import whole_file
from mazeplan.learning.features import effect_features, inputs
from mazeplan.learning.modelfile import load_model, save_model
from mazeplan.learning.rig_gp import SMOOTHING, corrected, effect_sigma, planned
from mazeplan.learning.rig_model import RigModel
from mazeplan.learning.rigid_body_entries import stamp
from mazeplan.learning.samples import RingSamples, SampleOptions, ring_samples
from mazeplan.maze.geometry import Maze
from mazeplan.maze.mapfile import dump_map

# standard deviations of the change of an effect from run to run: rolling factor; viscous friction, 1/s; dry friction,
# m/s^2 along the track; tilt of the table, rad
STEPS = (5e-4, 0.01, 0.02, 5e-5, 5e-5)
NOISE = 0.073  # m/s^2 along the track; typical noise of a smoothed acceleration
ALIKE = 4.0  # neighbouring rows with the same error: smoothing makes them alike
RESTING = 0.15  # rad/s; below it the sign of dry friction is uncertain
ENDS = 2  # samples left out at either end of a stretch
MISFIT = 4.0  # standard deviations beyond which a row is an impact
WATCHED, WORSE = 5, 1.1  # runs; ratio of mean squared errors of a worse model
STATE, START, FORMAT = "learning.json", "start", 1


@dataclass(frozen=True)
class Lesson:
    """Result of one run.

    run:      number of the run, from 1
    rows:     number of learned rows, by ring
    why:      reason that nothing was learned, or ""
    error:    rms error of the present model on these rows before learning, m/s^2 along the track
    fixed:    the same for the first model
    trusted:  whether the next run uses what was learned"""

    run: int
    rows: dict[int, int] = field(default_factory=dict)
    why: str = ""
    error: float = math.nan
    fixed: float = math.nan
    trusted: bool = True


@dataclass(frozen=True)
class RingChange:
    """Changes of the effects of a ring since the first model: w (5,) and its covariance (5, 5)."""

    weights: Array = field(default_factory=lambda: np.zeros(5))
    covariance: Array = field(default_factory=lambda: np.zeros((5, 5)))

    def later(self, radius: float) -> RingChange:
        """A run later; radius: of the track, m."""
        steps = np.array(STEPS) * [1.0, 1.0, 1.0 / radius, 1.0, 1.0]
        return replace(self, covariance=self.covariance + np.diag(steps**2))

    def learned(self, phi: Array, left: Array, noise: float) -> RingChange:
        """With rows phi (N, 5) and what the first model leaves unexplained of them, (N,), rad/s^2."""
        P, R = self.covariance, ALIKE * noise**2
        shrunk = np.asarray(np.linalg.solve(np.eye(5) + P @ (phi.T @ phi) / R, P), dtype=float)
        weights = self.weights + shrunk @ phi.T @ (left - phi @ self.weights) / R
        return RingChange(weights, shrunk)


class OnlineModel:
    """A model that learns from run to run. start: the first model. Raises InputError for a model that cannot learn."""

    def __init__(self, start: RigModel, maze: Maze) -> None:
        if not start.delay_known:
            advice = "fit one with `mazeplan collect` and `mazeplan learn --kind pi`, and give it with --model"
            raise InputError(f"nominal physics have no delay of the camera, so nothing can be learned: {advice}")
        self.start, self.maze, self.now = start, maze, 0
        self.rings = {r.number: RingChange() for r in maze.rings if not r.is_disc and start.by_effects(r.number)}
        self.watched: deque[tuple[float, float]] = deque(maxlen=WATCHED)
        if not self.rings:
            raise InputError("a model of kind np has no effects that could follow the rig: learn one of kind sp or pi")

    @property
    def trusted(self) -> bool:
        """Whether the present model was not worse than the first one over the last WATCHED runs."""
        sums = np.sum(self.watched, axis=0) if self.watched else np.zeros(2)
        return bool(sums[0] <= WORSE * sums[1])

    @property
    def model(self) -> RigModel:
        """The model to use: with the changes if they are trusted, else the first one."""
        return self.learned if self.trusted and self.now else self.start

    @property
    def learned(self) -> RigModel:
        """The first model with the changes, trusted or not."""
        balls = {ring.number: self.start.ball(ring.number) for ring in self.maze.rings} | self.start.balls
        for ring in self.maze.rings:  # a disc changes as the nearest ring
            near = min(self.rings, key=lambda number: abs(number - ring.number))
            change, radius = self.rings[near], ring.track_radius or 0.5 * ring.outer_radius
            if not change.weights.any():
                continue
            scale = np.array([1.0, 1.0, self.maze.track_radius(near) / radius, 1.0, 1.0])
            sigma = np.sqrt(effect_sigma(balls[ring.number], 0.0) ** 2 + np.diag(change.covariance))
            balls[ring.number] = corrected(balls[ring.number], scale * change.weights, sigma)
        scores = {**self.start.scores, "learned_while_running": {"runs": self.now}}
        body = self.start.body
        if body is not None and body.of == stamp(self.start.balls):  # it knows place and speed better than the bead
            body = replace(body, of=stamp(balls))
        return replace(self.start, balls=balls, scores=scores, body=body)

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
        rows, squares = dict[int, int](), np.zeros(2)
        for ring, samples in found.items():
            moving = samples.good & (np.abs(samples.k.theta_dot) > RESTING) & _inside(samples.segment)
            if ring in self.rings and moving.any():
                count, more = self._learn_ring(ring, samples, moving)
                rows, squares = rows | ({ring: count} if count else {}), squares + more
        if not rows:
            return self.skipped("the ball was not seen moving in any ring for long enough")
        self.now, total = self.now + 1, sum(rows.values())
        error, fixed = np.sqrt(squares / total)
        self.watched.append((float(error) ** 2, float(fixed) ** 2))
        return Lesson(self.now, rows, "", float(error), float(fixed), self.trusted)

    def _learn_ring(self, ring: int, samples: RingSamples, moving: np.ndarray) -> tuple[int, Array]:
        """Learn the rows of a ring. Returns their number, and the sums of the squared errors of the present model and
        of the first one, (m/s^2)^2."""
        k, process = samples.at(moving), self.start.processes.get(ring)
        change, phi = self.rings[ring].later(k.radius), effect_features(k)
        left = samples.theta_ddot[moving] - planned(self.start.ball(ring), k)
        left = left if process is None else left - process.mean(inputs(k))
        noise = NOISE / k.radius if process is None else process.hyper.noise
        error = left - phi @ change.weights
        deviation = np.sqrt(np.einsum("ni,ij,nj->n", phi, change.covariance, phi) + noise**2)
        fits = np.abs(error) < MISFIT * deviation
        if fits.any():
            self.rings[ring] = change.learned(phi[fits], left[fits], noise)
        return int(fits.sum()), k.radius**2 * np.array([np.sum(e[fits] ** 2) for e in (error, left)])


def _inside(segment: IntArray) -> np.ndarray:
    """Which rows (N,) have at least ENDS rows of their stretch on either side."""
    rows = np.arange(len(segment))
    begin, end = (np.searchsorted(segment, segment, side) for side in ("left", "right"))
    return np.asarray((rows - begin >= ENDS) & (end - 1 - rows >= ENDS))


def _true_values(table: Table, model: RigModel) -> Table:
    """The table without the errors of camera and tilt sensor that the model knows."""
    columns, camera, sensor = dict(table.columns), model.camera, model.tilt_sensor
    if "x" in table:
        place: Any = camera.true(columns["x"], columns["y"])  # pyright: ignore[reportArgumentType]
        x, y = place
        columns.update(x=x, y=y, theta=np.arctan2(y, x), r=np.hypot(x, y))
    columns.update(beta=columns["beta"] / sensor.gain_beta, gamma=columns["gamma"] / sensor.gain_gamma)
    return replace(table, columns=columns)


# -- the folder: a model folder, with the first model in `start/` and the changes in `learning.json` ------------------


def save_online(online: OnlineModel, folder: Path, rig: str) -> None:
    """Write the folder of a model that learns. Raises ModelError. rig: on which the model learns."""
    state = {
        "format": FORMAT, "rig": rig, "map": dump_map(online.maze), "map_name": online.maze.name, "runs": online.now,
        "watched": list(online.watched),
        "rings": {n: [c.weights.tolist(), c.covariance.tolist()] for n, c in online.rings.items()},
    }  # fmt: skip
    try:
        if not (folder / START).exists():
            save_model(online.start, folder / START)
        with whole_file(folder / STATE) as beside:
            beside.write_text(json.dumps(state) + "\n", encoding="utf-8")
        save_model(online.model, folder)
    except OSError as problem:
        raise ModelError(f"cannot be written: {problem.strerror}", file=folder) from None


def open_online(folder: Path, maze: Maze, rig: str) -> OnlineModel:
    """The model that learns in a folder. Raises InputError for another rig or map, ModelError for damaged files."""
    file, advice = folder / STATE, "give another folder with -o, and this one with --model to begin with what it is now"
    online = OnlineModel(load_model(folder / START), maze)
    try:
        state = json.loads(file.read_text(encoding="utf-8"))
        if refused := format_problem(state["format"], FORMAT, None):
            raise ModelError(refused, file=file, key="format")
        if state["map"] != dump_map(maze):
            raise InputError(f"--map: got {maze.name}, but {folder} has learned on {state['map_name']}: {advice}")
        if state["rig"] != rig:
            raise InputError(f"--rig: got {rig}, but {folder} has learned on {state['rig']}: {advice}")
        online.now = int(state["runs"])
        online.watched.extend((float(a), float(b)) for a, b in state["watched"])
        for ring in online.rings:
            weights, covariance = (np.array(part, dtype=float) for part in state["rings"][str(ring)])
            if weights.shape != (5,) or covariance.shape != (5, 5) or not np.isfinite([weights, *covariance]).all():
                raise ValueError(f"ring {ring}: expected 5 changes and their covariance")
            online.rings[ring] = RingChange(weights, covariance)
    except (OSError, KeyError, TypeError, ValueError) as problem:
        raise ModelError(f"cannot be read: {' '.join(str(problem).split())}", file=file) from None
    return online
