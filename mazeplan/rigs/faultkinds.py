"""What can be made to go wrong with any rig: kinds of faults, how long and how strong they are unless a schedule says
otherwise, and whether a run can get over them.

Faults of camera, tilt sensor, clock and commands happen on the way to and from the rig (`faulty.py`); those of the
machine inside it, which the simulated rig offers (`SimulatedRig.inject`); orders close openings in the route graph.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mazeplan.records import FailureKind

Range = tuple[float, float]  # least and most; each run draws between them
AT_S: Range = (0.3, 1.5)  # s; the ball is on its way then
FOR_GOOD: Range = (math.inf, math.inf)
ONCE: Range = (0.0, 0.0)

GAVE_UP = tuple(str(kind) for kind in FailureKind)


@dataclass(frozen=True)
class Kind:
    """One kind of fault. place: camera, tilt, clock, commands, rig, machine or orders; duration_s: inf: for good, 0: at
    one moment; size in `unit`; ends: reasons with which a run that cannot get over it, `because`, ought to end."""

    name: str
    place: str
    what: str
    duration_s: Range
    size: Range | None = None
    unit: str = ""
    allowed: Range = (0.0, 1e3)  # of the size
    because: str = ""
    ends: tuple[str, ...] = GAVE_UP

    @property
    def survivable(self) -> bool:
        """Whether a run is expected to arrive in spite of it."""
        return not self.because


_ALL = (
    Kind("frames_lost", "camera", "no picture shows the ball", (0.6, 1.5)),
    Kind("frames_flicker", "camera", "so many pictures without the ball", (1.0, 2.0), (0.5, 0.8), "share", (0.0, 1.0)),
    Kind("frames_frozen", "camera", "the same picture again and again", (0.3, 1.0)),
    Kind("frames_late", "camera", "pictures are older than usual", (0.5, 1.5), (0.1, 0.3), "s"),
    Kind(
        "frames_duplicated", "camera", "the last sample once more, with its time", (0.5, 1.5), (0.3, 0.6), "share",
        (0.0, 1.0),
    ),
    Kind(
        "frames_out_of_order", "camera", "any of the last samples, with its time", (0.5, 1.5), (2.0, 5.0), "samples",
        (2.0, 60.0),
    ),
    Kind("axes_swapped", "camera", "x and y exchanged", (1.0, 1.0)),
    Kind("false_ball", "camera", "something at rest elsewhere is taken for the ball", (0.3, 1.0)),
    Kind("position_nan", "camera", "x and y are no numbers", (0.2, 1.0)),
    Kind("tilt_drift", "tilt", "the sensor goes astray, evenly, then is right again", (1.0, 2.0), (1.0, 3.0), "deg"),
    Kind("tilt_spikes", "tilt", "three samples in ten are far off", (0.5, 1.5), (3.0, 30.0), "deg"),
    Kind("tilt_frozen", "tilt", "the sensor stands still", (0.3, 1.0)),
    Kind("tilt_nan", "tilt", "the sensor says no number for a few samples", (0.05, 0.2)),
    Kind("clock_jitter", "clock", "times of samples are off by chance, 1 sigma", (1.0, 2.0), (2.0, 8.0), "ms"),
    Kind("clock_jump", "clock", "the clock is put forward", FOR_GOOD, (0.2, 1.0), "s"),
    Kind("commands_lost", "commands", "no command arrives", (0.2, 0.8)),
    Kind("commands_late", "commands", "commands arrive later", (0.5, 1.5), (0.05, 0.2), "s"),
    Kind("ball_elsewhere", "machine", "the ball is put into another ring", ONCE),
    Kind("ball_taken_out", "machine", "the ball is taken out and put back", (0.5, 2.0)),
    Kind("ball_stuck", "machine", "the ball sticks to the floor", (0.4, 1.2)),
    Kind("ball_pushed", "machine", "somebody pushes the ball", ONCE, (0.1, 0.4), "m/s", (0.0, 2.0)),
    Kind("gate_blocked", "machine", "a plug in the opening that is next", FOR_GOOD),
    Kind("servo_stuck", "machine", "one servo stands still", (0.3, 1.0)),
    Kind("servo_slow", "machine", "one servo is slow", (0.5, 1.5), (5.0, 20.0), "deg/s", (0.1, 1e3)),
    Kind("servo_offset", "machine", "one servo stands beside its commands", (1.0, 3.0), (0.5, 2.0), "deg", (0.0, 5.0)),
    Kind("brown_out", "machine", "both servos without current, the plate goes to its middle", (0.2, 0.6)),
    Kind("opening_closed", "orders", "the opening that is next is closed from outside", FOR_GOOD),
    Kind(
        "camera_dead", "camera", "no picture shows the ball any more", FOR_GOOD,
        because="nothing tells where the ball is", ends=("ball_lost", "out_of_time"),
    ),
    Kind(
        "tilt_dead", "tilt", "the sensor says no number any more", FOR_GOOD,
        because="nothing tells whether the plate obeys", ends=("rig_failed",),
    ),
    Kind(
        "clock_stopped", "clock", "the time of all samples is the same", FOR_GOOD,
        because="nothing tells how old a sample is", ends=("rig_failed",),
    ),
    Kind(
        "observe_raises", "rig", "observe() raises RigError", FOR_GOOD,
        because="the rig itself says that it failed", ends=("rig_failed",),
    ),
    Kind(
        "observe_hangs", "rig", "observe() does not come back", ONCE, (5.0, 5.0), "s",
        because="nothing is measured while the plate is tilted", ends=("rig_failed",),
    ),
    Kind(
        "ball_gone", "machine", "the ball is taken out for good", FOR_GOOD,
        because="there is no ball", ends=("ball_lost", "out_of_time"),
    ),
    Kind(
        "gates_blocked", "machine", "plugs in all openings of the ring's inner wall", FOR_GOOD,
        because="no way is left, and nobody tells", ends=("missed_opening", "stuck", "out_of_time"),
    ),
    Kind(
        "openings_closed", "orders", "all openings on the way to the next ring are closed from outside", FOR_GOOD,
        because="no way is left", ends=("no_route", "opening_closed"),
    ),
)  # fmt: skip
KINDS = {kind.name: kind for kind in _ALL}
