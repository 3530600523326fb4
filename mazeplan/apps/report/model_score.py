"""How well a model predicts a log, in one number: the error of theta after 40 samples, in radians.

The number is compared with two other errors. The first is the error without a model: of a ball that stays where it is,
or of a ball that rolls on at its speed, whichever is smaller. The second is the error by the camera's noise alone. The
limits of the verdict are round numbers, not fitted to data.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from mazeplan.apps.report.learned import predictors, rolled, samples_of, windows_of
from mazeplan.core.logs.table import Table
from mazeplan.core.records import Array
from mazeplan.learning.modelfile import RigModel
from mazeplan.learning.rollout import STEPS, Rollout, angle_noise
from mazeplan.maze.geometry import Maze
from mazeplan.physics.formulas.arrays import RingKinematics

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
    for ring, samples in samples_of(model, tables, maze).items():
        windows = windows_of(samples, ring, maze)
        if not len(windows):
            continue
        start, theta = windows.start, samples.k.theta
        stays = Rollout.against(np.repeat(theta[start, None], STEPS + 1, axis=1), theta, start)
        goes_on = rolled(_no_force, samples, windows)
        done = rolled(predictors(model, ring)["model"], samples, windows)
        noise = math.sqrt(2.0 / math.pi) * angle_noise(samples)  # mean of its absolute value
        persistence = min(stays.after(STEPS), goes_on.after(STEPS))
        found[ring] = RingError(len(windows), STEPS * samples.dt, done.after(STEPS), persistence, noise)
    return found


def _no_force(k: RingKinematics) -> Array:
    return np.zeros(len(k.theta))


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
        "good": f"drive with it: mazeplan evaluate --model {model}",
        "fair": f"learn from a longer log, or see what the model lacks: mazeplan diagnose {log} --model {model}",
        "poor": f"check map, signs and camera of the rig, then see what is missing: mazeplan diagnose {log} --model "
        f"{model}",
        "unknown": "collect a longer log: mazeplan collect --rings --seconds 300 -o NEW.mcap",
    }
    weak = [ring for ring, found in rings.items() if found.verdict in ("fair", "poor") and word == "good"]
    more = [f"ring {ring} alone is {rings[ring].verdict}: {rings[ring].error:.3f} rad" for ring in weak]
    numbers = {name: value for name, value in asdict(every).items() if math.isfinite(value)}
    return {
        "verdict": word, "because": because, "advice": [*more, advice[word]], "steps": STEPS, **numbers,
        "rings": {str(ring): {**asdict(found), "verdict": found.verdict} for ring, found in rings.items()},
    }  # fmt: skip
