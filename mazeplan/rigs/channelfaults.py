"""Faults on the way from a rig's sensors: each makes, of what the rig has measured until now, what arrives."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mazeplan.maze.geometry import Maze
from mazeplan.records import Observation
from mazeplan.rigs.faultschedule import Drawn

SPIKES = 0.3  # share of samples


def _at(past: Sequence[Observation], t: float) -> Observation:
    """The newest sample that is not newer than t; the oldest if there is none."""
    return next((sample for sample in reversed(past) if sample.t <= t + 1e-9), past[0])


def _position_of(sample: Observation, other: Observation) -> Observation:
    return replace(sample, x=other.x, y=other.y)


def _lost(fault, past, sample, rng, maze):
    return replace(sample, x=None, y=None)


def _flicker(fault, past, sample, rng, maze):
    return replace(sample, x=None, y=None) if rng.random() < fault.size else sample


def _frozen(fault, past, sample, rng, maze):
    return _position_of(sample, _at(past, fault.at_s))


def _late(fault, past, sample, rng, maze):
    return _position_of(sample, _at(past, sample.t - fault.size))


def _duplicated(fault, past, sample, rng, maze):
    return past[-2] if len(past) > 1 and rng.random() < fault.size else sample


def _out_of_order(fault, past, sample, rng, maze):
    return past[-1 - int(rng.integers(min(round(fault.size), len(past))))]


def _swapped(fault, past, sample, rng, maze):
    return replace(sample, x=sample.y, y=sample.x)


def _false_ball(fault, past, sample, rng, maze):
    there = np.random.default_rng(fault.seed)  # the same place in all samples
    radius = maze.track_radius(1 + int(there.integers(len(maze.rings) - 1)))
    angle = float(there.uniform(-math.pi, math.pi))
    return replace(sample, x=radius * math.cos(angle), y=radius * math.sin(angle))


def _position_nan(fault, past, sample, rng, maze):
    return replace(sample, x=math.nan, y=math.nan)


def _tilt(sample: Observation, fault: Drawn, change: Callable[[float], float]) -> Observation:
    beta = change(sample.beta) if 0 in fault.axes else sample.beta
    gamma = change(sample.gamma) if 1 in fault.axes else sample.gamma
    return replace(sample, beta=beta, gamma=gamma)


def _sign(fault: Drawn) -> float:
    return 1.0 if fault.seed % 2 else -1.0


def _drift(fault, past, sample, rng, maze):
    lasting = fault.until_s - fault.at_s
    share = (sample.t - fault.at_s) / lasting if math.isfinite(lasting) else min(1.0, sample.t - fault.at_s)
    return _tilt(sample, fault, lambda angle: angle + _sign(fault) * share * math.radians(fault.size))


def _spikes(fault, past, sample, rng, maze):
    chance, side = rng.random(2)
    off = math.copysign(math.radians(fault.size), side - 0.5) if chance < SPIKES else 0.0
    return _tilt(sample, fault, lambda angle: angle + off)


def _tilt_frozen(fault, past, sample, rng, maze):
    then = _at(past, fault.at_s)
    return replace(
        sample,
        beta=then.beta if 0 in fault.axes else sample.beta,
        gamma=then.gamma if 1 in fault.axes else sample.gamma,
    )


def _tilt_nan(fault, past, sample, rng, maze):
    return _tilt(sample, fault, lambda angle: math.nan)


def _jitter(fault, past, sample, rng, maze):
    return replace(sample, t=sample.t + 1e-3 * fault.size * float(rng.standard_normal()))


def _jump(fault, past, sample, rng, maze):
    return replace(sample, t=sample.t + fault.size)


def _stopped(fault, past, sample, rng, maze):
    return replace(sample, t=_at(past, fault.at_s).t)


Change = Callable[[Drawn, Sequence[Observation], Observation, np.random.Generator, Maze], Observation]
"""(fault, what the rig measured until now, what arrives so far, chance, maze) -> what arrives."""

CHANGES: dict[str, Change] = {
    "frames_lost": _lost, "camera_dead": _lost, "frames_flicker": _flicker, "frames_frozen": _frozen,
    "frames_late": _late, "frames_duplicated": _duplicated, "frames_out_of_order": _out_of_order,
    "axes_swapped": _swapped, "false_ball": _false_ball, "position_nan": _position_nan,
    "tilt_drift": _drift, "tilt_spikes": _spikes, "tilt_frozen": _tilt_frozen,
    "tilt_nan": _tilt_nan, "tilt_dead": _tilt_nan,
    "clock_jitter": _jitter, "clock_jump": _jump, "clock_stopped": _stopped,
}  # fmt: skip
