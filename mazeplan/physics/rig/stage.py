"""The tip-tilt stage. Each axis follows its command after a dead time, in one of three ways (`order`):

    0  at once:                     angle = r
    1  as a first-order lag:        angle_d = w (r - angle)
    2  as a second-order servo:     angle_dd = w^2 (r - angle) - 2 zeta w angle_d        (zeta may exceed 1)

with r = gain u(t - dead_time) + offset and w = natural_frequency. |angle_d| is at most `rate_limit`. Before that, the
command is rounded to `resolution`, ignored inside the dead band, and passes gears with backlash. `behind`: these gears
are between servo and plate instead, so that the plate follows the angle of the servo with backlash. A simulation of
held commands is exact; a limited rate needs small steps.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from numba import njit

from mazeplan.core.maths.compiled import KERNEL
from mazeplan.core.records import Array, IntArray
from mazeplan.physics.rig.sensors import check_ranges

PROMPT = 60.0  # rad/s; a servo that a record shows to follow at once is at least this fast
FASTEST = 600.0  # rad/s; the fast pole of a simulation in small steps, where the axis has none
TYPICAL_RAD = 0.13  # rad; a change of tilt that a plan often makes: three quarters of a reversal at 5 degrees
REACHED_S = 0.01  # s; about the time between two rows of a plate's motion
START = np.zeros(1, dtype=np.int64)  # one stretch, from the first sample on
SUBSTEP = 1.0 / 480.0  # s, largest step with a limited rate
TURNS = 4  # moments of a sample at which gears behind the lag may turn
ORDERS = ("at once", "first order", "second order")
RANGES = {
    "backlash": (0.0, 0.2, "rad"), "deadband": (0.0, 0.2, "rad"), "gain": (0.05, 20.0, ""),
    "natural_frequency": (0.5, 500.0, "rad/s"), "damping": (0.02, 20.0, ""), "dead_time": (0.0, 1.0, "s"),
    "offset": (-0.5, 0.5, "rad"), "coupling": (-0.5, 0.5, ""), "rate_limit": (0.05, math.inf, "rad/s"),
    "resolution": (0.0, 0.05, "rad"),
}  # fmt: skip


@dataclass(frozen=True)
class StageAxis:
    """One axis of the stage.

    natural_frequency: rad/s; of order 1: its pole; of order 0: the record shows only that the axis is faster than this
    """

    gain: float = 1.0  # tilt per command
    natural_frequency: float = 26.0
    damping: float = 0.9  # ratio, of order 2
    dead_time: float = 0.0  # s
    offset: float = 0.0  # rad
    stderr: dict[str, float] = field(default_factory=dict, compare=False)  # standard errors by field
    backlash: float = 0.0  # play of the gears, rad
    deadband: float = 0.0  # smallest change of command with an effect, rad
    coupling: float = 0.0  # share of the other axis's command
    order: int = 2  # 0, 1 or 2
    rate_limit: float = math.inf  # largest rate, rad/s
    resolution: float = 0.0  # step of the commands that the servo can take, rad
    behind: bool = False  # whether the gears are behind the lag

    def __post_init__(self) -> None:
        if self.order not in (0, 1, 2):
            raise ValueError(f"order: got {self.order}, expected 0, 1 or 2")
        check_ranges(self, RANGES)

    @classmethod
    def prompt(cls, gain: float = 1.0, dead_time: float = 0.0, offset: float = 0.0) -> StageAxis:
        """An axis that follows at once, after its dead time."""
        return cls(gain, PROMPT, 1.0, dead_time, offset, order=0)

    def poles(self) -> tuple[complex, ...]:
        """Poles of the continuous axis, rad/s."""
        w, z = self.natural_frequency, self.damping
        if self.order < 2:
            return (complex(-w),) * self.order
        root = complex(z * z - 1.0) ** 0.5
        return w * (-z + root), w * (-z - root)

    def slowest(self) -> float:
        """Rate at which the slowest motion dies away, 1/s; infinite for an axis that follows at once."""
        return min((-pole.real for pole in self.poles()), default=math.inf)

    def transition(self, dt: float) -> Array:
        """Exact transition (2, 2) of (angle - target, rate) over dt s under a held command, without the rate limit."""
        return _transition(self.order, self.natural_frequency, self.damping, dt)

    def acceleration(self, away: float, rate: float) -> float:
        """Acceleration, rad/s^2, at angle - target = away, rad, and this rate, rad/s.

        It is 0 for an axis whose rate jumps with its command: its acceleration between jumps would be a bias. A limited
        rate is reached at once, too: no more than what leads to it in REACHED_S."""
        w, limit = self.natural_frequency, self.rate_limit
        a = -w * w * away - 2.0 * self.damping * w * rate if self.order == 2 else 0.0
        return min(max(a, (-limit - rate) / REACHED_S), (limit - rate) / REACHED_S)

    def second_order(self, fastest: float = FASTEST) -> tuple[float, float]:
        """Natural frequency, rad/s, and damping of the second-order axis that resembles this one.

        No pole is beyond `fastest`, rad/s; of two real poles the slower one stays as it is."""
        w, z = self.natural_frequency, self.damping
        if self.order == 0:
            return fastest, 1.0
        if self.order == 1:
            slow, fast = min(w, fastest), fastest
        elif z <= 1.0:
            return min(w, fastest), z
        else:
            apart = math.sqrt(z * z - 1.0)
            slow, fast = min(w / (z + apart), fastest), w * (z + apart)
        if self.order == 2 and fast <= fastest:
            return w, z
        return math.sqrt(fastest * slow), 0.5 * (fastest + slow) / math.sqrt(fastest * slow)

    def careful(self, fastest: float) -> tuple[float, float]:
        """As `second_order`, on the safe side for a plan: an axis that follows at once is no faster than PROMPT, and a
        limited rate makes an axis slower: a critically damped one turns at most with w TYPICAL_RAD / e."""
        w, z = self.second_order(min(fastest, PROMPT) if self.order == 0 else fastest)
        most = math.e * self.rate_limit / TYPICAL_RAD
        return (w, z) if w <= most else (most, max(z, 1.0))

    @property
    def lag(self) -> float:
        """Time by which the angle is behind a command that changes evenly, dead time not counted, s.

        A limited rate adds half of the time that it needs for TYPICAL_RAD."""
        w = self.natural_frequency
        return (0.0, 1.0 / w, 2.0 * self.damping / w)[self.order] + 0.5 * TYPICAL_RAD / self.rate_limit

    def by_gain(self, k: float) -> StageAxis:
        """The axis with its angles divided by k."""
        return replace(self, gain=self.gain / k, offset=self.offset / k, rate_limit=self.rate_limit / k)


@lru_cache(1024)
def _transition(order: int, w: float, z: float, dt: float) -> Array:
    """`StageAxis.transition`; a run asks for the same ones in each tick."""
    if order == 2:
        return second_order_transition(w, z, dt)
    decay = math.exp(-w * dt) if order else float(dt <= 0.0)
    return np.array([[decay, 0.0], [-w * decay if order else 0.0, 0.0]])


def second_order_transition(w: float, z: float, dt: float) -> Array:
    """exp(M dt) for M = [[0, 1], [-w^2, -2 z w]], shape (2, 2), for any damping.

    exp(M t) = exp(-z w t) [cosh(mu t) I + sinh(mu t)/mu (M + z w I)],  mu = w sqrt(z^2 - 1).
    """
    mu = w * cmath.sqrt(complex(z * z - 1.0))
    slope = dt if abs(mu * dt) < 1e-9 else (cmath.sinh(mu * dt) / mu).real
    rest = np.array([[z * w, 1.0], [-w * w, -z * w]])
    return math.exp(-z * w * dt) * (cmath.cosh(mu * dt).real * np.eye(2) + slope * rest)


@dataclass(frozen=True)
class StageModel:
    """Both axes of the stage."""

    beta: StageAxis = field(default_factory=StageAxis)
    gamma: StageAxis = field(default_factory=StageAxis)

    def mixed(self, u_beta: float, u_gamma: float) -> tuple[float, float]:
        """Command that reaches each axis, rad: its command plus a share of the other axis's command."""
        return u_beta + self.beta.coupling * u_gamma, u_gamma + self.gamma.coupling * u_beta

    @property
    def lag(self) -> float:
        """Mean lag of the axes (`StageAxis.lag`), s."""
        return 0.5 * (self.beta.lag + self.gamma.lag)

    @property
    def dead_time(self) -> float:
        """Seconds between sending a command and its first effect on the plate."""
        return max(self.beta.dead_time, self.gamma.dead_time)


@njit(**KERNEL)
def _behind_gears(u, half):
    """Output (N,) of gears with the play 2 `half`, rad, for commands u (N,); it begins with the first command."""
    out, at = np.empty(len(u)), u[0]
    for i, value in enumerate(u):
        low, high = value - half, value + half
        if low > at:
            at = low
        if high < at:
            at = high
        out[i] = at
    return out


@njit(**KERNEL)
def _obeyed(u, deadband):
    """Output (N,) of a servo that ignores changes of the commands u (N,) below `deadband`, rad."""
    out, at = np.empty(len(u)), u[0]
    for i, value in enumerate(u):
        at = value if abs(value - at) >= deadband else at
        out[i] = at
    return out


def actuator_output(u: Array, axis: StageAxis) -> Array:
    """Output (N,) of what acts in front of the lag, steps, deadband and gears, for commands u (N,)."""
    if axis.resolution:
        u = np.round(u / axis.resolution) * axis.resolution
    if axis.deadband:
        u = _obeyed(np.ascontiguousarray(u), axis.deadband)
    if axis.backlash and not axis.behind:
        u = _behind_gears(np.ascontiguousarray(u), 0.5 * axis.backlash)
    return u


def step_response(axis: StageAxis, t: Array) -> Array:
    """Angle after a unit step of the command at t = 0 (dead time not counted), shape as t; 0 before."""
    w, z = axis.natural_frequency, axis.damping
    late = np.maximum(t, 0.0)
    if axis.order == 0:
        rest = np.zeros_like(late)
    elif axis.order == 1:
        rest = np.exp(-w * late)
    elif abs(z - 1.0) < 1e-6:
        rest = np.exp(-z * w * late) * (1.0 + w * late)
    elif z < 1.0:
        wd = w * math.sqrt(1.0 - z * z)
        rest = np.exp(-z * w * late) * (np.cos(wd * late) + z * w / wd * np.sin(wd * late))
    else:
        root = w * math.sqrt(z * z - 1.0)
        fast, slow = z * w + root, z * w - root
        rest = (fast * np.exp(-slow * late) - slow * np.exp(-fast * late)) / (2.0 * root)
    return np.where(t > 0.0, 1.0 - rest, 0.0)


def simulate_axis(axis: StageAxis, u: Array, dt: float, firsts: IntArray = START) -> Array:
    """Angle (N,) at the samples under commands u (N,), each held from its sample on.

    firsts: indices (K,) at which a stretch begins, ascending from 0

    In each stretch the axis starts at rest at the target of the first command, in the middle of its gears. Without a
    limited rate and gears behind the lag, the response to
    each change of the command is known in closed form. The sum over the changes is a convolution, cut where the
    response has settled to 2e-9. A coarser cut would cause steps in the derivatives of a fit."""
    u = np.ascontiguousarray(u)
    if axis.behind and axis.backlash:
        return fine_motion(axis, u, dt, TURNS, firsts)[::TURNS, 0]
    if math.isfinite(axis.rate_limit):
        return fine_motion(axis, u, dt, 1, firsts)[:, 0]
    settle = max(0.5, 20.0 / axis.slowest())
    n = min(len(u), math.ceil((settle + axis.dead_time) / dt) + 1)
    response = step_response(axis, np.arange(n, dtype=np.float64) * dt - axis.dead_time)
    impulse = np.diff(response, prepend=0.0)
    impulse[-1] += 1.0 - response[-1]
    return axis.offset + axis.gain * _convolved(impulse, u, firsts)


def fine_motion(axis: StageAxis, u: Array, dt: float, per: int, firsts: IntArray = START) -> Array:
    """Angle, rate, acceleration (N per, 3) of an axis at `per` moments of each sample, under commands u (N,).

    Shapes and start as in `simulate_axis`."""
    parts = max(math.ceil(dt / per / SUBSTEP), 1)
    h = dt / per / parts
    target = axis.gain * np.ascontiguousarray(u) + axis.offset
    M, numbers = axis.transition(h), np.array([axis.natural_frequency, axis.damping, axis.rate_limit])
    late = round(axis.dead_time / h)
    rest = axis.dead_time - late * h  # of the dead time, s: less than a step, by interpolation
    out = np.empty((len(u) * per, 3))
    _march(target, M, axis.order, numbers, late, rest, h, per * parts, parts, firsts, out)
    if axis.behind and axis.backlash:
        _with_play(out, 0.5 * axis.backlash, firsts * per)
    return out


@njit(**KERNEL)
def _with_play(motion, half, firsts):
    """Motion (M, 3) of servos -> that of the plate behind gears: it stands while the servo turns in the play."""
    for j in range(len(firsts)):
        at = motion[firsts[j], 0]
        for i in range(firsts[j], firsts[j + 1] if j + 1 < len(firsts) else len(motion)):
            row = motion[i]
            new = min(max(at, row[0] - half), row[0] + half)
            if new == at:
                row[1] = row[2] = 0.0
            at = row[0] = new


@njit(**KERNEL)
def _march(target, M, order, numbers, late, rest, h, steps, parts, firsts, out):
    """March an axis in steps of h s, `steps` for each target (N,); a row of out for each `parts` of them.

    late: dead time in steps; rest: dead time beyond them, s"""
    w, zeta, limit = numbers[0], numbers[1], numbers[2]
    for j in range(len(firsts)):
        first, end = firsts[j], firsts[j + 1] if j + 1 < len(firsts) else len(target)
        angle, rate = target[first], 0.0
        for i in range((end - first) * steps):
            at = max(i - late, 0) // steps
            aim = target[first + at]
            away = angle - aim
            if i % parts == 0:
                a = -w * w * away - 2.0 * zeta * w * rate if order == 2 else 0.0  # as `StageAxis.acceleration`
                a = min(max(a, (-limit - rate) / REACHED_S), (limit - rate) / REACHED_S)
                row = out[(first * steps + i) // parts]
                row[0], row[1], row[2] = angle - rest * rate, rate, a
            rate_new = M[1, 0] * away + M[1, 1] * rate
            new = aim + M[0, 0] * away + M[0, 1] * rate
            if abs(new - angle) > limit * h:
                new = angle + (limit * h if new > angle else -limit * h)
                rate_new = limit if new > angle else -limit
            if order == 0:
                rate_new = (new - angle) / h if limit < math.inf else 0.0
            angle, rate = new, rate_new


@njit(**KERNEL)
def _convolved(impulse, u, firsts):
    """Each stretch of u (N,) from its first value on, convolved with an impulse response (n,)."""
    out = np.empty(len(u))
    for j in range(len(firsts)):
        first, end = firsts[j], firsts[j + 1] if j + 1 < len(firsts) else len(u)
        change, angle = u[first:end] - u[first], out[first:end]
        angle[:] = u[first]
        for k in range(min(len(impulse), len(change))):
            earlier, later = change[: len(change) - k], angle[k:]
            for i in range(len(later)):  # this order of loops compiles to vector instructions
                later[i] += impulse[k] * earlier[i]
    return out
