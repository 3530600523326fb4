"""A ring's parameters from the few numbers that an equation written out in a test has, and those numbers again."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from mazeplan.physics.dynamics.ring_parameters import RingParameters
from mazeplan.physics.effects.ball import dry_friction, rolling_inertia, tilt_offset, viscous_friction

G = 9.81  # m/s^2
PLACES = {
    "rolling_factor": ("rolling_inertia", "factor", 1.0),
    "viscous": ("viscous_friction", "coefficient", 0.0),
    "dry": ("dry_friction", "coefficient", 0.0),
    "offset_beta": ("tilt_offset", "beta", 0.0),
    "offset_gamma": ("tilt_offset", "gamma", 0.0),
}


def ring_of(
    radius: float, *, rolling_factor: float = 5.0 / 9.0, viscous: float = 0.0, dry: float = 0.0,
    offset_beta: float = 0.0, offset_gamma: float = 0.0, **more: Any,
) -> RingParameters:  # fmt: skip
    """Parameters whose effects have these values (1, 1/s, rad/s^2, rad); more: fields of RingParameters."""
    effects = (
        rolling_inertia(rolling_factor),
        viscous_friction(viscous),
        dry_friction(dry),
        tilt_offset(offset_beta, offset_gamma),
    )
    return RingParameters(radius, effects, **more)


def numbers_of(p: RingParameters) -> SimpleNamespace:
    """What `ring_of` was given: by the names of its arguments."""
    known = {term.name: term.values() for term in p.effects}
    assert len(known) == len(p.effects)
    return SimpleNamespace(**{
        name: known.get(effect, {}).get(parameter, default) for name, (effect, parameter, default) in PLACES.items()
    })  # fmt: skip
