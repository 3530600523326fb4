"""Effects on a mechanism with one coordinate: effects of the ball that also apply, and further ones.

Units are written for an angle; a system names the unit of its position (`diagnosis.mechanism`). A delay is left out:
under control, the input follows from the measured position. A term like a delay would then fit the controller of one
record instead of the mechanism.
"""

from __future__ import annotations

import math

from mazeplan.physics.effect import DRAG, FORCE, Effect, Parameter
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

# Nameless terms. They must not depend on measured rates, because a free run has none.
_ONE = Parameter("", *ANY)
NAMELESS = (
    Effect(
        "powers of the speed", {"p0": _ONE, "p1": _ONE}, FORCE,
        lambda s, p: p.p0 * s.velocity**3 + p.p1 * s.velocity**2, named=False, depends_on=("speed",),
    ),
    Effect(
        "powers of the position", {"p0": _ONE, "p1": _ONE, "p2": _ONE}, FORCE,
        lambda s, p: s.position * (p.p0 + s.position * (p.p1 + s.position * p.p2)), named=False,
        depends_on=("position",),
    ),
)  # fmt: skip
