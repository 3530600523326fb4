"""How well a model predicts a log, in one number: the error of theta after 40 samples, in radians.

The number is compared with two other errors. The first is the error without a model: of a ball that stays where it is,
or of a ball that rolls on at its speed, whichever is smaller. The second is the error by the camera's noise alone. The
limits of the verdict are round numbers, not fitted to data. A filter with the model estimates the state at the start of
a roll-out.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.core.errors import InputError
from mazeplan.core.logs.table import Table
from mazeplan.learning.features import inputs
from mazeplan.learning.modelfile import RigModel
from mazeplan.learning.rig_gp import planned
from mazeplan.learning.rollout import (
    PAST,
    STEPS,
    Accelerate,
    Rollout,
    angle_noise,
    causal_start,
    choose_windows,
    roll_out,
)
from mazeplan.learning.samples import RingSamples, SampleOptions, joined_samples
from mazeplan.learning.smoothing import Smoothing
from mazeplan.learning.unmeasured_tilt import tilt_is_measured, with_tilt_by_commands
from mazeplan.maze.geometry import Maze
from mazeplan.physics.ball_model import kinematic_terms

MISFIT = 0.5  # misfit that the filter at the start of a roll-out expects of any model, as a share of theta_dd's spread
BRIDGED = 3  # pictures in a row
MIN_SAMPLES = 50  # minimum number of samples of a ring
GOOD, FAIR = 0.25, 0.5  # largest error for the verdicts good and fair, as a share of the error without a model
NOISES = 3.0  # an error below this many times the noise is good: the noise hides any better model
FEWEST_WINDOWS = 5  # minimum number of windows for a verdict


@dataclass(frozen=True)
class RingError:
    """Mean absolute errors of theta in a ring after STEPS samples.

    windows: number of roll-outs.
    seconds: duration of STEPS samples, s.
    error: error of the model, rad.
    persistence: error without a model, rad.
    noise: error by the camera's noise alone, rad."""

    windows: int
    seconds: float
    error: float
    persistence: float
    noise: float

    @property
    def verdict(self) -> str:
        """`good`, `fair`, `poor`, or `unknown` for too few windows."""
        if self.windows < FEWEST_WINDOWS:
            return "unknown"
        if self.error <= max(GOOD * self.persistence, NOISES * self.noise):
            return "good"
        return "fair" if self.error <= FAIR * self.persistence else "poor"


def ring_errors(model: RigModel, tables: Sequence[Table], maze: Maze) -> dict[int, RingError]:
    """The errors in each ring that has windows. Raises InputError if no ring has enough samples."""
    found = {}
    told = (tilt_is_measured(t) or "u_beta" not in t for t in tables)
    tables = [t if good else with_tilt_by_commands(t, model.stage) for t, good in zip(tables, told, strict=True)]
    for ring, samples in samples_of(model, tables, maze).items():
        openings = np.array([opening.angle for opening in maze.openings_of(ring)])
        # the filter that finds the start of a roll-out looks back PAST samples, all of which must be good
        bad = np.concatenate([[0], np.cumsum(~samples.good)])
        index = np.arange(len(samples))
        whole = (bad[index + 1] == bad[np.maximum(index - PAST, 0)]) & (index >= PAST)
        windows = choose_windows(samples, whole, openings)
        if not len(windows):
            continue
        start, theta = windows.start, samples.k.theta
        stays = Rollout.against(np.repeat(theta[start, None], STEPS + 1, axis=1), theta, start)
        goes_on = _rolled(lambda k: np.zeros(len(k.theta)), samples, start)
        done = _rolled(_predictor(model, ring), samples, start)
        noise = math.sqrt(2.0 / math.pi) * angle_noise(samples)  # mean of its absolute value
        persistence = min(stays.after(STEPS), goes_on.after(STEPS))
        found[ring] = RingError(len(windows), STEPS * samples.dt, done.after(STEPS), persistence, noise)
    return found


def _predictor(model: RigModel, ring: int) -> Accelerate:
    """The function for theta_dd by the model, as planner and estimator use it."""
    ball, process = model.ball(ring), model.processes.get(ring)
    if process is None:
        return ball.acceleration
    effects = model.by_effects(ring)
    return lambda k: (planned(ball, k) if effects else kinematic_terms(k)) + process.mean(inputs(k))


def _rolled(way: Accelerate, samples: RingSamples, start: Any) -> Rollout:
    """Roll-outs of a model from the samples `start`. A filter with the model estimates their start."""
    misfit = MISFIT * max(float(np.std(samples.theta_ddot[samples.good])), 1e-300)
    theta, rate = causal_start(way, samples, start, angle_noise(samples), misfit)
    return roll_out(way, samples, start, theta, rate)


def samples_of(model: RigModel, tables: Sequence[Table], maze: Maze) -> dict[int, RingSamples]:
    """Samples of each ring that has enough of them. Raises InputError if no ring has enough."""
    options = SampleOptions(delay=model.camera_delay)
    together = joined_samples(map(_bridged, tables), maze, Smoothing(window=9), options)
    enough = {ring: samples for ring, samples in sorted(together.items()) if int(samples.good.sum()) >= MIN_SAMPLES}
    if not enough:
        most = max((int(samples.good.sum()) for samples in together.values()), default=0)
        problem = f"got at most {most} usable samples in a ring, expected {MIN_SAMPLES}: record for longer"
        raise InputError(f"the logs that the model is to be judged on: {problem}")
    return enough


def _bridged(table: Table) -> Table:
    """The table with the ball between its neighbours where at most BRIDGED pictures in a row were lost.

    Smoothing would lose nine samples with each lost picture, and a stretch of two seconds with each of these."""
    if "x" not in table or "y" not in table:
        return table
    rows, known = np.arange(len(table)), np.flatnonzero(np.isfinite(table["x"] + table["y"]))
    if len(known) in (0, len(rows)):
        return table
    after = np.searchsorted(known, rows)
    last, following = known[np.maximum(after - 1, 0)], known[np.minimum(after, len(known) - 1)]
    short = (last < rows) & (rows < following) & (following - last <= BRIDGED + 1)
    short &= table.segment[last] == table.segment[following]
    x, y = (np.where(short, np.interp(rows, known, table[name][known]), table[name]) for name in ("x", "y"))
    return replace(table, columns={**table.columns, "x": x, "y": y, "theta": np.arctan2(y, x), "r": np.hypot(x, y)})


def learned_from(model: RigModel, logs: Sequence[Path]) -> list[str]:
    """Names of those logs from which the model was learned.

    Compares by content (SHA-256) if the model's file has it, else by name."""
    data = [entry for entry in model.data if isinstance(entry, dict)]
    prints = {str(entry["sha256"]) for entry in data if entry.get("sha256")}
    names = {Path(str(entry["file"])).name for entry in data if entry.get("file") and not entry.get("sha256")}
    return [log.name for log in logs if log.name in names or sha256(log.read_bytes()).hexdigest() in prints]


def whole(rings: dict[int, RingError]) -> RingError:
    """The errors over the windows of all rings; NaN if there are none."""
    count = sum(ring.windows for ring in rings.values())

    def mean(name: str) -> float:
        return sum(r.windows * getattr(r, name) for r in rings.values()) / count if count else math.nan

    return RingError(count, *(mean(name) for name in ("seconds", "error", "persistence", "noise")))


def score_document(rings: dict[int, RingError], model: str, log: str, asked: Iterable[int] = ()) -> dict[str, Any]:
    """The verdict as `score --json` prints it.

    model, log: names for the advised commands.
    asked: rings in question; the verdict names those that the log does not show."""
    every = whole(rings)
    word = every.verdict
    because = (
        f"after {STEPS} samples ({every.seconds:.2f} s) the angle is off by {every.error:.3f} rad; without a model by "
        f"{every.persistence:.3f}, the camera's noise alone gives {every.noise:.3f}"
        if word != "unknown"
        else f"the log has {every.windows} stretches that are long enough, expected at least {FEWEST_WINDOWS}"
    )
    unseen = [str(ring) for ring in asked if ring not in rings]
    if unseen and rings:
        because += f"; the log says nothing of ring {', '.join(unseen)}"
    advice = {
        "good": f"drive with it: mazeplan evaluate --rig RIG --model {model}",
        "fair": "a run plans for a fifth of this time only, so drive with it: mazeplan evaluate --rig RIG "
        f"--model {model}; or see what it lacks: mazeplan diagnose {log} --model {model}",
        "poor": f"check map, signs and camera of the rig, then see what is missing: mazeplan diagnose {log} --model "
        f"{model}",
        "unknown": "collect a longer log: mazeplan collect --rig RIG --rings --seconds 300 -o NEW.mcap",
    }
    weak = [ring for ring, found in rings.items() if found.verdict in ("fair", "poor") and word == "good"]
    more = [f"ring {ring} alone is {rings[ring].verdict}: {rings[ring].error:.3f} rad" for ring in weak]
    numbers = {name: value for name, value in asdict(every).items() if math.isfinite(value)}
    return {
        "verdict": word, "because": because, "advice": [*more, advice[word]], "steps": STEPS, **numbers,
        "rings": {str(ring): {**asdict(found), "verdict": found.verdict} for ring, found in rings.items()},
    }  # fmt: skip
