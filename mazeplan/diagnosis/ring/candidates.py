"""Candidates for the diagnosis of one ring: effects of the registry, and errors of the fitted stage."""

from __future__ import annotations

from collections.abc import Iterable

from mazeplan.physics import registry
from mazeplan.physics.effect import BALL, Effect, Parameter
from mazeplan.physics.effects.openings import WALLS

STAGE_ERRORS = "stage"  # the pseudo-effect of `stage_errors`
# effects of the rig that the ball shows; `stage.comparison` compares stage and tilt sensor with the model
BY_THE_BALL = ("tilt_gain", "axis_misalignment", "camera_offset", "sensor_delay")
# named by other means: a draught looks like a table that is not level, unless somebody turns the maze; a rocking table
# shows as a force that swings with time, as sin and cos of theta; an unbalanced ball loses its phase with every slip
NOT_SEARCHED = ("constant_force", "table_rocking", "ball_imbalance", "local_friction", *(e.name for e in WALLS))


def ring_library() -> list[Effect]:
    """All packaged effects that a diagnosis can name on a ring without a map."""
    known = registry.PACKAGED.items()
    return [e for name, e in known if name not in NOT_SEARCHED and (e.acts in BALL or name in BY_THE_BALL)]


def stage_errors(directions: Iterable[str]) -> Effect:
    """Errors of the fitted stage, in standard errors along independent directions (`plate_motion.Stage`).

    They are fitted together with the effects where values and intervals are reported. They are never a finding."""
    one = Parameter("1", 0.0, -10.0, 10.0, step=0.1, prior=1.0)
    return Effect(STAGE_ERRORS, dict.fromkeys(directions, one), STAGE_ERRORS, named=False)
