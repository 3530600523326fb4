"""Parameters of the ball in one ring and of the tilting stage, and their packed vector for compiled functions.

The vector has these parts, in this order:

    head        numbers and addresses
    axes        per axis: its numbers, and its transition matrices after 0, 1/2, 1, 3/2 ... `substeps` integration steps
    parameters  of the effects
    openings    that take speed: per opening, addresses of its functions and its parameters
    scratch     space for intermediate results
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mazeplan.core.constants import GRAVITY, WALL_ROLLING
from mazeplan.core.errors import ModelError
from mazeplan.core.records import Array
from mazeplan.physics.effect import OPENING, Term
from mazeplan.physics.effects.ball import rolling_inertia
from mazeplan.physics.formulas.arrays import BALL_RADIUS, gravity_factor, level_tilt, packed
from mazeplan.physics.formulas.compiled import ring_functions, term_functions
from mazeplan.physics.formulas.symbols import PLATE
from mazeplan.physics.rig.entries import RigNumbers
from mazeplan.physics.rig.stage import second_order_transition

SUBSTEPS = 2
# rad/s, largest pole of an axis. The plate's acceleration pushes the ball and decays with the fastest pole. A node
# represents a sixth of a sub-step, 2.8 ms; a faster decay would count far too much. No measurement shows such a pole.
FASTEST = 150.0

# indices in the head, and in the block of an axis
STEP, SUBSTEP_COUNT, EXTRA, BY_ANGLE, BY_RATE, DRIVE, BETA_0, GAMMA_0, RADIUS, BALL = range(10)
PLATE_AT, VALUE_AT, PLATE_PARTIALS_AT, PARTIALS_AT, EVERY = range(10, 15)  # addresses; number of coefficients of a node
PARAMETERS, OPENINGS, OPENING_COUNT, SCRATCH, PROCESS, AXES = range(15, 21)  # starts of the parts
GAIN, OFFSET, STIFFNESS, DAMPING, COUPLING, TABLE = range(6)
NODE = 4  # the entries of a 2x2 transition matrix in the table
OPENING_SIZE = 3  # addresses of angle and loss, start of the parameters
SLOPES = 8  # of the acceleration and its derivatives, as `partials` gives them
STAGES = 4  # of a Runge-Kutta step


def _positive(name: str, value: float) -> None:
    if not 0.0 < value < math.inf:
        raise ModelError(f"got {value}, expected a number > 0", key=name)


def _finite(name: str, value: float) -> None:
    if not math.isfinite(value):
        raise ModelError(f"got {value}, expected a finite number", key=name)


@dataclass(frozen=True)
class AxisParameters:
    """One axis of the stage, second order.

    gain:              tilt per command
    natural_frequency: rad/s
    damping:           ratio
    offset:            rad
    coupling:          share of the other axis's command
    """

    gain: float = 1.0
    natural_frequency: float = 26.0
    damping: float = 0.9
    offset: float = 0.0
    coupling: float = 0.0

    def __post_init__(self) -> None:
        _positive("stage gain", self.gain)
        _positive("stage natural_frequency", self.natural_frequency)
        _positive("stage damping", self.damping)
        _finite("stage offset", self.offset)
        _finite("stage coupling", self.coupling)


@dataclass(frozen=True)
class RingParameters:
    """All parameters of a step. Raises ModelError for values out of range.

    radius:      radius of the ball's track, m
    effects:     effects on the ball that the planner can use
    beta, gamma: axes of the stage
    dt:          time step, s
    dry_width:   rad/s over which dry friction changes its sign
    physics:     False keeps only the effect of the turning plate, for models that learned the rest
    ball_radius: m
    """

    radius: float
    effects: tuple[Term, ...] = (rolling_inertia(WALL_ROLLING),)
    beta: AxisParameters = AxisParameters()
    gamma: AxisParameters = AxisParameters()
    dt: float = 1.0 / 30.0
    dry_width: float = 0.1
    physics: bool = True
    ball_radius: float = BALL_RADIUS

    def __post_init__(self) -> None:
        for name in ("radius", "dry_width", "dt", "ball_radius"):
            _positive(name, getattr(self, name))
        for term in self.effects:
            if not term.effect.planned:
                raise ModelError(f"cannot be planned with: {term.effect.why_not}", key=term.name)

    @classmethod
    def from_model(cls, model: RigNumbers, ring: int, radius: float) -> RingParameters:
        """Parameters for one ring of a rig's model; radius: m, of the ball's track. A model of kind np has no
        effects, only a Gaussian process."""
        axes = [
            AxisParameters(axis.gain, *axis.careful(FASTEST), axis.offset, axis.coupling)
            for axis in (model.true_stage.beta, model.true_stage.gamma)
        ]
        return cls(
            radius=radius,
            effects=model.ball(ring).planned,
            beta=axes[0],
            gamma=axes[1],
            physics=model.by_effects(ring),
        )

    def pack(self, substeps: int = SUBSTEPS) -> Array:
        """The vector for the compiled functions."""
        terms = self.effects if self.physics else (Term(rolling_inertia, (0.0,)),)
        along = [term for term in terms if term.effect.acts != OPENING]
        functions = ring_functions([term.effect for term in along])
        beta_0, gamma_0 = level_tilt(along)
        head = np.zeros(AXES)
        head[[STEP, SUBSTEP_COUNT, RADIUS, BALL]] = self.dt / substeps, substeps, self.radius, self.ball_radius
        head[[DRIVE, BETA_0, GAMMA_0]] = gravity_factor(along) * GRAVITY / self.radius, beta_0, gamma_0
        names = ("plate", "value", "plate_partials", "partials")
        head[PLATE_AT:EVERY] = [functions.address[name] for name in names]
        head[EVERY] = every = functions.counts["every"]
        parts = [head, *(_pack_axis(axis, self.dt, substeps) for axis in (self.beta, self.gamma))]
        parts.append(np.array(packed(along, self.dry_width)))
        head[PARAMETERS] = sum(map(len, parts[:-1]))
        opening = [term for term in terms if term.effect.acts == OPENING]
        head[OPENINGS], head[OPENING_COUNT] = sum(map(len, parts)), len(opening)
        parts.append(_pack_openings(opening, int(head[OPENINGS])))
        head[SCRATCH] = sum(map(len, parts))
        parts.append(np.zeros(len(PLATE) + STAGES * SLOPES + (2 * substeps + 1) * every))
        head[PROCESS] = sum(map(len, parts))
        return np.concatenate(parts)


def _pack_axis(axis: AxisParameters, dt: float, substeps: int) -> Array:
    wn = axis.natural_frequency
    numbers = [axis.gain, axis.offset, wn * wn, 2.0 * axis.damping * wn, axis.coupling]
    for node in range(2 * substeps + 1):
        numbers.extend(second_order_transition(wn, axis.damping, 0.5 * node * dt / substeps).ravel())
    return np.array(numbers)


def _pack_openings(terms: Iterable[Term], begin: int) -> Array:
    """Rows of openings, then their parameters; begin: index of the first row in the packed vector."""
    terms = list(terms)
    rows, numbers, at = [], [], begin + OPENING_SIZE * len(terms)
    for term in terms:
        functions = term_functions(term.effect)
        rows += [functions.address["angle"], functions.address["loss"], at + len(numbers)]
        numbers += term.numbers
    return np.array([*rows, *numbers], dtype=float)
