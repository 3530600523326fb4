"""Motion of the plate in a record: from the commands through the fitted stage, or from the measured tilt alone.

The motion by commands is free of sensor noise. Without commands the measured tilt is smoothed, and a report says so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numba import njit

from mazeplan.core.maths.compiled import KERNEL
from mazeplan.core.records import Array
from mazeplan.core.side_by_side import in_processes
from mazeplan.diagnosis.record import RingRecord
from mazeplan.learning.smoothing import Smoothing, derivatives
from mazeplan.learning.stage_fit import StageFit, coupling, fit_axis, significant
from mazeplan.physics.rig.stage import StageAxis, StageModel, actuator_output, fine_motion

FINE = 6  # grid points a sample
KEYS = ("natural_frequency", "damping", "gain", "dead_time", "offset")
STEPS = (0.01, 0.01, 0.01, 0.001, 0.001)  # of numeric derivatives: three relative ones, s, rad
OVERTAXED_RESIDUAL = 3.5e-3  # rad, residual from which commands overtax the stage; noise of sensors is a third of it
USUAL = StageModel()  # second-order servos
FURTHEST = (0.1, 0.1, 0.1, 0.005, 0.005)  # maximum of one standard error, so that the motion stays linear in it


@dataclass(frozen=True)
class Tilt:
    """Motion of the plate on a fine grid."""

    t: Array  # times (M,), s
    motion: Array  # angle, rate and acceleration of beta, then of gamma (M, 6)
    source: str  # where the motion comes from, in words
    by_stage: dict[str, Array] = field(default_factory=dict)  # derivatives (M, 6) by each of `Stage.directions`

    def at(self, times: Array, parameter: str | None = None) -> Array:
        """Motion (K, 6) at any times (K,), s, by cubic Hermite interpolation. It is constant beyond the ends.

        parameter: direction of the stage, for the derivative by it; None: the motion itself"""
        out, motion = np.empty((len(times), 6)), self.motion if parameter is None else self.by_stage[parameter]
        _hermite(motion, float(self.t[0]), float(self.t[1] - self.t[0]), np.ascontiguousarray(times), out)
        return out


@njit(**KERNEL)
def _hermite(motion, start, h, times, out):
    """Interpolate the motion (M, 6), on a grid from `start` in steps h, at times (K,), into out (K, 6)."""
    for k in range(len(times)):
        at = min(max((times[k] - start) / h, 0.0), len(motion) - 1.000001)
        i = int(at)
        s = at - i
        w0, d0 = (1.0 + 2.0 * s) * (1.0 - s) * (1.0 - s), s * (1.0 - s) * (1.0 - s) * h
        w1, d1 = s * s * (3.0 - 2.0 * s), s * s * (s - 1.0) * h
        for axis in range(0, 6, 3):
            for c in range(axis, axis + 2):  # value, and slope from the next column
                a, b = motion[i], motion[i + 1]
                out[k, c] = w0 * a[c] + d0 * a[c + 1] + w1 * b[c] + d1 * b[c + 1]
            out[k, axis + 2] = motion[i, axis + 2] + s * (motion[i + 1, axis + 2] - motion[i, axis + 2])


@dataclass(frozen=True)
class Stage:
    """Fits of both axes, and the uncertainty of their parameters.

    directions: by name, the axis (0, 1), and a change of its KEYS by one standard error along a principal direction of
    their covariance
    differs: effects by which the motion surely differs from that of a known stage (`comparison.settled_on`)

    The errors along different directions are independent. The errors of the parameters are not: a faster axis that
    starts later moves nearly alike."""

    beta: StageFit
    gamma: StageFit
    directions: dict[str, tuple[int, Array]]
    differs: frozenset[str] = frozenset()

    @property
    def servos_overtaxed(self) -> bool:
        """Whether commands overtax the servos. Then no linear lag describes the servos, and the tilt sensor knows the
        motion of the plate better than the commands."""
        return max(self.beta.rms, self.gamma.rms) > OVERTAXED_RESIDUAL

    @property
    def axes(self) -> tuple[StageAxis, StageAxis]:
        """The fitted axes."""
        return self.beta.axis, self.gamma.axis

    def offsets_on(self, known: StageModel) -> StageModel:
        """Another stage with the offsets of this record's tilt sensor."""
        pairs = zip((known.beta, known.gamma), self.axes, strict=True)
        return StageModel(*(replace(axis, offset=found.offset) for axis, found in pairs))


def fit_stage(record: RingRecord, rows: np.ndarray, kind: StageModel = USUAL) -> Stage | None:
    """The stage, fitted to some rows (N,). None without commands, or if the commands never change.

    kind: a stage whose axes have the same orders, and limited rates if these are fitted in any case"""
    if record.u is None:
        return None
    angles, u = (record.beta, record.gamma), record.u.T
    breaks, kinds = record.begins[rows].astype(float), (kind.beta, kind.gamma)
    try:
        alone = in_processes(lambda i: fit_axis(u[i][rows], angles[i][rows], record.dt, breaks, kind=kinds[i]), (0, 1))
    except ValueError:
        return None
    fits = [_with_coupling(alone[i], u[i], u[1 - i], angles[i], record, rows) for i in (0, 1)]
    directions = {}
    for i, (name, found) in enumerate(zip(("beta", "gamma"), fits, strict=True)):
        for j, change in enumerate(_directions(actuator_output(record.u[:, i], found.axis)[rows], found, record.dt)):
            directions[f"{name}_{j + 1}"] = (i, change)
    return Stage(fits[0], fits[1], directions)


def _with_coupling(
    found: StageFit, own: Array, other: Array, angle: Array, record: RingRecord, rows: np.ndarray
) -> StageFit:
    """The fit with the coupling: the share of the other axis's command that this axis follows.

    A significant coupling changes the other numbers of the axis, so these are fitted again."""
    axis = found.axis
    share, sigma, follows = coupling(axis, own, other, angle, record.dt, rows)
    if not significant(share, sigma):
        return replace(found, axis=replace(axis, coupling=share, stderr={**axis.stderr, "coupling": sigma}))
    # otherwise the motion by the other axis would look like play
    left = angle - axis.gain * share * follows
    again = fit_axis(own[rows], left[rows], record.dt, record.begins[rows].astype(float), kind=axis)
    stderr = {**again.axis.stderr, "coupling": sigma}
    return replace(again, axis=replace(again.axis, coupling=share, stderr=stderr))


def _changed(axis: StageAxis, change: Array) -> tuple[StageAxis, float]:
    """The axis with a change of its KEYS, and the sign of the change: -1 if the dead time would become negative."""
    sign = -1.0 if axis.dead_time + change[3] < 0.0 else 1.0
    relative = {k: getattr(axis, k) * (1.0 + sign * c) for k, c in zip(KEYS[:3], change[:3], strict=True)}
    late, off = max(axis.dead_time + sign * change[3], 0.0), axis.offset + sign * change[4]
    return replace(axis, **relative, dead_time=late, offset=off), sign


def _directions(u: Array, found: StageFit, dt: float) -> Array:
    """Principal directions (D, 5) of the covariance of an axis's parameters, each one standard error long; those along
    which the axis moves otherwise."""
    axis = found.axis
    base = _shifted(u, axis, dt)[::FINE, 0]
    columns = []
    for i, step in enumerate(STEPS):
        moved, sign = _changed(axis, step * np.eye(5)[i])
        columns.append(sign * (_shifted(u, moved, dt)[::FINE, 0] - base) / step)
    J = np.column_stack(columns)
    scale = np.maximum(np.linalg.norm(J, axis=0), 1e-9)
    _, sizes, turn = np.linalg.svd(J / scale, full_matrices=False)
    # rows: the covariance is the sum of their squares
    root = found.rms * (turn.T / np.maximum(sizes, 1e-9 * sizes[0])).T / scale
    root = root / np.maximum(np.max(np.abs(root) / FURTHEST, axis=1, keepdims=True), 1.0)
    return root[np.linalg.norm(root @ J.T, axis=1) > 0.0]  # an axis that follows at once has no frequency


def plate_motion(record: RingRecord, stage: Stage | None) -> Tilt:
    """Motion of the plate in a record. A stage gives it with derivatives; without a stage, the tilt sensor gives it."""
    if record.u is None or stage is None:
        return from_sensor(record)
    base, by_stage = commanded(record.t, record.u, StageModel(*stage.axes)), {}
    for name, (i, change) in stage.directions.items():
        axes = list(stage.axes)
        axes[i], sign = _changed(axes[i], change)
        by_stage[name] = sign * (commanded(record.t, record.u, StageModel(*axes)).motion - base.motion)
    return replace(base, by_stage=by_stage)


def commanded(t: Array, u: Array, stage: StageModel) -> Tilt:
    """Motion of the plate by commands u (N, 2) at times t (N,).

    Commands act after play and dead band, each also on the other axis (coupling), and after the dead time of an axis"""
    dt = float(np.median(np.diff(t)))
    beta, gamma = actuator_output(u[:, 0], stage.beta), actuator_output(u[:, 1], stage.gamma)
    parts = [
        _shifted(beta + stage.beta.coupling * gamma, stage.beta, dt),
        _shifted(gamma + stage.gamma.coupling * beta, stage.gamma, dt),
    ]
    grid = t[0] + dt / FINE * np.arange(len(t) * FINE)
    return Tilt(grid, np.hstack(parts), "commands, through the fitted stage")


def _shifted(u: Array, axis: StageAxis, dt: float) -> Array:
    """Angle, rate, acceleration (N FINE, 3) of an axis under commands u (N,). It starts at rest at the first target."""
    if math.isfinite(axis.rate_limit):
        return fine_motion(axis, u, dt, FINE)
    motion = fine_motion(replace(axis, dead_time=0.0), u, dt, FINE)
    grid = dt / FINE * np.arange(len(motion))
    return np.column_stack([np.interp(grid - axis.dead_time, grid, column) for column in motion.T])


def from_sensor(record: RingRecord) -> Tilt:
    """Motion by the measured tilt, smoothed."""
    dt, parts = float(np.median(np.diff(record.t))), []
    for angle in (record.beta, record.gamma):
        smooth = derivatives(angle, dt, Smoothing("rts"), segment=np.cumsum(record.begins))
        parts += [smooth.value, smooth.rate, smooth.acceleration]
    motion = np.nan_to_num(np.column_stack(parts))
    grid = record.t[0] + dt / FINE * np.arange(len(record.t) * FINE)
    coarse = Tilt(record.t[0] + dt * np.arange(len(record.t)), motion, "")
    return Tilt(grid, coarse.at(grid), "the tilt sensor, smoothed")
