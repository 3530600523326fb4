"""What moves the plate in a record: its commands through a stage, or the measured tilt.

1. Commands and measured tilt alone show the stage, and what differs in it.
2. A changed gain belongs to the servo. If the ball felt tilts of the old size, it belongs to the tilt sensor.
3. Without a measured tilt, the stage of the model moves the plate, and the ball shows what changed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mazeplan.control.estimation.rigid_body_filter import BodyFilter
from mazeplan.core.logs.table import Table
from mazeplan.diagnosis.effect_entry import Entry, values_of
from mazeplan.diagnosis.record import RingRecord, record_of
from mazeplan.diagnosis.rig.record import filter_on_stage, whole_record
from mazeplan.diagnosis.rig.reference import RigReference, kind_of
from mazeplan.diagnosis.rig.starts import check_map
from mazeplan.diagnosis.stage.comparison import DECISIVE, changed_gain, moved_by, on_known_zero, settled_on
from mazeplan.diagnosis.stage.navigation import gain_in_navigation
from mazeplan.diagnosis.stage.plate_motion import Stage, fit_stage
from mazeplan.learning.unmeasured_tilt import stage_by_ball, tilt_is_measured, with_tilt_by_commands
from mazeplan.maze.geometry import Maze
from mazeplan.physics.rig.stage import StageModel


@dataclass(frozen=True)
class MovedPlate:
    """A record with what moves its plate.

    table, record: with tilts by commands if none were measured
    blind: whether nobody measures the tilt
    stage: as this record shows it; None without commands or without a measured tilt
    moves: the stage that moves the plate; None: the measured tilt moves it
    measured, body: the filter of the ball on the tilt as measured, and on the tilt as the ball felt it
    servo, sensor: a changed gain, as one of the servo or of the tilt sensor; the other is None"""

    table: Table
    record: RingRecord
    blind: bool
    stage: Stage | None
    moves: StageModel | None
    measured: BodyFilter
    body: BodyFilter
    servo: Entry | None = None
    sensor: Entry | None = None

    @property
    def overtaxed(self) -> bool:
        """Whether commands overtax the servos, so that the measured tilt moves the plate."""
        return self.stage is not None and self.stage.servos_overtaxed

    def as_it_was(self, maze: Maze, was: RigReference) -> BodyFilter:
        """The filter as the old model believes, which does not know of another scale of the sensor."""
        return self.measured if self.sensor is not None else as_it_was(self.table, maze, was, self.stage, self.body)


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
    kind = was.stage.kind if was.stage.values else kind_of(table)
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
    if body.run(old).minus2 - on_felt.run(old).minus2 > DECISIVE:
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
