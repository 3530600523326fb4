"""The records that the packages exchange, and the table of symbols of the project.

symbol        unit      meaning
------------  --------  --------------------------------------------------------------------------------
t             s         the rig's own clock; 0 at `Rig.reset`
x, y          m         ball centre in the plate frame
r             m         sqrt(x^2 + y^2)
theta         rad       atan2(y, x)
theta_dot     rad/s     rate of theta
beta          rad       pitch about the y axis; positive lowers the +x side
gamma         rad       roll about the x axis; positive lifts the +y side
u_beta/gamma  rad       commanded tilt, held until the next command
ring          -         1 is the outermost; the last one is the disc in the centre

Planner state s = (theta, theta_dot, beta, beta_dot, gamma, gamma_dot), shape (6,); control u = (u_beta, u_gamma),
shape (2,). One step is 1/30 s. Records are frozen: a step makes a new one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from mazeplan.core.results import Result

if TYPE_CHECKING:
    from pydantic import TypeAdapter

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Observation:
    """What a rig measured at one sample. x = y = None when the ball is not seen; beta and gamma are NaN (or None) on a
    rig without a tilt sensor.

    others: on a rig with several balls, the same sample for each ball after the first, always in the same order."""

    t: float
    x: float | None
    y: float | None
    beta: float
    gamma: float
    others: tuple[Observation, ...] = ()

    @property
    def seen(self) -> bool:
        """Whether the camera found the ball in this sample."""
        return self.x is not None and self.y is not None


@dataclass(frozen=True, slots=True)
class Command:
    """Commanded tilt in rad, held by the rig until the next command."""

    u_beta: float
    u_gamma: float


LEVEL = Command(0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Latency:
    """Measured delays of a rig, s."""

    camera_s: float  # by how much the ball's position in a sample is older than the tilt in this sample
    command_s: float  # from a sample to the first movement of the plate by the command that answers the sample


@dataclass(frozen=True, slots=True)
class State:
    """An estimate of ball and plate at time t (the moment at which the next command acts, unless said otherwise).

    ring is confirmed with hysteresis; lost means that the ball has not been seen for longer than allowed.
    """

    t: float
    x: float
    y: float
    vx: float
    vy: float
    beta: float
    beta_dot: float
    gamma: float
    gamma_dot: float
    ring: int
    seen: bool = True
    lost: bool = False

    @property
    def r(self) -> float:
        """Distance of the ball from the centre, m."""
        return math.hypot(self.x, self.y)

    @property
    def theta(self) -> float:
        """Angle of the ball in (-pi, pi], rad."""
        return math.atan2(self.y, self.x)

    @property
    def speed(self) -> float:
        """Speed of the ball in the plate, m/s."""
        return math.hypot(self.vx, self.vy)

    @property
    def theta_dot(self) -> float:
        """Angular speed about the centre, rad/s; 0 at the centre."""
        r2 = self.x * self.x + self.y * self.y
        return 0.0 if r2 < 1e-12 else (self.x * self.vy - self.y * self.vx) / r2

    def planner_vector(self) -> Array:
        """(theta, theta_dot, beta, beta_dot, gamma, gamma_dot), shape (6,)."""
        return np.array([self.theta, self.theta_dot, self.beta, self.beta_dot, self.gamma, self.gamma_dot])


class StopReason(StrEnum):
    """Why the planner stopped."""

    CONVERGED = "converged"
    MAX_ITERATIONS = "max_iterations"
    DEADLINE = "deadline"
    NO_DESCENT = "no_descent"
    NOT_FINITE = "not_finite"


@dataclass(frozen=True)
class Plan:
    """A planned trajectory with its feedback."""

    states: Array  # (T+1, 6) planner states; theta is continuous (may leave (-pi, pi])
    controls: Array  # (T, 2) commanded tilt, inside the limits
    gains: Array  # (T, 2, 6) u = controls[k] + gains[k] @ (s - states[k])
    cost: float  # total cost reached
    reason: StopReason  # why the solver stopped
    iterations: int  # of the solver
    ms: float  # duration of the search
    t0: float = 0.0  # rig time of states[0], s
    dt: float = 1.0 / 30.0  # step, s

    @property
    def ok(self) -> bool:
        """Whether a controller may follow the plan: it is finite, even if the solver ran out of time or iterations."""
        return self.reason is not StopReason.NOT_FINITE


@dataclass(frozen=True, slots=True)
class TreeOutline:
    """The nodes of a behaviour tree, parents first."""

    paths: tuple[str, ...]
    kinds: tuple[str, ...]  # names of classes
    names: tuple[str, ...]
    parents: tuple[int, ...]  # number of the node above, -1 for the root
    conditions: tuple[int, ...] | None = None  # nodes that only check something; None in logs of older versions

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> TreeOutline:
        """Read a message /tree of a run log. Raises KeyError, TypeError or ValueError for a damaged one."""
        columns = [tuple(document[name]) for name in ("paths", "kinds", "names", "parents")]
        conditions = document.get("conditions")
        if len({len(column) for column in columns}) != 1:
            raise ValueError("a tree with columns of different lengths")
        if not all(isinstance(i, int) and 0 <= i < len(columns[0]) for i in conditions or ()):
            raise ValueError("a condition that is no node")
        return cls(*columns, conditions=None if conditions is None else tuple(conditions))


class FailureKind(StrEnum):
    """What can go wrong in a run; the behaviour tree chooses a recovery for the kind."""

    STUCK = "stuck"
    MISSED_OPENING = "missed_opening"
    FELL_BACK = "fell_back"
    WRONG_RING = "wrong_ring"
    BALL_LOST = "ball_lost"
    BALL_OUT = "ball_out"
    PLAN_FAILED = "plan_failed"
    NO_ROUTE = "no_route"
    UNFAMILIAR = "unfamiliar"
    OPENING_CLOSED = "opening_closed"
    ROUTE_CHANGED = "route_changed"
    OUT_OF_TIME = "out_of_time"
    ELSEWHERE = "elsewhere"
    LEAF_FAILED = "leaf_failed"
    RIG_FAILED = "rig_failed"
    LOG_FAILED = "log_failed"
    LEFT_THE_CENTRE = "left_the_centre"
    MISFIT = "misfit"


@dataclass(frozen=True, slots=True)
class Failure:
    """One thing that went wrong."""

    kind: FailureKind
    where: str  # leaf or place
    t: float  # rig time, s
    words: str = ""  # a sentence for people
    recovery: str | None = None  # name of the recovery that the tree chose
    x: float | None = None  # place of the ball, m; None if unknown
    y: float | None = None
    detail: dict[str, float] = field(default_factory=dict)  # measured, by name with unit (`measured_miss`)


@dataclass(frozen=True, slots=True)
class Doubt:
    """Measurements were wrong or not used, from rig time t, s, on for a while. `what` is one of:

    clock:    the time does not go on
    gap:      the time leaps ahead
    rate:     samples do not come at the rig's rate_hz
    position: the position of the ball is not a number
    far:      the ball is metres away
    frozen:   the ball is at one position, bit by bit, while the plate turns: a picture repeats
    ball:     the ball is far from where it could be
    tilt:     the tilt is not a number, or leaps
    no_tilt:  the tilt was never measured: the commands move the model's plate
    plate:    the plate does not follow the commands
    """

    what: str
    t: float


@dataclass(frozen=True, slots=True)
class Misfit:
    """The rig does not behave as the model says, seen at rig time t, s. adopted: the run goes on with what it saw"""

    words: str
    t: float
    adopted: bool


@dataclass(frozen=True, slots=True)
class RingPassage:
    """One ring of a run: time of the ball in it, s, and the opening by which it left (None in the last ring)."""

    ring: int
    time_s: float
    opening: str | None


@dataclass(frozen=True, slots=True)
class OtherBall:
    """A ball of a run after the first one: its number (2 or more) and its rings."""

    ball: int
    rings: tuple[RingPassage, ...]


@dataclass(frozen=True, slots=True)
class GoalGiven:
    """A goal of a run: ring, and rig time at which it was given, s. Goals of equal time are visited in their order."""

    ring: int
    t: float


@dataclass(frozen=True, slots=True)
class Start:
    """Where the ball was placed: ring, and angle in rad."""

    ring: int
    theta: float


@dataclass(frozen=True)
class NavigationResult(Result):
    """The outcome of one navigation, as `navigate --json` prints it.

    reason: "arrived", a failure kind, "stopped" (from outside), "skipped", "interrupted", or "crashed" (the program
        itself raised an unexpected exception)"""

    kind: ClassVar[str] = "run"

    success: bool  # the tree succeeded with the ball in the newest of `goals`
    reason: str
    time_s: float
    seed: int
    rig: str
    rings: tuple[RingPassage, ...]  # of the first ball
    failures: tuple[Failure, ...]
    replans: int
    planner_ms: dict[str, float]  # p50, p99 and max of all plans
    log: str | None
    tick_ms: dict[str, float] = field(default_factory=dict)
    goals: tuple[GoalGiven, ...] = ()
    doubts: tuple[Doubt, ...] = ()
    start: Start | None = None  # None if the run ended before the ball was placed
    others: tuple[OtherBall, ...] = ()  # balls after the first
    misfits: tuple[Misfit, ...] = ()

    def json(self) -> dict[str, Any]:
        """The document that `navigate --json` prints."""
        return _result_adapter().dump_python(self, mode="json")

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> NavigationResult:
        """Read a document of `json`, exact to the last bit. Raises ValueError for any other document."""
        return _result_adapter().validate_python(document)


def spread(values: Sequence[float]) -> dict[str, float]:
    """p50, p99 and max of the values, such as times in ms; 0 without values."""
    if not values:
        return {"p50": 0.0, "p99": 0.0, "max": 0.0}
    p50, p99 = np.percentile(values, [50.0, 99.0])
    return {"p50": round(float(p50), 4), "p99": round(float(p99), 4), "max": round(float(max(values)), 4)}


@cache
def _result_adapter() -> TypeAdapter[NavigationResult]:
    from pydantic import TypeAdapter

    return TypeAdapter(NavigationResult)
