"""A record as a ball with a body makes it: place in the channel, spin, walls, all rings at once.

The model of a ring is a bead on a circle. A ball has play in its channel, spins against walls, and loses speed at
edges, which a bead can only show as wrong friction or inertia. Here the record is filtered with `physics.body` under
the plate's motion that the commands gave, and the ball's numbers are fitted to it (`estimation.bodyfit`). Where the
physics is right, what is left is the camera's noise: innovations without memory.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mazeplan.data.table import Table
from mazeplan.diagnosis.platemotion import Stage, commanded, fit_stage, from_sensor
from mazeplan.diagnosis.record import Record, record_of
from mazeplan.errors import TableError
from mazeplan.estimation.bodyfilter import BodyFilter, BodyModel, Pictures
from mazeplan.estimation.bodyfit import ORDINARY, BodyFit, autocorrelation, fit_body
from mazeplan.estimation.bodynumbers import number_of, said_by, with_values
from mazeplan.estimation.platestart import with_true_starts
from mazeplan.maze.geometry import Maze
from mazeplan.models.modelfile import RigModel
from mazeplan.physics.effect import Term
from mazeplan.physics.plate import PlateMotion
from mazeplan.physics.stage import StageModel
from mazeplan.physics.walls import pack_walls

FEWEST = 900  # pictures
NEEDED = ("x", "y", "beta", "gamma", "u_beta", "u_gamma")  # columns of a record of a whole rig
PART, LEAST_PLAY = 15, 1.5e-3  # pictures; m
GUESSED = (  # what a bead's model says rightly; its inertia and its other friction stand in for walls, too
    "rolling", "tilt_beta", "tilt_gamma", "offset_x", "offset_y", "angle", "scale", "bend", "delay",
    "gain_beta", "gain_gamma",
)  # fmt: skip
WHITE = 0.06  # autocorrelation of innovations up to which nothing is left in them


@dataclass(frozen=True)
class BodySeen:
    """What a record tells of the ball's body. fit: parameters with standard errors; body: the filter; stage: as it was
    fitted, None without commands; memory (3,): autocorrelations of whitened innovations at lags 1 to 3; pictures: that
    count; known: model of beads with which it began."""

    fit: BodyFit
    body: BodyFilter
    stage: Stage | None
    memory: np.ndarray
    pictures: int
    maze: Maze
    known: RigModel | None = None

    @property
    def white(self) -> bool:
        """Whether nothing is left in the innovations but noise."""
        return bool(np.max(np.abs(self.memory)) <= WHITE)

    def document(self) -> dict[str, Any]:
        """As `diagnose --body --json`."""
        return {
            "pictures": self.pictures, "white": self.white,
            "autocorrelation": [round(float(a), 4) for a in self.memory],
            "minus2_log_likelihood": round(self.fit.minus2, 2), "left_out": self.fit.filtered.left_out,
            "starts": self.fit.filtered.starts, "parameters": {name: self._told(name) for name in self.fit.free},
        }  # fmt: skip

    def _told(self, name: str) -> dict[str, Any]:
        """A number, and what the model of beads says of it: the least and the most over the rings."""
        number = number_of(self.fit.model, name)
        said = () if self.known is None or number.part == "terms" else said_by(self.known, self.maze, name)
        return {
            "value": self.fit.value(name), "stderr": self.fit.stderr[name], "unit": number.unit,
            "words": number.words, "effect": number.effect or None,
            "model": [min(said), max(said)] if said else None,
        }  # fmt: skip


def whole_rig(tables: Sequence[Table]) -> bool:
    """Whether records show a whole rig: long enough, with commands, and a ball that has play in its channel. One
    without play is a bead on a circle, which the equation of a ring describes."""
    if not all(name in table for table in tables for name in NEEDED):
        return False
    seen = sum(int(np.isfinite(table["x"]).sum()) for table in tables)
    return seen >= FEWEST and max(_play(table) for table in tables) > LEAST_PLAY


def _play(table: Table) -> float:
    """How much the distance of the ball from its circle varies beyond noise, m: the median over stretches of PART
    pictures, in which the camera's place hardly shows."""
    r = np.hypot(table["x"], table["y"])
    parts = r[: len(r) // PART * PART].reshape(-1, PART)
    parts = parts[np.isfinite(parts).all(axis=1)]
    if not len(parts):
        return math.inf
    noise = np.mean(np.diff(parts, 2, axis=1) ** 2) / 6.0  # of white noise, the second difference has six times that
    return math.sqrt(max(float(np.quantile(parts.var(axis=1, ddof=1), 0.9) - noise), 0.0))


def body_filter(table: Table, maze: Maze, known: StageModel | None = None) -> tuple[BodyFilter, Stage | None]:
    """The filter for a record with x and y, and the stage as fitted to it, None without commands. known: the stage by
    which the plate moves, with the offsets of this record, where it is not the fitted one. Raises TableError."""
    if "x" not in table or "y" not in table:
        raise TableError("got a table without x and y, expected where the camera saw the ball", file=_file(table))
    record = record_of(table, np.ones(len(table), dtype=bool))
    y = np.column_stack([table["x"], table["y"]])
    seen = int(np.isfinite(y).all(axis=1).sum())
    if seen < FEWEST:
        raise TableError(f"got {seen} pictures of the ball, expected {FEWEST} at least", file=_file(table))
    stage = fit_stage(record, np.ones(len(record), dtype=bool))
    moves = None if stage is None or stage.hurried else _stage_model(stage, known)
    return filter_of(table, record, maze, moves), stage


def filter_of(table: Table, record: Record, maze: Maze, stage: StageModel | None) -> BodyFilter:
    """The filter of a record whose plate moves by a stage; by the tilt sensor without one."""
    by_commands = None if stage is None else commanded(record, stage)
    tilt = by_commands or from_sensor(record.t, record.beta, record.gamma, record.segment)
    plate = PlateMotion(float(tilt.t[0]), float(tilt.t[1] - tilt.t[0]), np.ascontiguousarray(tilt.motion))
    if stage is not None and by_commands is not None:
        tilts = np.column_stack([record.beta, record.gamma])
        plate = with_true_starts(plate, tilts, record.first, record.dt, (stage.beta, stage.gamma))
    y = np.column_stack([table["x"], table["y"]])
    clock = table["t"] - table["t"][0]
    ordered = bool(np.all(np.diff(clock) > 0.0))  # of several logs nobody knows the time between them
    pictures = Pictures(record.t, record.dt, y, record.first, clock if ordered else None)
    return BodyFilter(pictures, plate, pack_walls(maze))


def _stage_model(stage: Stage, known: StageModel | None) -> StageModel:
    """The stage that is known, with the offsets of the one that was fitted; the fitted one where none is known."""
    if known is None:
        return StageModel(*stage.axes)
    pairs = zip((known.beta, known.gamma), stage.axes, strict=True)
    return StageModel(*(replace(axis, offset=found.offset) for axis, found in pairs))


def left_over(body: BodyFilter, fit: BodyFit) -> tuple[float, float]:
    """What a fit does not explain: the largest autocorrelation of its innovations, and their root mean square over
    what it would be if nothing unexplained moved the ball."""
    model, seen = fit.model, fit.filtered
    quiet = body.run(model._replace(wander=model.wander._replace(plane=1e-6, strike=1e-3)))
    keep = np.isfinite(seen.nu[:, 0]) & np.isfinite(quiet.nu[:, 0])
    remaining = math.sqrt(float(np.mean(seen.nu[keep] ** 2) / np.mean(quiet.S[keep, :2])))
    return float(np.max(np.abs(autocorrelation(seen)))), remaining


def first_guess(model: RigModel | None, maze: Maze) -> BodyModel:
    """The body that a model of beads stands for; of a usual ball without one."""
    if model is None:
        return BodyModel()
    said = {name: values[0] for name in GUESSED if (values := said_by(model, maze, name))}
    said["rolling"] = min(max(said.get("rolling", 0.0), 0.01), 1.0)
    said["delay"] = max(said["delay"], 0.0) or BodyModel().view.delay
    return with_values(BodyModel(), said)


def body_seen(
    table: Table, maze: Maze, model: RigModel | None = None, *,
    free: Sequence[str] = ORDINARY, terms: Sequence[Term] = (),
) -> BodySeen:  # fmt: skip
    """The ball's body by a record. model: what is known already, to begin with; free: names of `bodynumbers.PARAMETERS`
    that are fitted, and EFFECT.PARAMETER of terms; terms: effects that act on the ball besides. Raises TableError for a
    record that is too short, or without positions."""
    body, stage = body_filter(table, maze)
    fit = fit_body(body, first_guess(model, maze)._replace(terms=tuple(terms)), free)
    count = int(np.isfinite(fit.filtered.nu[:, 0]).sum())
    return BodySeen(fit, body, stage, autocorrelation(fit.filtered), count, maze, model)


def _file(table: Table) -> str | None:
    return table.source.get("file")
