"""The tip-tilt stage: each axis a second-order servo with dead time, and its fit to a log by output error.

    angle_dd = wn^2 (gain u(t - dead_time) + offset - angle) - 2 zeta wn angle_d

The fit simulates the axis with the commands that were given (exactly, zero-order hold) and compares angles, so that
noise of the
tilt sensor does not bias it; zeta may exceed 1.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

from mazeplan.records import Array

DEAD_TIMES = tuple(k / 120.0 for k in range(13))  # s, 0 to 0.1: where the search for the dead time starts


@dataclass(frozen=True)
class StageAxis:
    """One axis. natural_frequency rad/s, damping -, gain -, dead_time s, offset rad."""

    gain: float = 1.0
    natural_frequency: float = 26.0
    damping: float = 0.9
    dead_time: float = 0.0
    offset: float = 0.0
    stderr: dict[str, float] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        for name, low, high in (
            ("gain", 0.05, 20.0),
            ("natural_frequency", 0.5, 500.0),
            ("damping", 0.02, 20.0),
            ("dead_time", 0.0, 1.0),
            ("offset", -0.5, 0.5),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise ValueError(f"{name}: got {value}, expected {low} to {high}")

    def poles(self) -> tuple[complex, complex]:
        """Poles of the continuous axis, rad/s."""
        w, z = self.natural_frequency, self.damping
        root = complex(z * z - 1.0) ** 0.5
        return w * (-z + root), w * (-z - root)


@dataclass(frozen=True)
class StageModel:
    """Both axes."""

    beta: StageAxis = field(default_factory=StageAxis)
    gamma: StageAxis = field(default_factory=StageAxis)


@dataclass(frozen=True)
class StageFit:
    """An axis fitted to a log. rms: rad, of measured minus simulated angle; samples used."""

    axis: StageAxis
    rms: float
    samples: int


def step_response(axis: StageAxis, t: Array) -> Array:
    """Angle after a unit step of the command at t = 0 (dead time not counted), shape as t; 0 before."""
    w, z = axis.natural_frequency, axis.damping
    late = np.maximum(t, 0.0)
    decay = np.exp(-z * w * late)
    if abs(z - 1.0) < 1e-6:
        rest = decay * (1.0 + w * late)
    elif z < 1.0:
        wd = w * math.sqrt(1.0 - z * z)
        rest = decay * (np.cos(wd * late) + z * w / wd * np.sin(wd * late))
    else:
        root = w * math.sqrt(z * z - 1.0)
        fast, slow = z * w + root, z * w - root
        rest = (fast * np.exp(-slow * late) - slow * np.exp(-fast * late)) / (2.0 * root)
    return np.where(t > 0.0, 1.0 - rest, 0.0)


def simulate_axis(axis: StageAxis, u: Array, dt: float) -> Array:
    """Angle (N,) at the samples under commands u (N,), each held from its sample on, from rest at the first
    command's target.

    The response to each change of the command is known in closed form; the sum over changes is a convolution, and
    past half a
    second it has settled for every axis that is worth controlling, so a short one will do."""
    settle = max(0.5, 20.0 / (axis.natural_frequency * min(axis.damping, 1.0 / max(axis.damping, 1e-6))))
    n = min(len(u), math.ceil((settle + axis.dead_time) / dt) + 1)
    response = step_response(axis, np.arange(n, dtype=np.float64) * dt - axis.dead_time)
    impulse = np.diff(response, prepend=0.0)
    impulse[-1] += 1.0 - response[-1]
    start = u[0]
    return axis.offset + axis.gain * (start + np.asarray(lfilter(impulse, [1.0], u - start)))


def fit_axis(u: Array, angle: Array, dt: float, breaks: Array | None = None) -> StageFit:
    """Fit one axis to commands u (N,) and measured angle (N,), sampled every dt s. breaks: True where a new record
    begins.

    Raises ValueError when there is nothing to fit: fewer than 60 samples, or a command that never moves."""
    if len(u) < 60 or np.ptp(u) < 1e-3:
        raise ValueError(f"got {len(u)} samples with commands over {np.ptp(u) if len(u) else 0.0:.2g} rad")
    starts = np.flatnonzero(breaks) if breaks is not None else np.array([], dtype=int)
    edges = np.unique(np.concatenate([[0], starts, [len(u)]]))
    pieces = [(a, b) for a, b in itertools.pairwise(edges) if b - a >= 30]
    skip = round(0.5 / dt)  # samples until the unknown start has died away

    def error(x: Array) -> Array:
        axis = StageAxis(x[0], math.exp(x[1]), math.exp(x[2]), x[3], x[4])
        return np.concatenate([(simulate_axis(axis, u[a:b], dt) - angle[a:b])[skip:] for a, b in pieces])

    best = None
    for dead in DEAD_TIMES[::4]:
        start = np.array([1.0, math.log(20.0), math.log(0.9), dead, 0.0])
        bounds = ([0.1, 0.0, -3.0, 0.0, -0.3], [10.0, 5.5, 2.0, 0.5, 0.3])
        found = least_squares(error, start, bounds=bounds, x_scale=[0.1, 0.1, 0.1, 0.01, 0.01], method="trf")
        if best is None or found.cost < best.cost:
            best = found
    assert best is not None
    n = len(best.fun)
    variance = 2.0 * best.cost / max(n - 5, 1)
    covariance = np.linalg.pinv(best.jac.T @ best.jac) * variance
    sigma = np.sqrt(np.diag(covariance))
    wn, zeta = math.exp(best.x[1]), math.exp(best.x[2])
    names = ("gain", "natural_frequency", "damping", "dead_time", "offset")
    scale = (1.0, wn, zeta, 1.0, 1.0)
    stderr = {name: float(s * k) for name, s, k in zip(names, sigma, scale, strict=True)}
    axis = StageAxis(float(best.x[0]), wn, zeta, float(best.x[3]), float(best.x[4]), stderr)
    return StageFit(axis, float(np.sqrt(variance)), n)
