"""A learned policy: a small network that gives the tilt of the plate for a ball on its way to an opening.

It imitates the planner (`run.campaign.imitation`). Inputs and outputs are relative to the ball: outwards from the
centre, and along the ring. Relative to the ball, a ring looks the same from everywhere. Only the limits of the plate
and the servos have fixed axes, so there are angles among the inputs. The decision needs numpy alone:

    z = (x - mean) / scale,   h = tanh(W h + b) for each hidden layer,   tilt = limit (W h + b)

`Policy.distance` measures how far an input is from the training data. It uses the first KNOWN columns, scaled, and
their distance to the nearest of some hundred centres of the training data. The unit is the distance within which 99.9 %
of the training data lie: up to 1, the policy knows such a state.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mazeplan.control.tilt import Plate
from mazeplan.core.records import Array, Command, State
from mazeplan.maze.geometry import Opening, Ring

Single = NDArray[np.float32]

# turn: angle to the opening, in the direction already chosen, rad; near: tanh(turn / NEAR), finer near the opening
# track: radius of the middle of the channel, m; off: radius of the ball beyond that middle, m
# speed_*: m/s; tilt_*: tilt of the plate, rad; rate_*: its rate, rad/s
# inwards: whether the opening leads inwards; passing: whether the ball was already in front of the opening
# cos_n, sin_n: of n times the angle of the ball
INPUTS = (
    "turn", "near", "track", "off", "speed_out", "speed_along", "tilt_out", "tilt_along", "rate_out", "rate_along",
    "inwards", "passing", "cos_1", "sin_1", "cos_2", "sin_2", "cos_4", "sin_4",
)  # fmt: skip
KNOWN = 12
NEAR = 0.15  # rad
COS, SIN = INPUTS.index("cos_1"), INPUTS.index("sin_1")


def policy_inputs(state: State, ring: Ring, opening: Opening, turn: float, passing: bool, plate: Plate) -> Array:
    """INPUTS (18,) for a ball in a channel.

    state:    at the moment when the command acts
    turn:     angle to the opening, in the direction already chosen, rad
    passing:  whether the ball was already in front of the opening"""
    r, theta = max(state.r, 1e-6), state.theta
    c, s = state.x / r, state.y / r
    a, b = state.beta + plate.offset_beta, -(state.gamma + plate.offset_gamma)
    a_dot, b_dot = state.beta_dot, -state.gamma_dot
    return np.array([
        turn, math.tanh(turn / NEAR), ring.track_radius, r - ring.track_radius,
        c * state.vx + s * state.vy, -s * state.vx + c * state.vy,
        c * a + s * b, -s * a + c * b, c * a_dot + s * b_dot, -s * a_dot + c * b_dot,
        float(opening.leads_to(ring.number) == opening.inner), float(passing),
        c, s, math.cos(2.0 * theta), math.sin(2.0 * theta), math.cos(4.0 * theta), math.sin(4.0 * theta),
    ])  # fmt: skip


@dataclass(frozen=True, eq=False)
class Policy:
    """A learned policy.

    mean, scale:  of the inputs, (18,)"""

    layers: tuple[tuple[Single, Single], ...]  # weights (out, in) and bias (out,) of each layer
    mean: Single
    scale: Single
    centres: Single  # centres of the scaled training inputs, (K, KNOWN)
    reach: float  # scaled distance that counts as 1
    limit: float  # tilt that the network calls 1, rad
    facts: dict[str, Any] = field(default_factory=dict)  # how the policy was trained
    source: str | None = None  # folder of the policy; None if no file holds it

    def tilt(self, inputs: Array) -> Array:
        """Tilt outwards and along the ring, (2,) or (N, 2), rad, not limited, for inputs (18,) or (N, 18)."""
        h: Array = (inputs - self.mean) / self.scale
        for weights, bias in self.layers[:-1]:
            h = np.tanh(h @ weights.T + bias)
        weights, bias = self.layers[-1]
        return self.limit * (h @ weights.T + bias)

    def command(self, inputs: Array, plate: Plate) -> Command:
        """The command for inputs (18,), inside the limits."""
        out, along = self.tilt(inputs).tolist()
        c, s = float(inputs[COS]), float(inputs[SIN])
        return plate.clip(c * out - s * along - plate.offset_beta, -(s * out + c * along) - plate.offset_gamma)

    def distance(self, inputs: Array) -> float:
        """Distance of inputs (18,) from the training data; up to 1, the policy knows such inputs."""
        z = (inputs[:KNOWN] - self.mean[:KNOWN]) / self.scale[:KNOWN]
        gap = self.centres - z
        return math.sqrt(float(np.einsum("ij,ij->i", gap, gap).min())) / self.reach
