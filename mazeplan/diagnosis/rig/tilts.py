"""The tilt as the ball feels it: with a changed scale of the tilt sensor, and by the stage as it was."""

from __future__ import annotations

import numpy as np

from mazeplan.control.estimation.rigid_body_filter import BodyFilter
from mazeplan.core.logs.table import Table
from mazeplan.diagnosis.effect_entry import Entry, values_of
from mazeplan.diagnosis.record import RingRecord, record_of
from mazeplan.diagnosis.rig.record import filter_of
from mazeplan.diagnosis.rig.reference import RigReference
from mazeplan.diagnosis.stage.comparison import DECISIVE, changed_gain, on_known_zero
from mazeplan.diagnosis.stage.navigation import gain_in_navigation
from mazeplan.diagnosis.stage.plate_motion import Stage
from mazeplan.maze.geometry import Maze


def as_it_was(table: Table, maze: Maze, was: RigReference, stage: Stage | None, body: BodyFilter) -> BodyFilter:
    """The filter with the plate moved by the old model's stage; `body` if one of the stages cannot be used."""
    known = was.stage.axes()
    if known is None or stage is None or stage.servos_overtaxed:
        return body
    return filter_of(table, record_of(table), maze, on_known_zero(stage, was.stage, known))


def gain_of(
    body: BodyFilter, record: RingRecord, stage: Stage | None, was: RigReference
) -> tuple[Entry | None, Entry | None]:
    """A changed gain as an entry of the servo, or of the tilt sensor; the other entry is None.

    It belongs to the tilt sensor if the ball felt tilts of the old size."""
    if stage is not None and stage.servos_overtaxed:
        servo, sensor = gain_in_navigation(record, stage, was.stage)
    else:
        servo, sensor = changed_gain(stage, was.stage)
    if servo is None or sensor is None:
        return None, None
    if was.body.start is not None:
        return servo, None
    by_servo, by_sensor = (one.run(was.body.model).minus2 for one in (body, felt(body, sensor)))
    return (None, sensor) if by_servo - by_sensor > DECISIVE else (servo, None)


def felt(body: BodyFilter, sensor: Entry) -> BodyFilter:
    """The filter with true tilts, which are smaller than the measured ones by the growth of the sensor's scale."""
    grown = [value / sensor["known_before"][axis] for axis, value in values_of(sensor).items()]
    plate = body.plate._replace(motion=body.plate.motion / np.repeat(grown, 3))
    return BodyFilter(body.pictures, plate, body.walls, body.soonest)
