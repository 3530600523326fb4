"""Checks of the measured samples: whether they are plausible, before the estimator uses them, and whether the ball has
left the maze.

A sample with an old time stamp is skipped; the rig keeps its command. A position that is not finite, or metres away,
counts as a ball not seen. The estimator handles a tilt that is not finite. If such a fault lasts LASTING_S, the rig has
failed. A wrong sampling rate is reported.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, fields, replace
from numbers import Real
from statistics import median

from mazeplan.core.errors import RigError
from mazeplan.core.records import Doubt, Observation
from mazeplan.maze.geometry import Maze

LASTING_S = 0.5  # s; without measurements the tilt is unknown by then
GAP = 4.5  # samples; a larger step of the clock means lost samples
FAR_M = 2.0  # m; larger positions are in a wrong unit
EACH = 30  # samples per check of the sampling rate
RATE = 0.25  # allowed relative difference from the rig's rate
FROZEN_S, TURNED = 1.5, math.radians(3.0)  # s of one position; turn of the plate by which a ball would have moved
FAILED = {
    "far": f"it measures the ball more than {FAR_M:g} m from the middle: it is out, or x and y are not in m",
    "clock": "its clock does not go on",
    "tilt": "its tilt sensor measures no number, or no tilt of a plate: beta and gamma are in rad",
}
SIGMAS = 4.0  # margin past the middle of the outermost wall, in sigmas of one sample of the camera
SAMPLES, AGREEING = 3, 2  # number of last samples that vote; surplus of votes needed for a decision
FIELDS = [field for field in fields(Observation) if field.name != "others"]


def _near(ball: Observation) -> Observation:
    """The sample of another ball; it counts as not seen if its position is not finite or metres away."""
    far = ball.x is not None and ball.y is not None and not math.hypot(ball.x, ball.y) <= FAR_M
    return replace(ball, x=None, y=None) if far else ball


class SampleCheck:
    """Check of the samples of one run.

    found:   doubts about the last sample, as words of `records.Doubt`
    doubts:  all doubts that have begun, in order"""

    def __init__(self, rate_hz: float) -> None:
        self._dt, self._most = 1.0 / rate_hz, max(2, round(LASTING_S * rate_hz))
        self._last: float | None = None
        self._steps: list[float] = []  # s, between samples since the last check of the rate
        self._off = False  # whether the rate differs from the rig's
        self._still: Observation | None = None  # the first sample with the ball where it is now
        self._low, self._high = (math.inf, math.inf), (-math.inf, -math.inf)  # tilts since then, rad
        self.found: set[str] = set()
        self._since: dict[str, int] = {}  # number of samples in a row, by doubt
        self.doubts: list[Doubt] = []

    def admit(self, observation: Observation) -> Observation | None:
        """The usable part of a sample, or None. Raises RigError if the clock stands still for LASTING_S."""
        if not isinstance(observation, Observation):
            got = type(observation).__name__
            raise RigError(f"observe() of the rig returned {got}, expected Observation(t, x, y, beta, gamma)")
        if observation.beta is None and observation.gamma is None:  # a rig without a tilt sensor
            observation = replace(observation, beta=math.nan, gamma=math.nan)
        self._numbers(observation)
        t, last = observation.t, self._last
        if not math.isfinite(t) or (last is not None and t <= last):
            self._note({"clock"}, 0.0 if last is None else last)
            return None
        self._last = t
        self.found = {"gap"} if last is not None and t - last > GAP * self._dt else set()
        self.found |= {"rate"} if last is not None and self._rate_is_off(t - last) else set()
        if observation.others:
            observation = replace(observation, others=tuple(map(_near, observation.others)))
        x, y = observation.x, observation.y
        self.found |= {"frozen"} if self._frozen(observation) else set()
        if x is None or y is None or math.hypot(x, y) <= FAR_M:
            return observation
        self.found.add("far" if math.isfinite(x) and math.isfinite(y) else "position")
        return replace(observation, x=None, y=None)

    def _rate_is_off(self, step: float) -> bool:
        """Whether the median step of the last EACH samples contradicts the rig's rate."""
        self._steps.append(step)
        if len(self._steps) == EACH:
            self._off = abs(median(self._steps) / self._dt - 1.0) > RATE
            self._steps.clear()
        return self._off

    def _frozen(self, observation: Observation) -> bool:
        """Whether the ball is at the same position for FROZEN_S, bit by bit, while the plate turns."""
        first, tilt = self._still, (observation.beta, observation.gamma)
        if first is None or (observation.x, observation.y) != (first.x, first.y):
            self._still, self._low, self._high = observation, tilt, tilt
            return False
        self._low = min(self._low[0], tilt[0]), min(self._low[1], tilt[1])
        self._high = max(self._high[0], tilt[0]), max(self._high[1], tilt[1])
        turned = any(high - low > TURNED for low, high in zip(self._low, self._high, strict=True))
        return observation.seen and observation.t - first.t >= FROZEN_S and turned

    @staticmethod
    def _numbers(observation: Observation) -> None:
        """Raises RigError for a field that is no number."""
        for other in observation.others:
            SampleCheck._numbers(other)
        for field in FIELDS:
            value = getattr(observation, field.name)
            if not isinstance(value, Real) and not (value is None and field.name in ("x", "y")):
                expected = "a number or None" if field.name in ("x", "y") else "a number"
                raise RigError(f"observe() of the rig: {field.name}: got {value!r}, expected {expected}")

    def judge(self, doubts: set[str], t: float) -> list[Doubt]:
        """Add the estimator's doubts about the last sample. Returns the doubts that begin with this sample.

        Raises RigError when the tilt was implausible for LASTING_S."""
        self.found |= doubts
        self._since = {what: count for what, count in self._since.items() if what in self.found}
        return self._note(self.found, t)

    def _note(self, found: set[str], t: float) -> list[Doubt]:
        """Count one more sample with these doubts. Returns the doubts that begin."""
        begun = [Doubt(what, t) for what in sorted(found) if what not in self._since]
        self.doubts += begun
        for what in found:
            self._since[what] = self._since.get(what, 0) + 1
            if what in FAILED and self._since[what] >= self._most:
                raise RigError(f"the rig failed at t = {t:.3f} s: {FAILED[what]}")
        return begun


@dataclass(frozen=True, slots=True)
class Out:
    """A ball that has left the maze.

    x, y:    last position seen outside, m"""

    since: float  # rig time of the first sample outside, s
    x: float
    y: float
    beyond: float  # its distance past the middle of the outermost wall, m

    @property
    def message(self) -> str:
        """Where the ball is, in one line."""
        return f"the ball has left the maze: it is {1e3 * self.beyond:.0f} mm beyond the rim"


def rim_of(maze: Maze) -> float:
    """Radius of the middle of the outermost wall, m."""
    rim = maze.walls[0]
    return 0.5 * (rim.inner_radius + rim.outer_radius)


class RimWatch:
    """Watches whether one ball has left the maze. `out`: where the ball is outside; None while it is inside.

    The estimator cannot detect this, because its model keeps every ball inside the rim. A ball counts as outside if it
    is measured past the middle of the outermost wall, by more than the noise of the camera.

    camera_sigma: 1 sigma of one sample, m."""

    def __init__(self, maze: Maze, camera_sigma: float) -> None:
        self._rim, self._margin = rim_of(maze), SIGMAS * camera_sigma
        self._last: deque[tuple[float, int]] = deque(maxlen=SAMPLES)  # t, and 1 outside, -1 inside, 0 not seen
        self._outside = (math.nan, math.nan, math.nan)  # x, y and `Out.beyond` of the last sample outside
        self.out: Out | None = None

    def update(self, t: float, place: tuple[float, float] | None) -> Out | None:
        """Take in one sample. Returns `out`.

        t:      rig time, s
        place:  measured x and y, m; None if the ball was not seen

        The last SAMPLES decide: AGREEING of them must agree, and none may say the opposite. So one wrong position does
        not count as a ball outside, but a ball that flies out of the picture does."""
        beyond = math.nan if place is None else math.hypot(*place) - self._rim
        self._last.append((t, 0 if place is None else 1 if beyond > self._margin else -1))
        votes, out = sum(vote for _, vote in self._last), self.out
        if place is not None and beyond > self._margin:
            self._outside = (*place, beyond)
        if votes >= AGREEING:
            since = next(then for then, vote in self._last if vote > 0) if out is None else out.since
            self.out = Out(since, *self._outside)
        elif votes <= -AGREEING:
            self.out = None
        return self.out
