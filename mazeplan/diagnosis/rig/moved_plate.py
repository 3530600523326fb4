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
from mazeplan.diagnosis.effect_entry import Entry
from mazeplan.diagnosis.record import RingRecord
from mazeplan.diagnosis.rig.camera import check_map
from mazeplan.diagnosis.rig.record import filter_of, whole_record
from mazeplan.diagnosis.rig.reference import RigReference, kind_of
from mazeplan.diagnosis.rig.tilts import as_it_was, felt, gain_of
from mazeplan.diagnosis.rig.unseen_stage import UnseenChange
from mazeplan.diagnosis.stage.comparison import moved_by, settled_on
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
    servo, sensor: a changed gain, as one of the servo or of the tilt sensor; the other is None
    unseen: a change of the stage that no tilt sensor shows"""

    table: Table
    record: RingRecord
    blind: bool
    stage: Stage | None
    moves: StageModel | None
    measured: BodyFilter
    body: BodyFilter
    servo: Entry | None
    sensor: Entry | None
    unseen: UnseenChange | None = None

    @property
    def overtaxed(self) -> bool:
        """Whether commands overtax the servos, so that the measured tilt moves the plate."""
        return self.stage is not None and self.stage.servos_overtaxed

    @property
    def stage_is_known(self) -> bool:
        """Whether the tilt shows no change of the stage but its gain."""
        return not self.overtaxed and (self.stage is None or not self.stage.differs)

    def filter_on(self, maze: Maze, moves: StageModel | None) -> BodyFilter:
        """The filter of the record with another stage."""
        return filter_of(self.table, self.record, maze, moves, self.body)

    def behind(self, unseen: UnseenChange) -> MovedPlate:
        """The record with the plate moved by a changed stage."""
        return replace(self, body=unseen.body, moves=unseen.moves, unseen=unseen)

    def as_it_was(self, maze: Maze, was: RigReference) -> BodyFilter:
        """The filter as the old model believes: it does not know of another scale of the sensor or of unseen play."""
        if self.sensor is not None or self.unseen is not None:
            return self.measured
        return as_it_was(self.table, maze, was, self.stage, self.body)


def moved_plate(table: Table, maze: Maze, was: RigReference) -> tuple[MovedPlate, RigReference]:
    """What moves the plate in a record, and the reference beside this record's stage. Raises TableError."""
    blind = not tilt_is_measured(table) and "u_beta" in table and "u_gamma" in table
    if blind:
        stage, moves = None, was.stage.axes() or stage_by_ball(table, maze)
        table = with_tilt_by_commands(table, moves)
        record = whole_record(table)
    else:
        record = whole_record(table)
        kind = was.stage.kind if was.body.start is None else kind_of(table)
        stage = fit_stage(record, np.ones(len(record), dtype=bool), kind)
        was = replace(was, stage=was.stage.beside(stage))
        stage = settled_on(stage, record, was.stage)
        moves = moved_by(stage, was.stage)
    body = filter_of(table, record, maze, moves)
    check_map(body, maze, table.place)
    servo, sensor = gain_of(body, record, stage, was)
    on_felt = body if sensor is None else felt(body, sensor)
    return MovedPlate(table, record, blind, stage, moves, body, on_felt, servo, sensor), was
