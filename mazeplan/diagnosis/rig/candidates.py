"""What may differ about a rig: effects of the registry as numbers of a rigid ball, and terms without a name."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mazeplan.physics.effect import Effect


@dataclass(frozen=True)
class Candidate:
    """One thing that may differ."""

    effect: str  # name in the registry, "" if it has none; then `words` describe it
    free: tuple[str, ...]  # numbers that it changes
    fitted_first: tuple[str, ...] = ()  # those that are fitted before the others
    words: str = ""
    depends_on: tuple[str, ...] = ()
    # changes of the first numbers at which fits may start: a large change leaves the parabola at the reference
    far: tuple[tuple[float, ...], ...] = ()
    # numbers that change with it and are no findings: another ball meets walls in another way
    along: tuple[str, ...] = ()
    simpler: tuple[str, ...] = ()  # effects that are tried as well before this candidate is accepted
    after: str = ""  # effect that has to be found first
    instead: tuple[str, ...] = ()  # effects that are not reported beside this candidate: it is their cause
    look: str = ""  # where to look

    @property
    def fitted(self) -> tuple[str, ...]:
        """Numbers that are fitted with it."""
        return (*self.free, *self.along)

    @property
    def sizes(self) -> tuple[str, ...]:
        """Its numbers without places and frequencies, which mean nothing for an effect that is not there."""
        return self.fitted_first or self.free


def of_effect(effect: Effect) -> Candidate:
    """The candidate of a user's effect: all its parameters. Sizes are fitted before places."""
    every = tuple(f"{effect.name}.{key}" for key, p in effect.parameters.items() if not p.fixed)
    sizes = tuple(name for name in every if name.partition(".")[2] not in effect.places)
    return Candidate(effect.name, every, sizes if sizes != every else ())


CONTACT = "contact"  # a candidate that depends on contact is not looked for beside another finding
LEANS = ("tilt_offset",)
FRICTIONS = ("dry_friction", "viscous_friction", "quadratic_drag")
# rad, in eight directions: in records of navigation, a few pictures of balls at edges spoil the parabola
LEANS_AT = tuple(
    (size * math.cos(way * math.pi / 4.0), size * math.sin(way * math.pi / 4.0)) for size in (0.006, 0.015)
    for way in range(8)
)  # fmt: skip
GAINS_AT = tuple((beta, gamma) for beta in (-0.15, 0.0, 0.15) for gamma in (-0.15, 0.0, 0.15) if beta or gamma)
CANDIDATES = (
    Candidate("dry_friction", ("rolling",), far=((-0.02,), (0.03,), (0.1,))),
    Candidate("viscous_friction", ("viscous",), far=((0.1,), (0.3,))),
    Candidate("quadratic_drag", ("quadratic",), far=((1.0,), (3.0,))),
    Candidate("rolling_inertia", ("inertia",), far=((-0.15,), (0.15,), (0.27,)), along=("restitution", "hold", "spin")),
    Candidate("wall_friction", ("wall",), far=((-0.2,), (-0.1,), (0.2,))),
    Candidate("wall_friction", ("wall_rolling",), far=((0.02,), (0.05,))),
    Candidate("tilt_offset", ("tilt_beta", "tilt_gamma"), far=LEANS_AT),
    Candidate("tilt_gain", ("gain_beta", "gain_gamma"), far=GAINS_AT),
    Candidate("camera_offset", ("offset_x", "offset_y")),
    Candidate("axis_misalignment", ("angle",), far=((-0.05,), (0.05,))),
    Candidate("camera_scale", ("scale",), far=((-0.04,), (-0.02,), (0.02,), (0.04,))),
    Candidate("sensor_delay", ("delay",), far=((-0.06,), (-0.03,), (0.03,), (0.06,))),
    Candidate("lens_distortion", ("bend",), far=((-5.0,), (-2.0,), (2.0,), (5.0,))),
    Candidate("constant_torque", ("ring_push.force", "ring_push.turn"), simpler=LEANS),
    Candidate("friction_drift", ("drag_drift.rate", "drag_drift.start"), ("drag_drift.rate",), simpler=FRICTIONS),
    Candidate("surface_profile", ("floor_warp.a", "floor_warp.b", "floor_warp.c"), simpler=LEANS),
    Candidate(
        "surface_bump", ("floor_bump.depth", "floor_bump.x", "floor_bump.y", "floor_bump.width"), ("floor_bump.depth",),
        simpler=LEANS,
    ),
    Candidate(
        "local_friction", ("floor_dirt.coefficient", "floor_dirt.start", "floor_dirt.end"),
        ("floor_dirt.coefficient",), simpler=FRICTIONS,
    ),
    Candidate("gate_loss", ("floor_kerb.size", "floor_kerb.centre"), ("floor_kerb.size",)),
    Candidate("surface_ripple", ("floor_ripple.c", "floor_ripple.s"), simpler=LEANS),
    Candidate(
        "table_rocking",
        ("table_swing.bs", "table_swing.bc", "table_swing.gs", "table_swing.gc", "table_swing.frequency"),
        ("table_swing.bs", "table_swing.bc", "table_swing.gs", "table_swing.gc"),
    ),
    Candidate(
        "", ("table_beat.bs", "table_beat.bc", "table_beat.gs", "table_beat.gc"), (),
        "something pushes again and again", ("time",), after="table_rocking",
        instead=("table_rocking", "tilt_offset", "constant_force"), look="Look for what bumps the table that often",
    ),
    Candidate(
        "", ("swing_along.s", "swing_along.c", "swing_along.frequency"), ("swing_along.s", "swing_along.c"),
        "a force along the rings swings", ("time",), look="Look for what drives the ball around that often, like a fan",
    ),
    Candidate(
        "", ("lean_drift.beta", "lean_drift.gamma"), (), "the table leans more and more", ("time",),
        look="Look at the feet of the table, and whether the tilt sensor drifts",
    ),
    Candidate(
        "", ("moving_friction.coefficient",), (), "the ball is held back while the plate moves", ("tilt rate",),
        simpler=FRICTIONS, look="Look for what holds the ball back while the plate moves, like static charge",
    ),
    Candidate(
        "", ("restitution", "hold"), (), "walls return another share of the speed of the ball", (CONTACT,),
        ((-0.3,), (-0.15,), (0.15,), (0.3,)), look="Look whether the walls are clean and fixed",
    ),
    Candidate(
        "", ("spin",), (), "the ball spins against another friction", (CONTACT,),
        look="Look whether ball and floor are clean",
    ),
    Candidate(
        "", ("cross_beta", "cross_gamma"), (), "the axes of the tilt sensor are not those of the plate", ("tilt",),
        look="Check that the tilt sensor sits straight on the plate",
    ),
)  # fmt: skip
