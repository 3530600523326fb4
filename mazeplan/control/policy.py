"""A learned policy: a small network from the ball's state on the way to an opening to the tilt of the plate.

It imitates the planner (`run.campaign.imitation`). What it sees and says is relative to the ball: out from the centre,
and along the ring. A ring looks the same from everywhere but for the limits of the plate and the servos, which have
axes; hence the angles among the inputs. The decision is numpy alone:

    z = (x - mean) / scale,   h = tanh(W h + b) for each hidden layer,   tilt = limit (W h + b)

How far an input is from the training data is the distance of its first KNOWN columns, scaled, to the nearest of some
hundred centres of that data, over the distance within which 99.9 % of it are: up to 1 it knows such a state.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mazeplan.core.records import Array, Command, State
from mazeplan.maze.geometry import Opening, Ring

if TYPE_CHECKING:  # a check of a tree needs no plate
    from mazeplan.control.tilt import Plate

Single = NDArray[np.float32]

# turn: rad to the opening, by the way begun; near: the same, resolved near it; track: m, radius of the middle of the
# channel; off: m, beyond that middle; speeds: m/s; tilts of the plate: rad, and their rates; inwards: whether the
# opening leads there; passing: whether the ball was in front of it already; then cosine and sine of angles
INPUTS = (
    "turn", "near", "track", "off", "speed_out", "speed_along", "tilt_out", "tilt_along", "rate_out", "rate_along",
    "inwards", "passing", "cos_1", "sin_1", "cos_2", "sin_2", "cos_4", "sin_4",
)  # fmt: skip
KNOWN = 12
NEAR = 0.15  # rad
COS, SIN = INPUTS.index("cos_1"), INPUTS.index("sin_1")


def policy_inputs(state: State, ring: Ring, opening: Opening, turn: float, passing: bool, plate: Plate) -> Array:
    """INPUTS (18,) for a ball in a channel; state: when the command acts; turn: rad to the opening by the way begun."""
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
    """layers: weights (out, in) and bias (out,) of each; mean, scale (18,): of the inputs; centres (K, KNOWN): scaled
    inputs of the training; reach: scaled distance that counts as 1; limit: rad, tilt that counts as 1; facts: how it
    was trained; source: its folder, None where no file holds it."""

    layers: tuple[tuple[Single, Single], ...]
    mean: Single
    scale: Single
    centres: Single
    reach: float
    limit: float
    facts: dict[str, Any] = field(default_factory=dict)
    source: str | None = None

    @property
    def size(self) -> int:
        """How many numbers the network has."""
        return sum(weights.size + bias.size for weights, bias in self.layers)

    def tilt(self, inputs: Array) -> Array:
        """Tilt out and along, (2,) or (N, 2), rad, without limits, for inputs (18,) or (N, 18)."""
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
        """How far inputs (18,) are from the training data; up to 1 they are known."""
        z = (inputs[:KNOWN] - self.mean[:KNOWN]) / self.scale[:KNOWN]
        gap = self.centres - z
        return math.sqrt(float(np.einsum("ij,ij->i", gap, gap).min())) / self.reach
