"""Judge a model on a log as a run would use it: estimate, prediction over the delay, and a roll-out.

The estimator of a run takes the samples and commands of the log, picture by picture. At each picture it predicts where
the camera will see the ball AHEAD_S later, under the commands that the log has. The error is the distance to where the
camera did see it. It needs stage, delays, ball and contact at once, whatever the kinds of the models.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from mazeplan.control.estimation.delay_bank import DelayBank, estimator_for
from mazeplan.core.logs.table import Table
from mazeplan.core.records import Array, Command, Observation
from mazeplan.core.side_by_side import in_processes
from mazeplan.learning.rig_model import RigModel
from mazeplan.maze.geometry import Maze
from mazeplan.physics.rig.stage import StageModel

AHEAD_S = 0.25  # s; delays, the lag of a servo, and a little more
WARM_S = 1.5  # s of samples before the first prediction of a part
EVERY_S = 0.1  # s between predictions
CAP = 0.02  # m; a larger error counts as this: a ball in another ring does not decide
BLOCK_S = 3.0  # s of predictions that count as one observation
MOST_S = 45.0  # s of the log that are judged
CLEAR, LEAST = 2.0, 1.02  # the safer description is kept if it is better by as many standard errors, and this factor
PARTS = ("contact", "ball", "stage")
FEWEST = 4  # blocks
SAFER: dict[str, tuple[str, ...]] = {  # parts that are safer in each description
    "learned": (), "contact": ("contact",), "ball": ("contact", "ball"), "stage": ("contact", "stage"),
    "nothing": PARTS,
}  # fmt: skip


@dataclass(frozen=True)
class Judgement:
    """The model to be used, and the errors by which it was chosen."""

    model: RigModel
    errors: dict[str, float]  # mean distance after AHEAD_S, m: of `learned`, without a part in PARTS, of `nothing`
    dropped: tuple[str, ...]  # parts whose safer description was kept

    def words(self) -> str:
        """The judgement in one line."""
        if not self.errors:
            return "judged       not: the log is too short"
        without = ", ".join(f"without the {name} {1e3 * e:.1f}" for name, e in self.errors.items() if name in PARTS)
        kept = f"the safer {' and '.join(self.dropped)} is kept" if self.dropped else "all parts are kept"
        return (
            f"judged       {1e3 * self.errors['learned']:.1f} mm off after {AHEAD_S:g} s on parts of the log that were "
            f"not fitted; {without}, nothing learned {1e3 * self.errors['nothing']:.1f} mm: {kept}"
        )

    def document(self) -> dict[str, object]:
        """For JSON and the model file."""
        return {
            "ahead_s": AHEAD_S, "errors_mm": {name: round(1e3 * e, 3) for name, e in self.errors.items()},
            "safer": list(self.dropped),
        }  # fmt: skip


def judge(
    model: RigModel, table: Table, maze: Maze, rows: np.ndarray, *, parts: Sequence[str] = PARTS, fits: bool = True
) -> Judgement:
    """The model with the parts that predict the given rows (N,) not worse than the safer description of the part.

    The safer contact is the planar model's, the safer ball and stage are textbook values.

    parts: those that may be replaced
    fits: whether the rigid ball explains the log; if not, its contact has to be better beyond doubt"""
    ways = _ways(model, RigModel.nominal(maze))
    errors = in_processes(lambda way: block_errors(way, table, maze, rows), list(ways.values()))
    found = dict(zip(ways, errors, strict=True))
    common = np.all([np.isfinite(e) for e in found.values()], axis=0)
    if common.sum() < FEWEST:
        return Judgement(model, {}, ())
    found = {name: e[common] for name, e in found.items()}
    best = "learned"
    for part in (part for part in parts if part in found):
        doubtful = part == "contact" and not fits and not _better(found[best], found[part])
        if doubtful or _better(found[part], found[best]):
            best = part
    if parts and _better(found["nothing"], found[best]):
        best = "nothing"
    kept = replace(ways[best], rate_hz=model.rate_hz, scores=model.scores, data=model.data)
    return Judgement(kept, {name: float(np.mean(e)) for name, e in found.items()}, SAFER[best])


def _ways(model: RigModel, nominal: RigModel) -> dict[str, RigModel]:
    """The model, and the same with a safer description of each part. Kind p without a delay: a run estimates it."""
    usual = {"stage": StageModel(), "camera_delay": 0.0, "camera_delay_stderr": None, "processes": {}, "body": None}
    ways = {
        "nothing": nominal,
        "stage": replace(model, kind="p", **usual),
        "ball": replace(model, balls=nominal.balls, processes={}, body=None, kind="pi"),
        "contact": replace(model, body=None),
        "learned": model,
    }
    if model.body is None:
        del ways["contact"]
    return ways


def _better(safer: Array, other: Array) -> bool:
    """Whether the safer description has smaller errors in blocks (B,), beyond doubt."""
    gain = other - safer
    error = float(np.std(gain, ddof=1)) / math.sqrt(len(gain))
    return float(np.mean(gain)) > CLEAR * error and float(np.mean(other)) > LEAST * float(np.mean(safer))


def block_errors(model: RigModel, table: Table, maze: Maze, rows: np.ndarray) -> Array:
    """Mean error (B,), m, of the predictions from the given rows (N,), for each block of the log; NaN without any."""
    dt = table.dt
    block = (np.arange(len(table)) * dt // BLOCK_S).astype(int)
    total, count = np.zeros(block[-1] + 1), np.zeros(block[-1] + 1)
    edges = [0, *(np.flatnonzero(np.diff(table.segment)) + 1).tolist(), len(table)]
    left = MOST_S
    for a, b in pairwise(edges):
        wanted = np.flatnonzero(rows[a:b]) + a
        if not len(wanted) or left <= 0.0:
            continue
        left -= len(wanted) * dt
        for k, error in _errors(model, table, maze, max(a, int(wanted[0]) - round(WARM_S / dt)), b, rows):
            total[block[k]] += min(error, CAP)
            count[block[k]] += 1
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _errors(
    model: RigModel, table: Table, maze: Maze, first: int, end: int, rows: np.ndarray
) -> list[tuple[int, float]]:
    dt, out = table.dt, list[tuple[int, float]]()
    estimator = estimator_for(maze, model, rate_hz=1.0 / dt)
    columns = [table[name] for name in ("x", "y", "beta", "gamma", "u_beta", "u_gamma")]
    ahead, every, sent = round(AHEAD_S / dt), max(round(EVERY_S / dt), 1), first
    for k in range(first, end):
        t, (x, y, beta, gamma, *_) = k * dt, (column[k] for column in columns)
        while sent < min(k + ahead, end):  # what the log knows of the future
            estimator.sent(Command(float(columns[4][sent]), float(columns[5][sent])), sent * dt)
            sent += 1
        seen = math.isfinite(x) and math.isfinite(y)
        estimator.update(Observation(t, *((float(x), float(y)) if seen else (None, None)), float(beta), float(gamma)))
        then = k + ahead
        if not rows[k] or k - first < round(WARM_S / dt) or k % every or then >= end or not rows[then]:
            continue
        if not math.isfinite(columns[0][then] + columns[1][then]):
            continue
        one = estimator.current if isinstance(estimator, DelayBank) else estimator
        z = one.predicted(t, t + ahead * dt - one.camera_delay)
        place = model.camera.true(float(columns[0][then]), float(columns[1][then]))
        out.append((k, math.hypot(z[0] - place[0], z[1] - place[1])))
    return out
