"""What moves the plate in a record: its commands through a stage, or the measured tilt.

1. Commands and measured tilt alone show the stage, and what differs in it.
2. A changed gain belongs to the servo. If the ball felt tilts of the old size, it belongs to the tilt sensor.
3. Without a measured tilt, the stage of the model moves the plate, and the ball shows what changed.
4. Play behind the tilt sensor, or any play or limited rate without one, moves the plate later than the known stage.
   That looks like a later camera. So where the camera seems later, a changed stage is tried instead.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.optimize import minimize_scalar

from mazeplan.control.estimation.rigid_body_filter import BodyFilter
from mazeplan.control.estimation.rigid_body_fit import fit_body, value_of
from mazeplan.core.logs.table import Table
from mazeplan.diagnosis.document import Entry, effect_entry, values_of
from mazeplan.diagnosis.record import RingRecord, record_of
from mazeplan.diagnosis.rig.fitting import ENOUGH, NEEDED, NOISE, STDERR_SCALE, STEPS, Reference, without_finding
from mazeplan.diagnosis.rig.record import filter_on_stage, whole_record
from mazeplan.diagnosis.rig.reference import RigReference, kind_of
from mazeplan.diagnosis.rig.search import SearchResult
from mazeplan.diagnosis.rig.starts import check_map
from mazeplan.diagnosis.stage.comparison import AXES, DECISIVE, changed_gain, moved_by, on_known_zero, settled_on
from mazeplan.diagnosis.stage.navigation import gain_in_navigation
from mazeplan.diagnosis.stage.plate_motion import Stage, fit_stage
from mazeplan.learning.unmeasured_tilt import stage_by_ball, tilt_is_measured, with_tilt_by_commands
from mazeplan.maze.geometry import Maze
from mazeplan.physics.effect import Effect
from mazeplan.physics.effects import rig
from mazeplan.physics.rig.stage import StageModel

PLAY = (rig.backlash, (math.radians(0.05), math.radians(2.0)))  # its smallest and largest size that is tried, rad
RATE = (rig.rate_limit, (0.05, 2.0))  # rad/s
TRIED = 9  # sizes on a grid
CURVED = 0.2  # relative change of a size that shows the curvature of the rough likelihood


@dataclass(frozen=True)
class MovedPlate:
    """A record with what moves its plate."""

    table: Table  # with tilts by commands if none were measured
    record: RingRecord
    blind: bool  # whether nobody measures the tilt
    stage: Stage | None  # as this record shows it; None without commands or without a measured tilt
    moves: StageModel | None  # the stage that moves the plate; None: the measured tilt moves it
    measured: BodyFilter  # the filter of the ball on the tilt as measured
    body: BodyFilter  # and on the tilt as the ball felt it
    servo: Entry | None = None  # a changed gain, as one of the servo; None if it is one of the tilt sensor
    sensor: Entry | None = None  # a changed gain, as one of the tilt sensor
    unseen: Entry | None = None  # a change of the stage that no tilt sensor shows

    @property
    def overtaxed(self) -> bool:
        """Whether commands overtax the servos, so that the measured tilt moves the plate."""
        return self.stage is not None and self.stage.servos_overtaxed


def moved_plate(table: Table, maze: Maze, was: RigReference) -> tuple[MovedPlate, RigReference]:
    """What moves the plate in a record, and the reference beside this record's stage. Raises TableError."""
    if not tilt_is_measured(table) and "u_beta" in table and "u_gamma" in table:
        moves = was.stage.axes() or stage_by_ball(table, maze)
        table = with_tilt_by_commands(table, moves)
        record = whole_record(table)
        body = filter_on_stage(table, maze, moves, record=record)
        check_map(body, maze, table.place)
        return MovedPlate(table, record, True, None, moves, body, body), was
    record = whole_record(table)
    kind = was.stage.kind if was.body.start is None else kind_of(table)
    stage = fit_stage(record, np.ones(len(record), dtype=bool), kind)
    was = replace(was, stage=was.stage.beside(stage))
    stage = settled_on(stage, record, was.stage)
    moves = moved_by(stage, was.stage)
    body = filter_on_stage(table, maze, moves, record=record)
    check_map(body, maze, table.place)
    plate = MovedPlate(table, record, False, stage, moves, body, body)
    if stage is not None and stage.servos_overtaxed:
        servo, sensor = gain_in_navigation(record, stage, was.stage)
    else:
        servo, sensor = changed_gain(stage, was.stage)
    if servo is None or sensor is None:
        return plate, was
    on_felt, old = felt(body, sensor), was.body.model
    if was.body.start is None and body.run(old).minus2 - on_felt.run(old).minus2 > DECISIVE:
        return replace(plate, body=on_felt, sensor=sensor), was
    return replace(plate, servo=servo), was


def as_it_was(table: Table, maze: Maze, was: RigReference, stage: Stage | None, body: BodyFilter) -> BodyFilter:
    """The filter with the plate moved by the old model's stage; `body` if one of the stages cannot be used."""
    known = was.stage.axes()
    if known is None or stage is None or stage.servos_overtaxed:
        return body
    return filter_on_stage(table, maze, on_known_zero(stage, was.stage, known), record=record_of(table))


def felt(body: BodyFilter, sensor: Entry) -> BodyFilter:
    """The filter with true tilts, which are smaller than the measured ones by the growth of the sensor's scale."""
    grown = [value / sensor["known_before"][axis] for axis, value in values_of(sensor).items()]
    plate = body.plate._replace(motion=body.plate.motion / np.repeat(grown, 3))
    return BodyFilter(body.pictures, plate, body.walls, body.soonest)


def with_unseen_change(plate: MovedPlate, searched: SearchResult, was: Reference, maze: Maze) -> MovedPlate | None:
    """The record on a changed stage that explains it better than a later camera by `NEEDED`, or None."""
    later = next((c for c in searched.candidates if c.effect == "sensor_delay"), None)
    moves = plate.moves
    if moves is None or later is None or searched.fit.value("delay") <= value_of(was.model, "delay"):
        return None
    model = without_finding(searched.fit.model, was, later)
    beside = tuple(name for c in searched.candidates if c is not later for name in c.fitted)
    most, best = NEEDED, None
    for effect, within in (PLAY, RATE) if plate.blind else (PLAY,):
        on_stage = partial(_on_changed_stage, plate, maze, moves, effect)
        sizes, stderr = _likeliest(lambda sizes, on=on_stage: on(sizes)[1].innovations(model).minus2, within)
        new, body = on_stage(sizes)
        gained = searched.fit.minus2 - fit_body(body, model, (*NOISE, *beside), STEPS, ENOUGH).minus2
        if gained > most:
            error = {axis: STDERR_SCALE * was.misfit * s for axis, s in zip(AXES, stderr, strict=True)}
            entry = effect_entry(effect, _sizes(new, effect), error, _sizes(moves, effect))
            most, best = gained, replace(plate, body=body, moves=new, unseen=entry)
    return best


def _on_changed_stage(
    plate: MovedPlate, maze: Maze, moves: StageModel, effect: Effect, sizes: Sequence[float]
) -> tuple[StageModel, BodyFilter]:
    """The stage with more play behind it, or with limited rates, and the filter of the ball on it."""
    axes = []
    for axis, size in zip((moves.beta, moves.gamma), sizes, strict=True):
        if effect is rig.backlash:
            axes.append(replace(axis, backlash=axis.backlash + size, behind=True))
        else:
            axes.append(replace(axis, rate_limit=min(size, axis.rate_limit)))
    new = StageModel(*axes)
    return new, filter_on_stage(plate.table, maze, new, plate.body, plate.record)


def _sizes(stage: StageModel, effect: Effect) -> dict[str, float]:
    return {
        axis: min(float(getattr(getattr(stage, axis), effect.name)), p.high) for axis, p in effect.parameters.items()
    }


def _likeliest(minus2: Callable[[list[float]], float], within: tuple[float, float]) -> tuple[list[float], list[float]]:
    """Sizes of both axes at which a record is likeliest, and their standard errors by the curvature there.

    Both axes are alike on a grid; then each is refined by itself."""
    grid = np.geomspace(*within, TRIED)
    sizes = [float(grid[np.argmin([minus2([size, size]) for size in grid])])] * 2
    around = math.log(float(grid[1] / grid[0]))

    def with_axis(axis: int, size: float) -> float:
        return minus2([size if i == axis else other for i, other in enumerate(sizes)])

    for axis in (0, 1, 0, 1):
        at = math.log(sizes[axis])
        found = minimize_scalar(
            lambda log, axis=axis: with_axis(axis, math.exp(log)), bounds=(at - around, at + around), method="bounded",
            options={"maxiter": 8},
        )  # fmt: skip
        sizes[axis] = math.exp(float(found.x))
    least, stderr = minus2(sizes), []
    for axis in (0, 1):
        rises = [with_axis(axis, sizes[axis] * (1.0 + sign * CURVED)) - least for sign in (1.0, -1.0)]
        stderr.append(CURVED * sizes[axis] * math.sqrt(2.0 / max(sum(rises), 1e-9)))
    return sizes, stderr
