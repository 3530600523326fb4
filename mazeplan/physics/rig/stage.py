"""The tip-tilt stage. Each axis follows its command after a dead time, in one of three ways (`order`):

    0  at once:                     angle = r
    1  as a first-order lag:        angle_d = w (r - angle)
    2  as a second-order servo:     angle_dd = w^2 (r - angle) - 2 zeta w angle_d        (zeta may exceed 1)

with r = gain u(t - dead_time) + offset and w = natural_frequency. |angle_d| is at most `rate_limit`. Before that, the
command is rounded to `resolution`, ignored inside the dead band, and passes gears with backlash. `behind`: these gears
are between servo and plate instead, so that the plate follows the angle of the servo with backlash. `stage_simulation`
simulates an axis.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from mazeplan.core.records import Array
from mazeplan.physics.rig.sensors import check_ranges

PROMPT = 60.0  # rad/s; a servo that a record shows to follow at once is at least this fast
FASTEST = 600.0  # rad/s; the fast pole of a simulation in small steps, where the axis has none
WIDE = 0.13  # rad; a change of tilt that a plan often makes: three quarters of a reversal at 5 degrees
REACHED_S = 0.01  # s; about the time between two rows of a plate's motion
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
        limited rate makes an axis slower: a critically damped one turns at most with w WIDE / e."""
        w, z = self.second_order(min(fastest, PROMPT) if self.order == 0 else fastest)
        most = math.e * self.rate_limit / WIDE
        return (w, z) if w <= most else (most, max(z, 1.0))

    @property
    def lag(self) -> float:
        """Time by which the angle is behind a command that changes evenly, dead time not counted, s.

        A limited rate adds half of the time that it needs for WIDE."""
        w = self.natural_frequency
        return (0.0, 1.0 / w, 2.0 * self.damping / w)[self.order] + 0.5 * WIDE / self.rate_limit

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
