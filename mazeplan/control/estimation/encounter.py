"""Two balls that meet: their estimators predict them together.

An `Estimator` predicts its ball as if the ball were alone. While two balls are near each other, each prediction goes in
steps of STEP, and `collide` looks after each step whether the balls touch. Equal balls that approach along the line of
their centres at the speed v exchange the impulse J (over the mass of a ball):

    J = (1 + e) v / 2,    and their velocities change by    +-(5/7) J

e is the restitution of ball against ball. The factor 5/7: the impact changes the speed but not the spin of a rolling
ball, and within some 10 ms friction at the floor brings both together again, at (5 speed + 2 spin) / 7.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from mazeplan.control.estimation.delay_bank import DelayBank
from mazeplan.control.estimation.estimator import Estimator
from mazeplan.core.constants import FREE_ROLLING
from mazeplan.core.records import Array, Observation, State

NEAR = 0.03  # m between the surfaces of two balls; further apart they cannot meet within a prediction
STEP = 1.0 / 150.0  # s, at most
RESTITUTION = 0.3  # of ball against ball
SHARE = 0.5 * FREE_ROLLING * (1.0 + RESTITUTION)  # of the speed at which they approach
Move = Callable[[Array, float, float], None]  # advances a state from one moment to another


def update_balls(
    estimators: Sequence[Estimator | DelayBank], samples: Sequence[Observation], radius: float
) -> list[State]:
    """`Estimator.update` of each ball, of `radius` m, with its sample; two balls that are near are predicted together.

    An estimator that does not know the camera's delay yet (`DelayBank`) predicts its ball alone."""
    pair = [e for e in estimators if isinstance(e, Estimator)]
    if len(pair) != 2 or len(estimators) != 2 or not _near(pair, radius):
        return [estimator.update(sample) for estimator, sample in zip(estimators, samples, strict=True)]
    for estimator, sample in zip(pair, samples, strict=True):
        estimator.begin(sample)
    _strike(pair, pair[0].moment(samples[0]), radius)
    for estimator, sample in zip(pair, samples, strict=True):
        estimator.correct(sample)
    z, now = [estimator.ball() for estimator in pair], samples[0].t
    _together([e.advance for e in pair], z, pair[0].measured_at or now, now, radius)
    for estimator, state in zip(pair, z, strict=True):
        estimator.set_tilt(state)
    _together([e.predict_queued for e in pair], z, pair[0].known_until(now), now + pair[0].acts_after, radius)
    return [e.finish(sample, state) for e, sample, state in zip(pair, samples, z, strict=True)]


def collide(first: Array, second: Array, radius: float) -> Array | None:
    """Separate two balls that overlap, states (9,) each, changed in place. The velocity that the second one gains and
    the first one loses, (2,) m/s; None if they do not touch."""
    apart = second[:2] - first[:2]
    distance = math.hypot(*apart)
    if distance >= 2.0 * radius or distance < 1e-9:
        return None
    normal = apart / distance
    first[:2] -= 0.5 * (2.0 * radius - distance) * normal
    second[:2] += 0.5 * (2.0 * radius - distance) * normal
    change = SHARE * max(float((first[2:4] - second[2:4]) @ normal), 0.0) * normal
    first[2:4] -= change
    second[2:4] += change
    return change


def _near(pair: Sequence[Estimator], radius: float) -> bool:
    """Whether both balls were measured last at the same moment, near each other."""
    first, second = pair
    if first.measured_at is None or first.measured_at != second.measured_at:
        return False
    return math.hypot(*(second.ball() - first.ball())[:2]) < 2.0 * radius + NEAR


def _steps(start: float, end: float) -> list[tuple[float, float]]:
    """Equal steps from start to end, of at most STEP."""
    count = math.ceil((end - start) / STEP - 1e-6)
    times = np.linspace(start, end, max(count, 0) + 1)
    return [(float(a), float(b)) for a, b in pairwise(times)]


def _together(moves: Sequence[Move], z: Sequence[Array], start: float, end: float, radius: float) -> None:
    """Advance both states in place."""
    for a, b in _steps(start, end):
        for move, state in zip(moves, z, strict=True):
            move(state, a, b)
        collide(z[0], z[1], radius)


def _strike(pair: Sequence[Estimator], moment: float, radius: float) -> None:
    """Change the velocities of both filters where their balls meet before the moment of the pictures."""
    z = [estimator.ball() for estimator in pair]
    for a, b in _steps(pair[0].measured_at or moment, moment):
        for estimator, state in zip(pair, z, strict=True):
            estimator.advance(state, a, b)
        change = collide(z[0], z[1], radius)
        if change is not None and change.any():
            pair[0].strike(b, -change)
            pair[1].strike(b, change)
