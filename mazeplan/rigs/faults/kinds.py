"""Kinds of faults: where they act, how long, how strongly, and how a run should end.

Faults of camera, tilt sensor and clock change the samples of the rig (`FaultKind.change`). For faults of the machine,
the rig needs `inject`, as simulated rigs have (`FaultKind.machine`). `faulty.FaultyRig` makes the other faults: it
loses and delays commands, raises errors, hangs, and closes openings in the route graph.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mazeplan.core.records import FailureKind, Observation
from mazeplan.maze.geometry import Maze

Range = tuple[float, float]  # minimum and maximum; each run draws between them
AT_S: Range = (0.3, 1.5)  # s, default start of a fault: the ball is on its way then
FOR_GOOD: Range = (math.inf, math.inf)
ONCE: Range = (0.0, 0.0)
SHARE: Range = (0.0, 1.0)
AGE_S: Range = (0.0, 10.0)  # s
JUMP_S: Range = (0.0, 60.0)  # s
ANGLE_DEG: Range = (0.0, 90.0)
GAVE_UP = tuple(str(kind) for kind in FailureKind)
SPIKES = 0.3  # share of the samples with a spike


@dataclass(frozen=True)
class FaultKind:
    """One kind of fault."""

    name: str
    place: str  # where it acts: camera, tilt, clock, commands, rig, machine or orders
    what: str
    duration_s: Range  # inf: for good, 0: at one moment
    size: Range | None = None  # default range of the size, in `unit`; None: the kind has no size
    unit: str = ""
    allowed: Range = (0.0, 1e3)  # of the sizes in a schedule
    because: str = ""  # why a run cannot recover from the fault; empty if it can
    ends: tuple[str, ...] = GAVE_UP  # reasons with which a run may end if it does not reach its goal
    change: Callable[[FaultContext], Observation] | None = None  # of a sample
    machine: str = ""  # kind of `sim.settings.Fault`; empty for a fault that does not act in the machine
    machine_size: str = ""  # key of `sim.settings.Fault` that takes the size

    def __reduce__(self) -> tuple[Callable[[str], FaultKind], tuple[str]]:
        """Pickle the kind by its name: `change` is often a lambda, which cannot be pickled."""
        return kind_of, (self.name,)


@dataclass(frozen=True)
class Drawn:
    """One fault of one run. It acts at at_s <= t < until_s."""

    kind: FaultKind
    at_s: float
    until_s: float
    size: float  # in the unit of the kind
    axes: tuple[int, ...]  # on which it acts, 0 (beta) and 1 (gamma)
    seed: int  # of its random numbers

    def acts(self, t: float) -> bool:
        """Whether the fault acts at time t."""
        return self.at_s <= t < self.until_s

    def to_json(self) -> dict[str, Any]:
        """The fault as JSON for the report of a run; duration_s is None for a fault for good."""
        lasting = None if math.isinf(self.until_s) else round(self.until_s - self.at_s, 4)
        size = None if self.kind.size is None else round(self.size, 4)
        what = {"kind": self.kind.name, "at_s": round(self.at_s, 4), "duration_s": lasting}
        return {**what, "size": size, "unit": self.kind.unit or None}


def sample_at(past: Sequence[Observation], t: float) -> Observation:
    """The sample at time t or the last one before; the oldest sample if all are newer."""
    return next((sample for sample in reversed(past) if sample.t <= t + 1e-9), past[0])


@dataclass(frozen=True)
class FaultContext:
    """A sample on its way from the rig to the program, for a fault to change."""

    fault: Drawn
    past: Sequence[Observation]  # unchanged samples of the rig until now, as many as the latest picture needs
    sample: Observation  # the newest sample, with the changes of earlier faults
    rng: np.random.Generator  # random numbers of the fault
    maze: Maze
    start: Observation  # unchanged sample of the rig at the start of the fault

    def with_ball(self, x: float | None, y: float | None) -> Observation:
        """The sample with the ball at x, y, m; None: without a ball."""
        return replace(self.sample, x=x, y=y)

    def with_tilt(self, change: Callable[[float], float]) -> Observation:
        """The sample with `change` applied to the tilt of the fault's axes."""
        tilt = (self.sample.beta, self.sample.gamma)
        beta, gamma = (change(angle) if axis in self.fault.axes else angle for axis, angle in enumerate(tilt))
        return replace(self.sample, beta=beta, gamma=gamma)


def _lost(p: FaultContext) -> Observation:
    return p.with_ball(None, None)


def _late(p: FaultContext) -> Observation:
    then = sample_at(p.past, p.sample.t - p.fault.size)
    return p.with_ball(then.x, then.y)


def _false_ball(p: FaultContext) -> Observation:
    rng = np.random.default_rng(p.fault.seed)  # the same place in all samples
    radius = p.maze.track_radius(1 + int(rng.integers(len(p.maze.rings) - 1)))
    angle = float(rng.uniform(-math.pi, math.pi))
    return p.with_ball(radius * math.cos(angle), radius * math.sin(angle))


def _drift(p: FaultContext) -> Observation:
    fault, sign = p.fault, 1.0 if p.fault.seed % 2 else -1.0
    lasting = fault.until_s - fault.at_s
    share = (p.sample.t - fault.at_s) / lasting if math.isfinite(lasting) else min(1.0, p.sample.t - fault.at_s)
    return p.with_tilt(lambda angle: angle + sign * share * math.radians(fault.size))


def _spikes(p: FaultContext) -> Observation:
    chance, side = p.rng.random(2)
    off = math.copysign(math.radians(p.fault.size), side - 0.5) if chance < SPIKES else 0.0
    return p.with_tilt(lambda angle: angle + off)


def _tilt_frozen(p: FaultContext) -> Observation:
    beta, gamma = (p.start if axis in p.fault.axes else p.sample for axis in (0, 1))
    return replace(p.sample, beta=beta.beta, gamma=gamma.gamma)


def _tilt_nan(p: FaultContext) -> Observation:
    return p.with_tilt(lambda angle: math.nan)


def _duplicated(p: FaultContext) -> Observation:
    return p.past[-2] if len(p.past) > 1 and p.rng.random() < p.fault.size else p.sample


_ALL = (
    FaultKind("frames_lost", "camera", "no picture shows the ball", (0.6, 1.5), change=_lost),
    FaultKind(
        "frames_flicker", "camera", "this share of the pictures is without the ball", (1.0, 2.0), (0.5, 0.8), "share",
        SHARE, change=lambda p: _lost(p) if p.rng.random() < p.fault.size else p.sample,
    ),
    FaultKind(
        "frames_frozen", "camera", "the same picture again and again", (0.3, 1.0),
        change=lambda p: p.with_ball(p.start.x, p.start.y),
    ),
    FaultKind(
        "frames_late", "camera", "pictures are older than usual", (0.5, 1.5), (0.1, 0.3), "s", AGE_S, change=_late,
    ),
    FaultKind(
        "frames_duplicated", "camera", "the last sample once more, with its time", (0.5, 1.5), (0.3, 0.6), "share",
        SHARE, change=_duplicated,
    ),
    FaultKind(
        "frames_out_of_order", "camera", "any of the last samples, with its time", (0.5, 1.5), (2.0, 5.0), "samples",
        (2.0, 60.0), change=lambda p: p.past[-1 - int(p.rng.integers(min(round(p.fault.size), len(p.past))))],
    ),
    FaultKind(
        "axes_swapped", "camera", "x and y exchanged", (1.0, 1.0),
        change=lambda p: p.with_ball(p.sample.y, p.sample.x),
    ),
    FaultKind(
        "false_ball", "camera", "the camera takes something at rest elsewhere for the ball", (0.3, 1.0),
        change=_false_ball,
    ),
    FaultKind(
        "position_nan", "camera", "x and y are NaN", (0.2, 1.0), change=lambda p: p.with_ball(math.nan, math.nan),
    ),
    FaultKind(
        "tilt_drift", "tilt", "the sensor drifts evenly, then is right again", (1.0, 2.0), (1.0, 3.0), "deg",
        ANGLE_DEG, change=_drift,
    ),
    FaultKind(
        "tilt_spikes", "tilt", "three samples in ten are far off", (0.5, 1.5), (3.0, 30.0), "deg", ANGLE_DEG,
        change=_spikes,
    ),
    FaultKind("tilt_frozen", "tilt", "the sensor repeats one value", (0.3, 1.0), change=_tilt_frozen),
    FaultKind("tilt_nan", "tilt", "the sensor gives NaN for a few samples", (0.05, 0.2), change=_tilt_nan),
    FaultKind(
        "clock_jitter", "clock", "random errors of sample times, one standard deviation", (1.0, 2.0), (2.0, 8.0), "ms",
        change=lambda p: replace(p.sample, t=p.sample.t + 1e-3 * p.fault.size * float(p.rng.standard_normal())),
    ),
    FaultKind(
        "clock_jump", "clock", "the clock jumps forward", FOR_GOOD, (0.2, 1.0), "s", JUMP_S,
        change=lambda p: replace(p.sample, t=p.sample.t + p.fault.size),
    ),
    FaultKind("commands_lost", "commands", "no command arrives", (0.2, 0.8)),
    FaultKind("commands_late", "commands", "commands arrive later", (0.5, 1.5), (0.05, 0.2), "s", AGE_S),
    FaultKind("ball_elsewhere", "machine", "the ball is put into another ring", ONCE, machine="teleport"),
    FaultKind("ball_taken_out", "machine", "the ball is taken out and put back", (0.5, 2.0), machine="removed"),
    FaultKind("ball_stuck", "machine", "the ball sticks to the floor", (0.4, 1.2), machine="stuck"),
    FaultKind(
        "ball_pushed", "machine", "somebody pushes the ball", ONCE, (0.1, 0.4), "m/s", (0.0, 2.0), machine="push",
        machine_size="speed_m_s",
    ),
    FaultKind("gate_blocked", "machine", "a plug in the next opening", FOR_GOOD, machine="blocked"),
    FaultKind("servo_stuck", "machine", "one servo stands still", (0.3, 1.0), machine="dead_axis"),
    FaultKind(
        "servo_slow", "machine", "one servo is slow", (0.5, 1.5), (5.0, 20.0), "deg/s", (0.1, 1e3),
        machine="slow_axis", machine_size="slew_deg_s",
    ),
    FaultKind(
        "servo_offset", "machine", "one servo stands beside its commands", (1.0, 3.0), (0.5, 2.0), "deg", (0.0, 5.0),
        machine="offset_axis", machine_size="offset_deg",
    ),
    FaultKind(
        "brown_out", "machine", "both servos without current: the plate goes to its middle", (0.2, 0.6),
        machine="brown_out",
    ),
    FaultKind("opening_closed", "orders", "an order closes the next opening", FOR_GOOD),
    FaultKind(
        "camera_dead", "camera", "no picture shows the ball any more", FOR_GOOD, change=_lost,
        because="nothing measures where the ball is", ends=("ball_lost", "out_of_time"),
    ),
    FaultKind(
        "tilt_dead", "tilt", "the sensor gives NaN from now on", FOR_GOOD, change=_tilt_nan,
        because="nothing measures whether the plate obeys", ends=("rig_failed",),
    ),
    FaultKind(
        "clock_stopped", "clock", "the time of all samples is the same", FOR_GOOD,
        change=lambda p: replace(p.sample, t=p.start.t), because="nothing measures how old a sample is",
        ends=("rig_failed",),
    ),
    FaultKind(
        "observe_raises", "rig", "observe() raises RigError", FOR_GOOD, because="the rig itself says that it failed",
        ends=("rig_failed",),
    ),
    FaultKind(
        "observe_hangs", "rig", "observe() does not return", ONCE, (5.0, 5.0), "s", JUMP_S,
        because="the rig measures nothing while the plate is tilted", ends=("rig_failed",),
    ),
    FaultKind(
        "ball_gone", "machine", "the ball is taken out for good", FOR_GOOD, machine="removed",
        because="there is no ball", ends=("ball_lost", "out_of_time"),
    ),
    FaultKind(
        "gates_blocked", "machine", "plugs in all openings of the ring's inner wall", FOR_GOOD, machine="blocked",
        because="no way is left, and no order says so", ends=("missed_opening", "stuck", "out_of_time"),
    ),
    FaultKind(
        "openings_closed", "orders", "orders close all openings to the next ring", FOR_GOOD, because="no way is left",
        ends=("no_route", "opening_closed"),
    ),
)  # fmt: skip
KINDS = {kind.name: kind for kind in _ALL}


def kind_of(name: str) -> FaultKind:
    """The kind with this name."""
    return KINDS[name]
