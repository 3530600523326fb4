"""What a diagnosis looks for on a ring: effects of the registry, and what the tilt sensor leaves open of the stage."""

from __future__ import annotations

from collections.abc import Iterable

from mazeplan.physics import registry
from mazeplan.physics.effect import BALL, FORCE, Effect, Parameter
from mazeplan.physics.effects.openings import WALLS

STAGE_ERRORS = "stage"  # the pseudo-effect of `stage_errors`
# of the rig, what the ball shows; stage and tilt sensor are held against the model by themselves (`parts`)
BY_THE_BALL = ("tilt_gain", "axis_misalignment", "camera_offset", "sensor_delay")
# named by other means: a draught is a table that is not level unless the maze is turned; a rocking table is what swings
# with time as sin and cos of theta; an unbalanced ball loses its phase with every slip
NOT_SEARCHED = ("constant_force", "table_rocking", "ball_imbalance", "local_friction", *(e.name for e in WALLS))


def ring_library() -> list[Effect]:
    """Everything of the package that can be named on a ring of which no map is known."""
    known = registry.PACKAGED.items()
    return [e for name, e in known if name not in NOT_SEARCHED and (e.acts in BALL or name in BY_THE_BALL)]


def stage_errors(directions: Iterable[str]) -> Effect:
    """What the tilt sensor leaves open of the stage, in standard errors along independent directions. Fitted along
    where values and intervals are reported; never a finding."""
    one = Parameter("1", 0.0, -10.0, 10.0, step=0.1, prior=1.0)
    return Effect(STAGE_ERRORS, dict.fromkeys(directions, one), STAGE_ERRORS, named=False)


def is_smooth(effect: Effect) -> bool:
    """Whether it changes the acceleration without jumps."""
    return effect.acts in (FORCE, "drag", "gravity") or effect.name in ("tilt_gain", "axis_misalignment")
