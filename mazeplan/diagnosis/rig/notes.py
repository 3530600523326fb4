"""Notes on what a record of a rig could not be compared with."""

from __future__ import annotations

import numpy as np

from mazeplan.core.logs.table import Table
from mazeplan.diagnosis.rig.reference import RigReference
from mazeplan.diagnosis.stage.comparison import AXES
from mazeplan.diagnosis.stage.navigation import hidden_gain
from mazeplan.diagnosis.stage.plate_motion import Stage
from mazeplan.learning.stage_fit import LEAST_RANGE


def _why_no_stage(table: Table) -> str:
    """Why the commands of a record do not show the stage."""
    commands = [f"u_{axis}" for axis in AXES]
    if not all(name in table for name in commands):
        return f"no commands {', '.join(commands)} in this record"
    still = [axis for axis, name in zip(AXES, commands, strict=True) if np.ptp(table[name]) < LEAST_RANGE]
    if len(still) > 1:
        return f"the commands of {' and '.join(still)} never change"
    return f"the command of {still[0]} never changes" if still else "the commands are too few"


def notes_on(table: Table, stage: Stage | None, was: RigReference, blind: bool) -> list[str]:
    """Notes on what could not be compared. blind: whether nobody measures the tilt"""
    notes = []
    if was.body.start is not None:
        notes.append(
            "what differs from a textbook ball need not be a fault: to find faults, learn a model while the rig is in "
            "order, and name it with --model"
        )
    if stage is None:
        notes.append(
            "nobody measures the tilt: the servos show only through the ball"
            if blind
            else f"{_why_no_stage(table)}: servos cannot be checked, and the tilt is smoothed"
        )
    if stage is not None and stage.servos_overtaxed:
        notes.append(
            "the servos cannot follow the commands of this record, as in navigation, or with a servo that became slow "
            "or loose, so only large changes of the servos were looked for"
        )
        if hidden_gain(stage, was.stage):
            notes.append("gains of the servos were not compared: play or a dead band makes them look smaller")
    if was.body.open and was.friction is not None:
        notes.append(
            "the model keeps no record of the rig as it was: walls were not compared, and friction only "
            "roughly; name a log of that time with --reference, or learn the model again"
        )
    return notes
