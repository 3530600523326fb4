"""What a record shows of the servos although its commands overtax them, as in navigation.

No linear lag describes such servos, so the fit of the stage is wrong: servos look slower and later, and play looks like
a dead band. But a healthy rig looks nearly the same each time. The limits below lie outside of what 47 records of
navigation showed (simulated, rigs `toy` and `rough`).

The ball is then predicted from the measured tilt, which is the same with the old numbers of the servos and with the new
ones. But the commands predict the tilt, so held-out blocks of measured tilt can judge a changed gain or coupling.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mazeplan.core.records import Array
from mazeplan.diagnosis.document import Entry, values_of
from mazeplan.diagnosis.record import RingRecord
from mazeplan.diagnosis.stage.comparison import AXES, COUPLINGS, SURE, Known, changed, changed_gain
from mazeplan.diagnosis.stage.plate_motion import Stage
from mazeplan.learning.stage_fit import BLOCK_S
from mazeplan.physics.effects import rig
from mazeplan.physics.rig.stage import StageAxis, actuator_output, simulate_axis

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
    return any(max(pair) > 0.0 for pair in known.looseness(stage).values())


def coupling_in_navigation(record: RingRecord, stage: Stage, known: Known) -> list[Entry]:
    """An entry of the coupling of the axes if it surely changed."""
    entry = changed(stage, rig.axis_coupling, known)
    if entry is None:
        return []
    entry, had = _less_certain(entry, COUPLING_ERROR), entry["known_before"]
    sure = any(abs(p["value"] - had[key]) > SURE * p["stderr"] for key, p in entry["parameters"].items())
    was = (had[COUPLINGS[AXES[0]]], had[COUPLINGS[AXES[1]]])
    return [entry] if sure and nearer_tilt(record, stage, was, True) > BETTER else []


def servos_look_changed(stage: Stage, known: Known) -> list[str]:
    """What the servos do that they did not do before, in words; such a record does not show its cause or its size."""
    looser = [axis for axis, (now, old) in known.looseness(stage).items() if now - old > LOOSER]
    words = [f"the servo of {axis} has play or a dead band" for axis in looser]
    was = known.axes()
    if was is None:
        return words
    axes = list(zip(AXES, stage.axes, (was.beta, was.gamma), strict=True))
    for axis, now, old in axes:
        if now.order == old.order and now.natural_frequency < SLOWER * old.natural_frequency:
            words.append(f"the servo of {axis} is slower")
    # a first-order lag with a dead time looks like a second-order servo: their sum counts
    later = min(_linear_lag(now) - _linear_lag(old) for _, now, old in axes)
    return [*words, "the plate follows commands later"] if later > LATER else words


def _linear_lag(axis: StageAxis) -> float:
    """Dead time and lag of an axis, s, without a limited rate: commands that overtax servos look like one."""
    return axis.dead_time + replace(axis, rate_limit=math.inf).lag


def _less_certain(entry: Entry, error: float) -> Entry:
    """The entry, with a further error in each number."""
    numbers = {key: n | {"stderr": math.hypot(n["stderr"], error)} for key, n in entry["parameters"].items()}
    return entry | {"parameters": numbers}


def nearer_tilt(record: RingRecord, stage: Stage, was: tuple[float, float], coupling: bool = False) -> float:
    """Standard errors by which the record's gains predict blocks of measured tilt better than the old gains `was`.

    coupling: compare couplings, the share of the other axis' command that an axis follows, instead of gains

    Both predictions use the lag of the fitted stage, each with its own offsets. Offsets and new gains for one half of
    the record come from the other half. For couplings, that is also where the gains of both predictions come from."""
    assert record.u is not None, "without commands there is no stage"
    second, gain = np.arange(len(record)) >= len(record) // 2, np.zeros(len(record))
    u, angles = record.u.T, (record.beta, record.gamma)
    for axis, own, other, angle, old in zip(stage.axes, u, u[::-1], angles, was, strict=True):
        follows, beside = (_follows(axis, command, record.dt) for command in (own, other))
        for rows in (second, ~second):
            if coupling:
                before, after = _left(angle, [follows + old * beside], rows), _left(angle, [follows, beside], rows)
            else:
                known = angle - old * follows
                before, after = known[rows] - np.mean(known[~rows]), _left(angle, [follows], rows)
            gain[rows] += before**2 - after**2
    blocks = np.arange(len(gain)) // max(round(BLOCK_S / record.dt), 1)
    by_block = np.bincount(blocks, weights=gain)
    return float(by_block.mean()) / max(float(by_block.std(ddof=1)) / math.sqrt(len(by_block)), 1e-12)


def _follows(axis: StageAxis, u: Array, dt: float) -> Array:
    """Angles (N,) of the axis under commands u (N,), with gain one and without offset."""
    return simulate_axis(replace(axis, gain=1.0, offset=0.0), actuator_output(u, axis), dt)


def _left(angle: Array, follows: Sequence[Array], rows: np.ndarray) -> Array:
    """Measured minus predicted angle (K,) in some rows. Offset and factors of `follows` come from the other rows."""
    columns = np.column_stack([*follows, np.ones(len(angle))])
    fitted, *_ = np.linalg.lstsq(columns[~rows], angle[~rows], rcond=None)
    return np.asarray(angle[rows] - columns[rows] @ fitted)
