"""What a record shows of the servos although its commands overtax them, as in navigation.

No linear lag describes such servos, so the fit of the stage is wrong: servos look slower and later, and play looks like
a dead band. But a healthy rig looks nearly the same each time. The limits below lie outside of what 47 records of
navigation showed (simulated, rigs `toy` and `rough`).
"""

from __future__ import annotations

import math
from dataclasses import replace

from mazeplan.diagnosis.effect_entry import Entry, values_of
from mazeplan.diagnosis.record import RingRecord
from mazeplan.diagnosis.stage.comparison import (
    AXES,
    COUPLINGS,
    PLAY_AND_DEADBAND,
    SURE,
    Known,
    changed,
    changed_gain,
)
from mazeplan.diagnosis.stage.held_out import nearer_by_coupling, nearer_tilt
from mazeplan.diagnosis.stage.plate_motion import Stage
from mazeplan.physics.effects import rig
from mazeplan.physics.rig.stage import StageAxis

BETTER = 2.0  # standard errors by which held-out blocks of measured tilt have to be predicted better
GAIN_ERROR, COUPLING_ERROR = 0.015, 0.01  # standard errors that overtaxed servos cause
CLEAR_GAIN = 0.07  # minimum change of a gain; healthy servos looked 0.05 weaker to 0.05 stronger
LATER = 0.03  # s, minimum change of the delay; healthy servos looked up to 0.02 s later
SLOWER = 0.66  # maximum share of the natural frequency; healthy servos had 0.75 of it or more
LOOSER = 0.003  # rad, minimum change of play and dead band together


def gain_in_navigation(record: RingRecord, stage: Stage, known: Known) -> tuple[Entry | None, Entry | None]:
    """A clearly changed gain, as an entry of the servo and as an entry of the tilt sensor; None if there is none.

    Play makes a gain look smaller, so nothing is said of a stage with play."""
    servo, sensor = changed_gain(stage, known)
    if servo is None or sensor is None or hidden_gain(stage, known):
        return None, None
    had = servo["known_before"]
    clear = max(abs(value / had[key] - 1.0) for key, value in values_of(servo).items()) > CLEAR_GAIN
    if not clear or nearer_tilt(record, stage, (had[AXES[0]], had[AXES[1]])) <= BETTER:
        return None, None
    return _less_certain(servo, GAIN_ERROR), _less_certain(sensor, GAIN_ERROR)


def hidden_gain(stage: Stage, known: Known) -> bool:
    """Whether play or a dead band, seen or known, hide a changed gain."""
    return any(_loose(stage, axis) > 0.0 or _known_loose(known, axis) > 0.0 for axis in AXES)


def coupling_in_navigation(record: RingRecord, stage: Stage, known: Known) -> list[Entry]:
    """An entry of the coupling of the axes if it surely changed."""
    entry = changed(stage, rig.axis_coupling, known)
    if entry is None:
        return []
    entry, had = _less_certain(entry, COUPLING_ERROR), entry["known_before"]
    sure = any(abs(p["value"] - had[key]) > SURE * p["stderr"] for key, p in entry["parameters"].items())
    was = (had[COUPLINGS[AXES[0]]], had[COUPLINGS[AXES[1]]])
    return [entry] if sure and nearer_by_coupling(record, stage, was) > BETTER else []


def servos_look_changed(stage: Stage, known: Known) -> list[str]:
    """What the servos do that they did not do before, in words; such a record does not show its cause or its size."""
    looser = [axis for axis in AXES if _loose(stage, axis) - _known_loose(known, axis) > LOOSER]
    words = [f"the servo of {axis} has play or a dead band" for axis in looser]
    was = known.axes()
    if was is None:
        return words
    axes = list(zip(AXES, stage.axes, (was.beta, was.gamma), strict=True))
    slower = [
        name for name, now, old in axes
        if now.order == old.order and now.natural_frequency < SLOWER * old.natural_frequency
    ]  # fmt: skip
    # a first-order lag with a dead time looks like a second-order servo: their sum counts
    later = min(_linear_lag(now) - _linear_lag(old) for _, now, old in axes)
    words += [f"the servo of {axis} is slower" for axis in slower]
    return [*words, "the plate follows commands later"] if later > LATER else words


def _linear_lag(axis: StageAxis) -> float:
    """Dead time and lag of an axis, s, without a limited rate: commands that overtax servos look like one."""
    return axis.dead_time + replace(axis, rate_limit=math.inf).lag


def _loose(stage: Stage, axis: str) -> float:
    """Play and dead band of an axis in a record, rad."""
    seen = stage.axes[AXES.index(axis)]
    return seen.backlash + seen.deadband


def _known_loose(known: Known, axis: str) -> float:
    return sum(known.values.get(effect.name, {}).get(axis, 0.0) for effect in PLAY_AND_DEADBAND)


def _less_certain(entry: Entry, error: float) -> Entry:
    """The entry, with a further error in each number."""
    numbers = {key: n | {"stderr": math.hypot(n["stderr"], error)} for key, n in entry["parameters"].items()}
    return entry | {"parameters": numbers}
