"""Looks at each sample before the estimator does, and tells when something that was measured cannot be true.

A sample whose time does not go on (the last one again, or one from before) says nothing new: it is passed over, and the
rig keeps its command. A position that is no number, or metres away, is a ball that is not seen; a tilt that is no
number is left to the estimator, which goes on by the commands. None of this may last: after LASTING_S the rig has
failed. A rhythm that is not the rig's own is told.
"""

from __future__ import annotations

import math
from dataclasses import fields, replace
from numbers import Real
from statistics import median

from mazeplan.errors import RigError
from mazeplan.records import Doubt, Observation

LASTING_S = 0.5  # s; by then a plate that went by commands alone may be anywhere
GAP = 4.5  # samples; a clock that goes on by more at once has leapt, or samples were lost
FAR_M = 2.0  # no plate is so large; who says so means millimetres, or pixels
EACH = 30  # samples, by which it is judged how many come a second
RATE = 0.25  # relative difference from what the rig says of that
FAILED = {
    "far": f"it measures the ball more than {FAR_M:g} m from the middle: it is out, or x and y are not in m",
    "clock": "its clock does not go on",
    "tilt": "its tilt sensor measures no number, or nothing that a plate could do",
}


class Scrutiny:
    """Of the samples of one run. `found`: words of `records.Doubt` for the sample that was admitted last; `doubts`:
    those that began, in order."""

    def __init__(self, rate_hz: float) -> None:
        self._dt, self._most = 1.0 / rate_hz, max(2, round(LASTING_S * rate_hz))
        self._last: float | None = None
        self._steps: list[float] = []  # s, between samples since the rate was judged last
        self._off = False  # whether they did not come as the rig says
        self.found: set[str] = set()
        self._since: dict[str, int] = {}  # for how many samples in a row
        self.doubts: list[Doubt] = []

    def admit(self, observation: Observation) -> Observation | None:
        """What of a sample may be used; None: nothing. Raises RigError when the clock has not gone on for LASTING_S."""
        if not isinstance(observation, Observation):
            got = type(observation).__name__
            raise RigError(f"observe() of the rig returned {got}, expected Observation(t, x, y, beta, gamma)")
        self._numbers(observation)
        t, last = observation.t, self._last
        if not math.isfinite(t) or (last is not None and t <= last):
            self._note({"clock"}, 0.0 if last is None else last)
            return None
        self._last = t
        self.found = {"gap"} if last is not None and t - last > GAP * self._dt else set()
        self.found |= {"rate"} if last is not None and self._rate_is_off(t - last) else set()
        x, y = observation.x, observation.y
        if x is None or y is None or math.hypot(x, y) <= FAR_M:
            return observation
        self.found.add("far" if math.isfinite(x) and math.isfinite(y) else "position")
        return replace(observation, x=None, y=None)

    def _rate_is_off(self, step: float) -> bool:
        """Whether the last EACH samples but for the newest came in another rhythm than the rig says, by their median:
        some may be late or lost."""
        self._steps.append(step)
        if len(self._steps) == EACH:
            self._off = abs(median(self._steps) / self._dt - 1.0) > RATE
            self._steps.clear()
        return self._off

    @staticmethod
    def _numbers(observation: Observation) -> None:
        """Raises RigError for what is no number at all, which no later sample will mend."""
        for field in fields(observation):
            value = getattr(observation, field.name)
            if not isinstance(value, Real) and not (value is None and field.name in ("x", "y")):
                expected = "a number or None" if field.name in ("x", "y") else "a number"
                raise RigError(f"observe() of the rig: {field.name}: got {value!r}, expected {expected}")

    def judge(self, doubts: set[str], t: float) -> list[Doubt]:
        """Take in what the estimator did not believe of the sample that was admitted last; doubts that begin with it.

        Raises RigError when the tilt could not be believed for LASTING_S."""
        self.found |= doubts
        self._since = {what: count for what, count in self._since.items() if what in self.found}
        return self._note(self.found, t)

    def _note(self, found: set[str], t: float) -> list[Doubt]:
        """One more sample of these doubts; the others stay as they are."""
        begun = [Doubt(what, t) for what in sorted(found) if what not in self._since]
        self.doubts += begun
        for what in found:
            self._since[what] = self._since.get(what, 0) + 1
            if what in FAILED and self._since[what] >= self._most:
                raise RigError(f"the rig failed at t = {t:.3f} s: {FAILED[what]}")
        return begun
