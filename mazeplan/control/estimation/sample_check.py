"""Plausibility check of each sample before the estimator uses it.

A sample with an old time stamp is skipped; the rig keeps its command. A position that is not finite, or metres away,
counts as a ball not seen. The estimator handles a tilt that is not finite. If such a fault lasts LASTING_S, the rig has
failed. A wrong sampling rate is reported.
"""

from __future__ import annotations

import math
from dataclasses import fields, replace
from numbers import Real
from statistics import median

from mazeplan.core.errors import RigError
from mazeplan.core.records import Doubt, Observation

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
