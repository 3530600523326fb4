"""Memory of the openings: counts of successes and failures for a Beta posterior, which fade with time.

A failure may be temporary. Therefore the counts decay with rig time by exp(-t / fading_s): recent attempts count most,
and an opening that is no longer tried returns to the prior. The counts live as long as the run, over all its goals.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

FADING_S = 120.0  # s of rig time in which counts fall to 1/e


@dataclass
class OpeningMemory:
    """Counts of successes and failures by opening.

    fading_s: rig time until counts fall to 1/e, s
    attempts: number of recorded attempts, without fading
    """

    fading_s: float = FADING_S
    _counts: dict[str, tuple[float, float, float]] = field(default_factory=dict)  # successes, failures, when
    attempts: int = field(default=0, compare=False)

    def record(self, name: str, success: bool, now: float) -> None:
        """Record one attempt at an opening at rig time now, s."""
        successes, failures = self.tries(name, now)
        self._counts[name] = (successes + success, failures + (not success), now)
        self.attempts += 1

    def tries(self, name: str, now: float) -> tuple[float, float]:
        """Faded successes and failures of an opening at rig time now, s."""
        successes, failures, when = self._counts.get(name, (0.0, 0.0, now))
        kept = math.exp(-max(now - when, 0.0) / self.fading_s)
        return successes * kept, failures * kept

    def at_end(self, now: float) -> dict[str, tuple[float, float]]:
        """Faded successes and failures of all tried openings at rig time now, s."""
        return {name: self.tries(name, now) for name in self._counts}
