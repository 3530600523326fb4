"""What may differ about a rig: effects of the registry as numbers of a ball with a body, and terms without a name."""

from __future__ import annotations

from dataclasses import dataclass

from mazeplan.estimation.bodyfilter import BodyModel
from mazeplan.estimation.bodynumbers import value_of
from mazeplan.physics.effect import Effect


@dataclass(frozen=True)
class Candidate:
    """effect: name in the registry, "" for what has none; free: numbers that it changes; first: those that are fitted
    before the others, without which these say nothing; words, depends_on: for what has no name in the registry;
    far: steps of the first number that are tried beside the parabola at the reference, which a large change leaves;
    along: numbers that change with it, and are no finding of their own: another ball meets walls in another way;
    simpler: effects that are tried before it is believed."""

    effect: str
    free: tuple[str, ...]
    first: tuple[str, ...] = ()
    words: str = ""
    depends_on: tuple[str, ...] = ()
    far: tuple[float, ...] = ()
    along: tuple[str, ...] = ()
    simpler: tuple[str, ...] = ()

    @property
    def fitted(self) -> tuple[str, ...]:
        """Numbers that are fitted with it."""
        return (*self.free, *self.along)

    def told(self, model: BodyModel) -> str:
        """Its words, with the frequency where it swings."""
        at = [value_of(model, name) for name in self.free if name.endswith(".frequency")]
        return f"{self.words} at {at[0]:.3f} Hz" if at else self.words


def of_effect(effect: Effect) -> Candidate:
    """A candidate of a user's own effect: all its parameters, first those that say how large it is."""
    every = tuple(f"{effect.name}.{key}" for key, p in effect.parameters.items() if not p.fixed)
    sizes = tuple(name for name in every if name.partition(".")[2] not in effect.places)
    return Candidate(effect.name, every, sizes if sizes != every else ())


CONTACT = "contact"  # that on which a change depends which is no finding beside one that has a name
FRICTIONS = ("dry_friction", "viscous_friction", "quadratic_drag")
CANDIDATES = (
    Candidate("dry_friction", ("rolling",), far=(-0.02, 0.03, 0.1)),
    Candidate("viscous_friction", ("viscous",), far=(0.1, 0.3)),
    Candidate("quadratic_drag", ("quadratic",), far=(1.0, 3.0)),
    Candidate("rolling_inertia", ("inertia",), far=(-0.15, 0.15, 0.27), along=("restitution", "hold", "spin")),
    Candidate("wall_friction", ("wall",), far=(-0.2, -0.1, 0.2)),
    Candidate("tilt_offset", ("tilt_beta", "tilt_gamma")),
    Candidate("tilt_gain", ("gain_beta", "gain_gamma")),
    Candidate("camera_offset", ("offset_x", "offset_y")),
    Candidate("axis_misalignment", ("angle",), far=(-0.05, 0.05)),
    Candidate("camera_scale", ("scale",)),
    Candidate("sensor_delay", ("delay",), far=(-0.06, -0.03, 0.03, 0.06)),
    Candidate("lens_distortion", ("bend",), far=(-5.0, -2.0, 2.0, 5.0)),
    Candidate("constant_torque", ("ring_push.force", "ring_push.turn")),
    Candidate("friction_drift", ("drag_drift.rate", "drag_drift.start"), ("drag_drift.rate",), simpler=FRICTIONS),
    Candidate("surface_profile", ("floor_warp.a", "floor_warp.b", "floor_warp.c")),
    Candidate(
        "surface_bump", ("floor_bump.depth", "floor_bump.x", "floor_bump.y", "floor_bump.width"), ("floor_bump.depth",)
    ),
    Candidate(
        "local_friction", ("floor_dirt.coefficient", "floor_dirt.centre", "floor_dirt.half"),
        ("floor_dirt.coefficient",), simpler=FRICTIONS,
    ),
    Candidate("gate_loss", ("floor_kerb.size", "floor_kerb.centre"), ("floor_kerb.size",)),
    Candidate("surface_ripple", ("floor_ripple.c", "floor_ripple.s")),
    Candidate(
        "table_rocking",
        ("table_swing.bs", "table_swing.bc", "table_swing.gs", "table_swing.gc", "table_swing.frequency"),
        ("table_swing.bs", "table_swing.bc", "table_swing.gs", "table_swing.gc"),
    ),
    Candidate(
        "", ("swing_along.s", "swing_along.c", "swing_along.frequency"), ("swing_along.s", "swing_along.c"),
        "a force along the rings swings", ("time",),
    ),
    Candidate("", ("lean_drift.beta", "lean_drift.gamma"), (), "the table leans more and more", ("time",)),
    Candidate(
        "", ("moving_friction.coefficient",), (), "the ball is held back while the plate moves", ("tilt rate",),
        simpler=FRICTIONS,
    ),
    Candidate("", ("restitution", "hold"), (), "walls throw the ball back differently", (CONTACT,)),
    Candidate("", ("spin",), (), "the ball spins against another friction", (CONTACT,)),
    Candidate(
        "", ("cross_beta", "cross_gamma"), (), "the plate tilts about other axes than it is measured in", ("tilt",)
    ),
)  # fmt: skip
