"""What a story keeps count of: rows of numbers, how far plans were off, and what happened at openings."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from mazeplan.maths.angles import difference
from mazeplan.maze.memory import FADING_S
from mazeplan.records import Array
from mazeplan.view.moment import COLUMNS

PLANS = 90  # earlier plans that are held against what came of them, at most
ENOUGH = 5  # plans of an age from which on something is said of it
LEVEL = 0.9  # of the bounds of a posterior
# Beta prior of an opening that was never tried: that of `maze.graph.RouteOptions`, which would bring networkx along
PRIOR = (3.0, 0.3)


def number(value: Any) -> float:
    """The value, if it is a finite number; else NaN."""
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else math.nan


@dataclass(frozen=True)
class Followed:
    """A plan, with the ring and the opening for which it was made."""

    t0: float
    dt: float
    theta: Array
    ring: int = 0
    radius: float = 0.0
    opening: str | None = None

    def at(self, t: float) -> float:
        """Where it wants the ball at time t, as `control.tracking.plan_step` has it."""
        step = 0 if math.isnan(t) else round((t - self.t0) / self.dt)
        return float(self.theta[min(max(step, 0), len(self.theta) - 2)])


class Doubt:
    """How far off plans were, by age."""

    def __init__(self) -> None:
        self._plans: deque[Followed] = deque(maxlen=PLANS)
        self._squares, self._count = np.zeros(0), np.zeros(0)

    def keep(self, plan: Followed) -> None:
        """One more plan that was followed."""
        if not self._plans or self._plans[-1].t0 != plan.t0:
            self._plans.append(plan)

    def compare(self, t: float, theta: float, ring: Any, opening: Any) -> None:
        """Hold plans to this opening against where the ball is in the same ring."""
        if math.isnan(t) or math.isnan(theta):
            return
        for plan in self._plans:
            step = round((t - plan.t0) / plan.dt)
            if plan.ring != ring or plan.opening != opening or not 0 <= step < len(plan.theta):
                continue
            if step >= len(self._count):
                more = step + 1 - len(self._count)
                self._squares, self._count = (np.append(a, np.zeros(more)) for a in (self._squares, self._count))
            off = plan.radius * difference(theta, float(plan.theta[step]))
            self._squares[step] += off * off
            self._count[step] += 1.0

    def after(self, steps: int) -> Array:
        """rms, m, (steps,); what is older than anything known: NaN."""
        doubt = np.full(steps, np.nan)
        known = min(steps, len(self._count))
        enough = self._count[:known] >= ENOUGH
        doubt[:known][enough] = np.sqrt(self._squares[:known][enough] / self._count[:known][enough])
        return doubt


@dataclass(frozen=True)
class Tries:
    """Successes and failures at openings as they counted at time t; they fade (`maze.memory`)."""

    t: float = 0.0
    counts: dict[str, tuple[float, float]] | None = None
    fading_s: float = FADING_S

    @staticmethod
    def of(document: dict[str, Any]) -> Tries:
        """As a message of the topic /openings has them."""
        names, wins, losses = (document.get(key, ()) for key in ("names", "successes", "failures"))
        counts = {name: (float(a), float(b)) for name, a, b in zip(names, wins, losses, strict=False)}
        return Tries(number(document.get("t")), counts, float(document.get("fading_s", FADING_S)))

    def now(self, name: str, t: float) -> tuple[float, float, float, float, float]:
        """Successes, failures, mean of the posterior, and its bounds."""
        kept = math.exp(-max(t - self.t, 0.0) / self.fading_s)
        successes, failures = (kept * count for count in (self.counts or {}).get(name, (0.0, 0.0)))
        a, b = PRIOR[0] + successes, PRIOR[1] + failures
        return successes, failures, a / (a + b), *bounds(round(a, 2), round(b, 2))


class Rows:
    """A table that grows at its end and forgets its beginning; what was handed out stays as it was."""

    def __init__(self, kept: int) -> None:
        self._kept, self._count = kept, 0
        self._rows = np.empty((4 * kept, len(COLUMNS)))

    def add(self, row: list[float]) -> None:
        """One more at the end."""
        if self._count == len(self._rows):
            rows = np.empty_like(self._rows)
            rows[: self._kept] = self._rows[-self._kept :]
            self._rows, self._count = rows, self._kept
        self._rows[self._count] = row
        self._count += 1

    def last(self, name: str) -> float:
        """The newest number in a column that is one; NaN where there is none."""
        column = self.newest()[:, COLUMNS.index(name)]
        known = column[~np.isnan(column)]
        return float(known[-1]) if len(known) else math.nan

    def newest(self) -> Array:
        """The last rows, (N, len(COLUMNS))."""
        return self._rows[max(0, self._count - self._kept) : self._count]


@lru_cache(maxsize=4096)
def bounds(a: float, b: float) -> tuple[float, float]:
    """Of a Beta distribution: between them it is with LEVEL."""
    from scipy.special import betaincinv

    rest = 0.5 * (1.0 - LEVEL)
    return float(betaincinv(a, b, rest)), float(betaincinv(a, b, 1.0 - rest))
