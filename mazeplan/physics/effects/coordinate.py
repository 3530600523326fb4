"""Effects on a mechanism with one coordinate, besides suitable effects of the ball.

Units are those of an angle; a system says which unit its position has (`diagnosis.mechanism`). There is no delay among
them: under control the input follows from the position that was measured, so that a term like a delay fits the
controller of one record and not the thing that moves.
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

# What has no name. Nothing of it may look at measured rates: in a free run there are none.
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
