"""The tip-tilt stage: each axis a second-order servo with dead time.

    angle_dd = wn^2 (gain u(t - dead_time) + offset - angle) - 2 zeta wn angle_d

The simulation is exact for held commands. zeta may exceed 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from mazeplan.core.field_checks import unit_hint
from mazeplan.core.maths.fingerprint import LATER
from mazeplan.core.records import Array


@dataclass(frozen=True)
class StageAxis:
    """One axis of the stage.

    gain:              tilt per command
    natural_frequency: rad/s
    damping:           ratio
    dead_time:         s
    offset:            rad
    stderr:            standard errors by field
    backlash:          play between servo and plate, rad
    deadband:          smallest change of command with an effect, rad
    coupling:          share of the other axis's command
    """

    gain: float = 1.0
    natural_frequency: float = 26.0
    damping: float = 0.9
    dead_time: float = 0.0
    offset: float = 0.0
    stderr: dict[str, float] = field(default_factory=dict, compare=False)
    backlash: float = 0.0
    deadband: float = 0.0
    coupling: float = field(default=0.0, metadata=LATER)

    def __post_init__(self) -> None:
        for name, low, high, unit in (
            ("backlash", 0.0, 0.2, "rad"),
            ("deadband", 0.0, 0.2, "rad"),
            ("gain", 0.05, 20.0, ""),
            ("natural_frequency", 0.5, 500.0, "rad/s"),
            ("damping", 0.02, 20.0, ""),
            ("dead_time", 0.0, 1.0, "s"),
            ("offset", -0.5, 0.5, "rad"),
            ("coupling", -0.5, 0.5, ""),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                hint = unit_hint(value, unit, low, high)
                raise ValueError(f"{name}: got {value}, expected {low} to {high}{hint}")

    def poles(self) -> tuple[complex, complex]:
        """Poles of the continuous axis, rad/s."""
        w, z = self.natural_frequency, self.damping
        root = complex(z * z - 1.0) ** 0.5
        return w * (-z + root), w * (-z - root)


@dataclass(frozen=True)
class StageModel:
    """Both axes of the stage."""

    beta: StageAxis = field(default_factory=StageAxis)
    gamma: StageAxis = field(default_factory=StageAxis)

    def mixed(self, u_beta: float, u_gamma: float) -> tuple[float, float]:
        """Command that reaches each axis, rad: its command plus a share of the other axis's command."""
        return u_beta + self.beta.coupling * u_gamma, u_gamma + self.gamma.coupling * u_beta


def apply_backlash(u: Array, backlash: float, start: float | None = None) -> Array:
    """Output (N,) of gears with `backlash` rad for commands u (N,). start: output before the first command; by default
    the first command."""
    if backlash == 0.0:
        return u
    half, out = 0.5 * backlash, np.empty(len(u))
    at = float(u[0]) if start is None else start
    for i, value in enumerate(u):
        at = min(max(at, value - half), value + half)
        out[i] = at
    return out


def apply_deadband(u: Array, deadband: float) -> Array:
    """Output (N,) of a servo that ignores changes of the commands u (N,) below `deadband` rad."""
    if deadband == 0.0:
        return u
    out, at = np.empty(len(u)), float(u[0])
    for i, value in enumerate(u):
        at = float(value) if abs(value - at) >= deadband else at
        out[i] = at
    return out


def actuator_output(u: Array, axis: StageAxis) -> Array:
    """Output (N,) of deadband and gears for commands u (N,)."""
    return apply_backlash(apply_deadband(u, axis.deadband), axis.backlash)


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
    """Angle (N,) at the samples under commands u (N,), each held from its sample on.

    The axis starts at rest at the target of the first command. The response to each change of the command is known in
    closed form. The sum over the changes is a convolution, cut where the response has settled to 2e-9. A coarser cut
    would cause steps in the derivatives of a fit."""
    from scipy.signal import lfilter  # here: its import takes a second, and navigation does not use it

    settle = max(0.5, -20.0 / max(pole.real for pole in axis.poles()))
    n = min(len(u), math.ceil((settle + axis.dead_time) / dt) + 1)
    response = step_response(axis, np.arange(n, dtype=np.float64) * dt - axis.dead_time)
    impulse = np.diff(response, prepend=0.0)
    impulse[-1] += 1.0 - response[-1]
    start = u[0]
    return axis.offset + axis.gain * (start + np.asarray(lfilter(impulse, [1.0], u - start)))
