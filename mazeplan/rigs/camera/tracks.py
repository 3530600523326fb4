"""Tells balls apart that look alike: decides which sighting belongs to which ball.

The place of each ball is predicted from its last two sightings, x + v dt. The assignment of sightings to balls has the
smallest sum of squared distances from the predictions. A sighting farther than `reach` from the prediction does not
belong to the ball. The reach grows while a ball is unseen.
"""

from __future__ import annotations

import math
from itertools import permutations

import numpy as np

from mazeplan.core.records import Array

REACH = 0.012  # m, about a ball's diameter
FASTER = 0.4  # m/s, growth of the reach while a ball is not seen
MEMORY = 0.15  # s for which the last speed of an unseen ball counts
Place = tuple[float, float]


class Tracks:
    """Tracks of balls, in the order of the places (m) where they begin."""

    def __init__(self, places: list[Place]) -> None:
        self._last = [np.array(place) for place in places]
        self._speed = [np.zeros(2) for _ in places]
        self._at = [0.0 for _ in places]

    def take(self, t: float, found: list[Place]) -> list[Place | None]:
        """The sighting of each ball, in a picture taken at rig time t, s; None for a ball that was not seen.

        found: all sightings in the picture, in any order."""
        count = len(self._last)
        ahead = [self._predicted(k, t) for k in range(count)]
        reach = [REACH + FASTER * max(0.0, t - at) for at in self._at]
        # cost of an unseen ball: the same for all, so that a ball that was hidden before is not preferred
        unseen = max(reach) ** 2
        slots: list[Place | None] = [*found, *[None] * count]
        best, least = [None] * count, math.inf
        for chosen in permutations(range(len(slots)), count):
            cost = 0.0
            for k, i in enumerate(chosen):
                place = slots[i]
                cost += unseen if place is None else float(np.sum((np.array(place) - ahead[k]) ** 2))
            if cost < least - 1e-15:
                best, least = [slots[i] for i in chosen], cost
        placed = [self._within(place, ahead[k], reach[k]) for k, place in enumerate(best)]
        for k, place in enumerate(placed):
            if place is not None:
                self._keep(k, t, np.array(place))
        return placed

    def _predicted(self, ball: int, t: float) -> Array:
        return self._last[ball] + self._speed[ball] * min(max(0.0, t - self._at[ball]), MEMORY)

    @staticmethod
    def _within(place: Place | None, ahead: Array, reach: float) -> Place | None:
        return None if place is None or math.dist(place, ahead) > reach else place

    def _keep(self, ball: int, t: float, place: Array) -> None:
        step = t - self._at[ball]
        if 0.0 < step <= MEMORY:
            self._speed[ball] = (place - self._last[ball]) / step
        else:
            self._speed[ball] = np.zeros(2)
        self._last[ball], self._at[ball] = place, t
