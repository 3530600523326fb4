"""Statistics of a run for the page: rows of numbers, errors of plans by age, chances of openings."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from mazeplan.apps.view.moment import COLUMN, COLUMNS
from mazeplan.core.maths.angles import difference
from mazeplan.core.records import Array
from mazeplan.maze.memory import FADING_S

PLANS = 90  # number of newest plans that are compared with the ball
ENOUGH = 5  # minimum number of plans of an age for an error
LEVEL = 0.9  # probability between the bounds of a posterior
# Beta prior of an untried opening, the same as in `maze.graph.RouteOptions`; importing that would import networkx
PRIOR = (3.0, 0.3)


def number(value: Any) -> float:
    """The value as a float; NaN for anything but a finite number."""
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else math.nan


@dataclass(frozen=True)
class FollowedPlan:
    """A plan, with the ring and the opening for which it was made.

    theta: planned angles, (N,)
    radius: of the ring's track, m"""

    t0: float
    dt: float
    theta: Array
    ring: int = 0
    radius: float = 0.0
    opening: str | None = None

    def at(self, t: float) -> float:
        """Planned angle at time t, at the step that `control.tracking.plan_step` takes."""
        step = 0 if math.isnan(t) else round((t - self.t0) / self.dt)
        return float(self.theta[min(max(step, 0), len(self.theta) - 2)])


class PlanErrors:
    """Errors of plans by their age."""

    def __init__(self) -> None:
        self._plans: deque[FollowedPlan] = deque(maxlen=PLANS)
        self._squares, self._count = np.zeros(0), np.zeros(0)

    def keep(self, plan: FollowedPlan) -> None:
        """Add a plan that was followed."""
        if not self._plans or self._plans[-1].t0 != plan.t0:
            self._plans.append(plan)

    def compare(self, t: float, theta: float, ring: Any, opening: Any) -> None:
        """Compare the angle of the ball in a ring with the kept plans for this ring and this opening."""
        if math.isnan(t) or math.isnan(theta):
            return
        for plan in self._plans:
            step = round((t - plan.t0) / plan.dt)
            if plan.ring != ring or plan.opening != opening or not 0 <= step < len(plan.theta):
                continue
            if step >= len(self._count):
                more = np.zeros(step + 1 - len(self._count))
                self._squares, self._count = np.append(self._squares, more), np.append(self._count, more)
            self._squares[step] += (plan.radius * difference(theta, float(plan.theta[step]))) ** 2
            self._count[step] += 1.0

    def after(self, steps: int) -> Array:
        """rms error of plans after 0, 1, 2 ... steps, m, (steps,); NaN for ages with too few plans."""
        out, known = np.full(steps, math.nan), min(steps, len(self._count))
        enough = np.flatnonzero(self._count[:known] >= ENOUGH)
        out[enough] = np.sqrt(self._squares[enough] / self._count[enough])
        return out


@dataclass(frozen=True)
class OpeningTries:
    """Successes and failures at openings as they counted at time t; they fade (`maze.memory`)."""

    t: float = 0.0
    counts: dict[str, tuple[float, float]] = field(default_factory=dict)
    fading_s: float = FADING_S

    @staticmethod
    def of(document: dict[str, Any]) -> OpeningTries:
        """From a message of the topic /openings."""
        names, wins, losses = (document.get(key, ()) for key in ("names", "successes", "failures"))
        counts = {name: (float(a), float(b)) for name, a, b in zip(names, wins, losses, strict=False)}
        return OpeningTries(number(document.get("t")), counts, float(document.get("fading_s", FADING_S)))

    def now(self, name: str, t: float) -> tuple[float, float, float, float, float]:
        """Successes and failures as they count at time t, mean of the posterior, and its two bounds."""
        kept = math.exp(-max(t - self.t, 0.0) / self.fading_s)
        successes, failures = (kept * count for count in self.counts.get(name, (0.0, 0.0)))
        a, b = PRIOR[0] + successes, PRIOR[1] + failures
        return successes, failures, a / (a + b), *bounds(round(a, 2), round(b, 2))


class RecentRows:
    """A table that grows at its end and forgets its beginning. Rows that `newest` has returned do not change."""

    def __init__(self, kept: int) -> None:
        self._kept, self._count = kept, 0
        self._rows = np.empty((4 * kept, len(COLUMNS)))

    def add(self, row: list[float]) -> None:
        """Add a row at the end."""
        if self._count == len(self._rows):
            rows = np.empty_like(self._rows)
            rows[: self._kept] = self._rows[-self._kept :]
            self._rows, self._count = rows, self._kept
        self._rows[self._count] = row
        self._count += 1

    def last(self, name: str) -> float:
        """The newest finite number in a column; NaN without one."""
        column = self.newest()[:, COLUMN[name]]
        known = column[~np.isnan(column)]
        return float(known[-1]) if len(known) else math.nan

    def newest(self) -> Array:
        """The last rows, (N, len(COLUMNS))."""
        return self._rows[max(0, self._count - self._kept) : self._count]


@lru_cache(maxsize=4096)
def bounds(a: float, b: float) -> tuple[float, float]:
    """The bounds between which a Beta distribution has the probability LEVEL, with equal tails."""
    from scipy.special import betaincinv

    rest = 0.5 * (1.0 - LEVEL)
    return float(betaincinv(a, b, rest)), float(betaincinv(a, b, 1.0 - rest))
