"""The record of a whole rig, filtered with a ball that is a rigid body: all rings at once.

The commands move the plate, the filter follows the ball (`physics.dynamics.rigid_body`), and the fit finds the numbers
of the ball. If the physics is right, only the camera's noise is left: innovations without autocorrelation. In a model
of beads on circles, play in the channel, spin against walls and edges look like wrong friction or inertia.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mazeplan.control.estimation.rigid_body_filter import BallPictures, BodyFilter, BodyModel
from mazeplan.control.estimation.rigid_body_fit import BodyFit, autocorrelation, bead_values, with_values
from mazeplan.control.estimation.tilt_filter import with_true_starts
from mazeplan.core.errors import TableError
from mazeplan.core.logs.table import Table
from mazeplan.diagnosis.record import RingRecord, record_of
from mazeplan.diagnosis.stage.plate_motion import USUAL, Stage, commanded, fit_stage, from_sensor
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.geometry import Maze
from mazeplan.physics.dynamics.plate import PlateMotion
from mazeplan.physics.dynamics.walls import pack_walls
from mazeplan.physics.rig.stage import StageModel

FEWEST = 900  # minimum number of pictures of the ball
NEEDED = ("x", "y", "beta", "gamma")  # columns of a record of a whole rig
ROLLS = 0.1  # rad that a rolling ball turns at least in a stretch
PART, LEAST_PARTS, LEAST_PLAY = 15, 10, 0.8e-3  # pictures of a stretch; minimum number of stretches; minimum play, m
GUESSED = (  # right in a model of beads, whose inertia and other friction also stand in for walls
    "rolling", "tilt_beta", "tilt_gamma", "offset_x", "offset_y", "angle", "scale", "bend", "delay",
    "gain_beta", "gain_gamma",
)  # fmt: skip
FINEST = 5e-5  # m; least noise of a camera: where pictures are exact, an error over the fitted noise means nothing


def why_not_whole(tables: Sequence[Table], fewest: int = FEWEST) -> str:
    """Why records do not show a whole rig, in a few words; "" if they do. fewest: pictures of the ball

    A ball without play in its channel is a bead on a circle: the equation of one ring describes it."""
    if missing := [name for name in NEEDED if not all(name in table for table in tables)]:
        return f"the record has no {' and no '.join(missing)}"
    seen = sum(int(np.isfinite(table["x"]).sum()) for table in tables)
    if seen < fewest:
        return f"the ball is seen in {seen} pictures; all rings together need {fewest}"
    play = max(_play(table) for table in tables)
    held = "the ball hardly moves between the walls, as in a simulation without walls, or as a ball that is held"
    return "" if play > LEAST_PLAY else held


def _play(table: Table) -> float:
    """Variation of the ball's distance from the centre beyond noise, m, over stretches of PART pictures.

    Harmonics of the angle are removed first: an offset of the camera, a lens or a turned picture causes them."""
    n = len(table) // PART * PART
    x, y = (table[name][:n].reshape(-1, PART) for name in ("x", "y"))
    seen = np.isfinite(x + y).all(axis=1)
    angle = np.arctan2(y, x)
    rolls = np.ptp(np.unwrap(np.nan_to_num(angle), axis=1), axis=1) > ROLLS  # a ball that is held shows no play
    if (seen & rolls).sum() < LEAST_PARTS:
        return math.inf
    parts, angle = np.hypot(x, y)[seen & rolls], angle[seen & rolls]
    waves = np.stack([wave(k * angle) for k in (1, 2) for wave in (np.cos, np.sin)], axis=2)
    waves -= waves.mean(axis=1, keepdims=True)
    parts = parts - parts.mean(axis=1, keepdims=True)
    parts = parts - waves @ np.linalg.lstsq(waves.reshape(-1, 4), parts.ravel(), rcond=None)[0]
    noise = np.mean(np.diff(parts, 2, axis=1) ** 2) / 6.0  # a second difference has six times the noise's variance
    return math.sqrt(max(float(np.quantile(parts.var(axis=1, ddof=1), 0.9) - noise), 0.0))


def body_filter(table: Table, maze: Maze, kind: StageModel = USUAL) -> tuple[BodyFilter, Stage | None]:
    """The filter for a record with x and y, and the fitted stage, None without commands. Raises TableError.

    kind: a stage whose axes have the same orders"""
    record = whole_record(table)
    stage = fit_stage(record, np.ones(len(record), dtype=bool), kind)
    moves = None if stage is None or stage.servos_overtaxed else StageModel(*stage.axes)
    return filter_on_stage(table, maze, moves, record=record), stage


def whole_record(table: Table) -> RingRecord:
    """The record of all rows. Raises TableError if it does not show the ball often enough."""
    if "x" not in table or "y" not in table:
        raise TableError("got a table without x and y, expected where the camera saw the ball", file=table.place)
    seen = int(np.isfinite(table["x"] + table["y"]).sum())
    if seen < FEWEST:
        least = f"{FEWEST} at least ({FEWEST * table.dt:.0f} s)"
        raise TableError(f"got {seen} pictures of the ball, expected {least}", file=table.place)
    return record_of(table)


def filter_on_stage(
    table: Table, maze: Maze, stage: StageModel | None, like: BodyFilter | None = None, record: RingRecord | None = None
) -> BodyFilter:
    """The filter for a record with x and y. Raises TableError.

    stage: moves the plate by the commands; None: the measured tilt moves the plate
    like: a filter of the same pictures, which saves time
    record: of the table; None: `whole_record`"""
    record = whole_record(table) if record is None else record
    by_commands = None if stage is None or record.u is None else commanded(record.t, record.u, stage)
    tilt = by_commands or from_sensor(record)
    plate = PlateMotion(float(tilt.t[0]), float(tilt.t[1] - tilt.t[0]), np.ascontiguousarray(tilt.motion))
    if stage is not None and by_commands is not None:
        tilts = np.column_stack([record.beta, record.gamma])
        plate = with_true_starts(plate, tilts, record.begins, record.dt, (stage.beta, stage.gamma))
    y = np.column_stack([table["x"], table["y"]])
    clock = table["t"] - table["t"][0]
    ordered = bool(np.all(np.diff(clock) > 0.0))  # the time between several logs is unknown
    pictures = BallPictures(record.t, record.dt, y, record.begins, clock if ordered else None)
    # no picture was taken before its ball was there, up to a sample: the dead time is not known better
    dead = math.inf if stage is None else max(stage.beta.dead_time, stage.gamma.dead_time) + record.dt
    return BodyFilter(pictures, plate, pack_walls(maze), soonest=-dead, edge=None if like is None else like.edge)


def seconds_of(body: BodyFilter) -> float:
    """Length of the record in the time of its effects, s. It counts pictures where times of several logs overlap."""
    clock = body.pictures.t if body.pictures.clock is None else body.pictures.clock
    return float(clock[-1] - clock[0])


def residual_summary(body: BodyFilter, fit: BodyFit) -> tuple[float, float]:
    """What a fit does not explain: autocorrelation and size of its innovations.

    The first number is the largest autocorrelation: a cause without a name acts on several pictures alike. A negative
    one shows too much noise in the model, and counts as 0. The second number is the root mean square of the
    innovations, each over its standard deviation without unexplained forces, with a noise of at least FINEST."""
    model, nu = fit.model, fit.filtered.nu
    view = model.view._replace(noise=max(model.view.noise, FINEST))
    quiet = body.run(model._replace(view=view, wander=model.wander._replace(plane=1e-6, strike=1e-3)))
    keep = np.isfinite(nu[:, 0]) & np.isfinite(quiet.nu[:, 0])
    remaining = math.sqrt(float(np.mean(nu[keep] ** 2 / quiet.S[keep, :2])))
    return max(float(np.max(autocorrelation(fit.filtered))), 0.0), remaining


def first_guess(model: RigModel | None, maze: Maze) -> BodyModel:
    """The ball by a model of beads; the default ball without a model."""
    if model is None:
        return BodyModel()
    said = {name: values[0] for name in GUESSED if (values := bead_values(model, maze, name))}
    said["rolling"] = min(max(said.get("rolling", 0.0), 0.01), 1.0)
    if not model.delay_known:
        said["delay"] = BodyModel().view.delay
    return with_values(BodyModel(), said)
