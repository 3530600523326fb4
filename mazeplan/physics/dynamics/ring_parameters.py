"""Parameters of the ball in one ring and of the tilting stage, and their packed vector for compiled functions.

The vector has these parts, in this order:

    head        numbers and addresses
    axes        per axis: its numbers, and its transition matrices after 0, 1/2, 1, 3/2 ... `substeps` integration steps
    parameters  of the effects
    scratch     space for intermediate results
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from mazeplan.core.constants import GRAVITY, WALL_ROLLING
from mazeplan.core.errors import ModelError
from mazeplan.core.records import Array
from mazeplan.physics.ball_model import BALL_RADIUS, gravity_factor, level_tilt, packed
from mazeplan.physics.effect import Term
from mazeplan.physics.effects.ball import rolling_inertia
from mazeplan.physics.formulas.compiled import ring_functions
from mazeplan.physics.formulas.symbols import PLATE
from mazeplan.physics.rig.stage import StageAxis, second_order_transition

SUBSTEPS = 2
# rad/s, largest pole of an axis. The plate's acceleration pushes the ball and decays with the fastest pole. A node
# represents a sixth of a sub-step, 2.8 ms; a faster decay would count far too much. No measurement shows such a pole.
FASTEST = 150.0

# indices in the head, and in the block of an axis
STEP, SUBSTEP_COUNT, EXTRA, BY_ANGLE, BY_RATE, DRIVE, BETA_0, GAMMA_0, RADIUS, BALL = range(10)
PLATE_AT, VALUE_AT, PLATE_PARTIALS_AT, PARTIALS_AT, EVERY = range(10, 15)  # addresses; number of coefficients of a node
PARAMETERS, SCRATCH, PROCESS, AXES = range(15, 19)  # starts of the parts
GAIN, OFFSET, STIFFNESS, DAMPING, COUPLING, TABLE = range(6)
NODE = 4  # the entries of a 2x2 transition matrix in the table
SLOPES = 8  # of the acceleration and its derivatives, as `partials` gives them
STAGES = 4  # of a Runge-Kutta step


@dataclass(frozen=True)
class RingParameters:
    """All parameters of a step. Raises ModelError for values out of range.

    beta, gamma: axes of the stage, of second order; without dead time and what else is not linear"""

    radius: float  # radius of the ball's track, m
    effects: tuple[Term, ...] = (rolling_inertia(WALL_ROLLING),)  # effects on the ball that the planner can use
    beta: StageAxis = field(default_factory=StageAxis)
    gamma: StageAxis = field(default_factory=StageAxis)
    dt: float = 1.0 / 30.0  # time step, s
    dry_width: float = 0.1  # rad/s over which dry friction changes its sign
    physics: bool = True  # False keeps only the effect of the turning plate, for models that learned the rest
    ball_radius: float = BALL_RADIUS  # m

    def __post_init__(self) -> None:
        for name in ("radius", "dry_width", "dt", "ball_radius"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ModelError(f"got {getattr(self, name)}, expected a number > 0", key=name)
        for term in self.effects:
            if not term.effect.planned:
                raise ModelError(f"cannot be planned with: {term.effect.why_not}", key=term.name)

    def pack(self, substeps: int = SUBSTEPS) -> Array:
        """The vector for the compiled functions."""
        terms = self.effects if self.physics else (Term(rolling_inertia, (0.0,)),)
        functions = ring_functions([term.effect for term in terms])
        beta_0, gamma_0 = level_tilt(terms)
        head = np.zeros(AXES)
        head[[STEP, SUBSTEP_COUNT, RADIUS, BALL]] = self.dt / substeps, substeps, self.radius, self.ball_radius
        head[[DRIVE, BETA_0, GAMMA_0]] = gravity_factor(terms) * GRAVITY / self.radius, beta_0, gamma_0
        names = ("plate", "value", "plate_partials", "partials")
        head[PLATE_AT:EVERY] = [functions.address[name] for name in names]
        head[EVERY] = every = functions.counts["every"]
        parts = [head, *(_pack_axis(axis, self.dt, substeps) for axis in (self.beta, self.gamma))]
        parts.append(np.array(packed(terms, self.dry_width)))
        head[PARAMETERS] = sum(map(len, parts[:-1]))
        head[SCRATCH] = sum(map(len, parts))
        parts.append(np.zeros(len(PLATE) + STAGES * SLOPES + (2 * substeps + 1) * every))
        head[PROCESS] = sum(map(len, parts))
        return np.concatenate(parts)


def _pack_axis(axis: StageAxis, dt: float, substeps: int) -> Array:
    wn = axis.natural_frequency
    numbers = [axis.gain, axis.offset, wn * wn, 2.0 * axis.damping * wn, axis.coupling]
    for node in range(2 * substeps + 1):
        numbers.extend(second_order_transition(wn, axis.damping, 0.5 * node * dt / substeps).ravel())
    return np.array(numbers)
