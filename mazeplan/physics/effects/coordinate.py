"""Effects on a mechanism with one coordinate: effects of the ball that also apply, and further ones.

Units are written for an angle; a system names the unit of its position (`diagnosis.engine.system`).
"""

from __future__ import annotations

import math

from mazeplan.physics.effect import DRAG, FORCE, INPUT, Effect, Parameter
from mazeplan.physics.effects import ball
from mazeplan.physics.formulas.symbols import size

ANY = (0.0, -math.inf, math.inf)  # value without the effect, bounds

viscous_asymmetry = Effect(
    "viscous_asymmetry", {"coefficient": Parameter("1/s", *ANY)}, FORCE, lambda s, p: -p.coefficient * size(s.velocity),
    text="by how much viscous friction is larger forwards", source="linear friction",
)  # fmt: skip
constant_force = Effect(
    "constant_force", {"force": Parameter("rad/s^2", *ANY)}, FORCE, lambda s, p: p.force, text="a steady force",
    source="Newton",
)  # fmt: skip
elastic_force = Effect(
    "elastic_force", {"stiffness": Parameter("1/s^2", *ANY)}, FORCE, lambda s, p: -p.stiffness * s.position,
    text="a spring", source="Hooke",
)  # fmt: skip
friction_drift = Effect(
    "friction_drift", {"rate": Parameter("1/s^2", *ANY)}, DRAG, lambda s, p: p.rate * s.t,
    text="viscous friction that changes with time", source="linear friction",
)  # fmt: skip
FAMILY = (
    ball.viscous_friction, viscous_asymmetry, ball.dry_friction, ball.quadratic_drag, constant_force, elastic_force,
    friction_drift,
)  # fmt: skip

# Effects of all inputs of a mechanism. A windowed fit drives the model with the measured inputs, so a controller that
# computes them from the measured position does no harm.
input_delay = Effect(
    "input_delay", {"delay": Parameter("s", 0.0, 0.0, 2.0)}, INPUT, text="the inputs act late", source="dead time",
)  # fmt: skip
input_lag = Effect(
    "input_lag", {"time_constant": Parameter("s", 0.0, 0.0, 5.0)}, INPUT,
    text="the inputs act through a first-order lag", source="first-order lag",
)  # fmt: skip
input_gain = Effect(
    "input_gain", {"factor": Parameter("1", 1.0, -100.0, 100.0, smallest=0.005)}, INPUT,
    text="the inputs act stronger or weaker", source="gain",
)  # fmt: skip
INPUTS = (input_delay, input_lag, input_gain)
