"""What may happen to a rig of `contactrig`, by the names that mazeplan has for it: how the rig changes, three sizes of
each (small but fair, middle, large), what a diagnosis may call it, and the numbers that it should tell.

Numbers are those after the change, in the units of `mazeplan effect list`. What pulls on a rolling ball moves it by
f = 1 / (1 + k) of what it would move a sliding one; a number in rad/s^2 belongs to a ring and is made for its radius.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from contactplant import TRACKS, G
from contactrig import Rig

DEG = math.pi / 180.0
Truth = Callable[[Rig, float], dict[str, float]]


@dataclass(frozen=True)
class Effect:
    """change: (rig, size) to the rig it becomes; sizes: small, middle, large; truth: (rig after the change, radius of a
    ring in m) to parameters that matter, by name; names: any one of them is right, nothing found is right where there
    are none, but for what is nameless, which has to be called unknown; near: names that are no mistake beside one of
    them, or half a truth alone; also: per name in `names` that is not the effect's own, its parameters; relative:
    numbers are told over those of the healthy rig."""

    change: Callable[[Rig, float], Rig]
    sizes: tuple[float, float, float]
    truth: Truth
    names: tuple[str, ...]
    near: tuple[str, ...] = ()
    also: dict[str, Truth] = field(default_factory=dict)
    nameless: bool = False
    relative: bool = False


def _nothing(rig, r):
    return {}


def _f(rig):
    return 1.0 / (1.0 + rig.k)


def _seen(**numbers):
    """A change of the camera: per field, a function of (camera, size)."""
    return lambda rig, size: replace(
        rig, camera=replace(rig.camera, **{name: of(rig.camera, size) for name, of in numbers.items()})
    )


def _servos(beta, gamma=None):
    """A change of the servos: per axis, the fields as functions of (axis, size)."""

    def change(rig, size):
        axes = {}
        for name, numbers in (("beta", beta), ("gamma", beta if gamma is None else gamma)):
            axis = getattr(rig, name)
            axes[name] = replace(axis, **{key: of(axis, size) for key, of in numbers.items()})
        return replace(rig, **axes)

    return change


def _of_axes(key, told="{}"):
    """Truth: a field of both axes, under the names told."""
    return lambda rig, r: {told.format(name): getattr(getattr(rig, name), key) for name in ("beta", "gamma")}


def _dry(rig, r):
    return {"coefficient": _f(rig) * G * rig.roll / rig.radius / r}


def _viscous(rig, r):
    return {"coefficient": _f(rig) * rig.viscous}


def _tilt(rig, r):
    """Lean of the table, and what a draught does on a level one."""
    return {"beta": rig.lean[0] + rig.push[0] / G, "gamma": rig.lean[1] - rig.push[1] / G}


def _draught(rig, r):
    return {"x": rig.push[0], "y": rig.push[1]}


def _warp(rig, r):
    a, b = rig.warp
    return {"cos2": -2.0 * _f(rig) * G * b, "sin2": 2.0 * _f(rig) * G * a}


def _bump(rig, r):
    x, y, peak, width = rig.magnet
    aside = (math.hypot(x, y) - r) / width
    height = -_f(rig) * peak * math.exp(-0.5 * aside * aside) / r
    return {"centre": math.atan2(y, x), "width": width / r, "height": height}


def _rocking(rig, r):
    frequency, beta, gamma, phase = rig.rock
    return {"frequency": frequency, "beta": beta, "gamma": gamma, "phase": phase}


def _patch(rig, r):
    inner, outer, start, width, more = rig.patch
    ring = next(n for n, track in TRACKS.items() if inner < track < outer)
    coefficient = _f(rig) * G * more / rig.radius / TRACKS[ring]
    return {"ring": ring, "start": start, "end": start + width, "coefficient": coefficient}


def _uneven(rig, r):
    return {"amplitude": _f(rig) * G * rig.eccentric / rig.radius / r}


def _couplings(rig, r):
    return {"beta_from_gamma": rig.beta.coupling, "gamma_from_beta": rig.gamma.coupling}


def _lags(rig, r):
    return _of_axes("frequency", "{}_natural_frequency")(rig, r)


def _scales(rig, r):
    return {"beta": rig.sensor[0], "gamma": rig.sensor[1]}


def _gains(rig, r):
    """Of tilts as they are measured."""
    return {"beta": rig.beta.gain * rig.sensor[0], "gamma": rig.gamma.gain * rig.sensor[1]}


EFFECTS = {
    "dry_friction": Effect(lambda rig, s: replace(rig, roll=rig.roll * s), (2.0, 3.0, 5.0), _dry, ("dry_friction",)),
    "viscous_friction": Effect(
        lambda rig, s: replace(rig, viscous=rig.viscous + s), (0.25, 0.5, 0.9), _viscous, ("viscous_friction",)
    ),
    "quadratic_drag": Effect(
        lambda rig, s: replace(rig, quadratic=rig.quadratic + s), (2.5, 5.0, 8.0),
        lambda rig, r: {"coefficient": _f(rig) * rig.quadratic * r}, ("quadratic_drag",), ("viscous_friction",),
    ),
    "rolling_inertia": Effect(
        lambda rig, s: replace(rig, k=s), (0.5, 2.0 / 3.0, 0.85), lambda rig, r: {"factor": _f(rig)},
        ("rolling_inertia",),
    ),
    "wall_friction": Effect(
        lambda rig, s: replace(rig, wall=rig.wall * s), (1.5, 2.0, 3.0), lambda rig, r: {"coefficient": rig.wall},
        ("wall_friction",),
    ),
    "tilt_offset": Effect(
        lambda rig, s: replace(rig, lean=(rig.lean[0] + 0.8 * s * DEG, rig.lean[1] - 0.6 * s * DEG)), (0.25, 0.5, 0.8),
        _tilt, ("tilt_offset", "constant_force"),
    ),
    "constant_force": Effect(
        lambda rig, s: replace(rig, push=(0.6 * s, 0.8 * s)), (0.04, 0.08, 0.13), _draught,
        ("constant_force", "tilt_offset"), (), {"tilt_offset": _tilt},
    ),
    "constant_torque": Effect(
        lambda rig, s: replace(rig, swirl=s), (0.4, 0.8, 1.3), lambda rig, r: {"acceleration": _f(rig) * rig.swirl},
        ("constant_torque",),
    ),
    "surface_profile": Effect(  # s: mm at 100 mm from the middle
        lambda rig, s: replace(rig, warp=(0.1 * s * math.cos(40 * DEG), 0.1 * s * math.sin(40 * DEG))),
        (0.3, 0.6, 1.0), _warp, ("surface_profile",),
    ),
    "surface_bump": Effect(
        lambda rig, s: replace(rig, magnet=(-0.0446, 0.0772, s, 0.015)), (0.13, 0.25, 0.4), _bump, ("surface_bump",)
    ),
    "friction_drift": Effect(
        lambda rig, s: replace(rig, drift=s), (1e-3, 2e-3, 4e-3), lambda rig, r: {"rate": _f(rig) * rig.drift},
        ("friction_drift",), ("viscous_friction",),
    ),
    "local_friction": Effect(  # s: times the rolling friction, but of a usual floor
        lambda rig, s: replace(rig, patch=(0.06134, 0.07649, 20 * DEG, 80 * DEG, 4e-5 * s)), (3.0, 6.0, 10.0), _patch,
        ("local_friction",), ("dry_friction",),
    ),
    "ball_imbalance": Effect(
        lambda rig, s: replace(rig, eccentric=s), (3e-5, 6e-5, 1e-4), _uneven, ("ball_imbalance",)
    ),
    "table_rocking": Effect(
        lambda rig, s: replace(rig, rock=(0.7, 0.8 * s * DEG, 0.6 * s * DEG, 0.5)), (0.2, 0.4, 0.65), _rocking,
        ("table_rocking",),
    ),
    "tilt_gain": Effect(
        lambda rig, s: replace(rig, sensor=(rig.sensor[0] * s, rig.sensor[1])), (1.04, 1.08, 1.13), _scales,
        ("tilt_gain",), ("servo_gain",), relative=True,
    ),
    "axis_misalignment": Effect(
        _seen(angle=lambda c, s: c.angle + s * DEG), (1.5, 3.0, 5.0), lambda rig, r: {"angle": rig.camera.angle},
        ("axis_misalignment",),
    ),
    "camera_offset": Effect(
        _seen(offset=lambda c, s: (c.offset[0] + 0.8 * s, c.offset[1] - 0.6 * s)), (1.5e-3, 3e-3, 4.8e-3),
        lambda rig, r: {"x": rig.camera.offset[0], "y": rig.camera.offset[1]}, ("camera_offset",),
    ),
    "camera_scale": Effect(
        _seen(scale=lambda c, s: c.scale * s), (1.0125, 1.025, 1.04), lambda rig, r: {"factor": rig.camera.scale},
        ("camera_scale",),
    ),
    "lens_distortion": Effect(
        _seen(k=lambda c, s: s), (-2.0, -4.0, -6.5), lambda rig, r: {"k": rig.camera.k}, ("lens_distortion",),
        ("camera_scale",),
    ),
    "sensor_delay": Effect(
        _seen(delay=lambda c, s: c.delay + s), (0.03, 0.06, 0.095), lambda rig, r: {"delay": rig.camera.delay},
        ("sensor_delay",),
    ),
    "command_delay": Effect(
        _servos({"dead_time": lambda a, s: a.dead_time + s}), (0.02, 0.04, 0.065),
        lambda rig, r: {"delay": rig.beta.dead_time}, ("command_delay",), ("servo_lag",),
    ),
    "deadband": Effect(
        _servos({"deadband": lambda a, s: s * DEG}), (0.3, 0.6, 1.0), _of_axes("deadband"), ("deadband",), ("backlash",)
    ),
    "backlash": Effect(
        _servos({"play": lambda a, s: a.play + s * DEG}), (0.25, 0.5, 0.8), _of_axes("play"), ("backlash",)
    ),
    "servo_gain": Effect(
        _servos({"gain": lambda a, s: a.gain * s}, {}), (0.935, 0.87, 0.79), _gains, ("servo_gain",), ("tilt_gain",),
    ),
    "servo_lag": Effect(
        _servos({"frequency": lambda a, s: a.frequency * s}), (0.8, 0.62, 0.45), _lags, ("servo_lag",)
    ),
    "axis_coupling": Effect(
        _servos({"coupling": lambda a, s: a.coupling + s}), (0.035, 0.07, 0.11), _couplings, ("axis_coupling",)
    ),
    # what mazeplan has no name for
    "pulse": Effect(
        lambda rig, s: replace(rig, pulse=(1.7, s)), (1.0, 2.0, 4.0), _nothing, (), nameless=True
    ),
    "kicks": Effect(  # a push along x, for a tenth of each period
        lambda rig, s: replace(rig, kick=(0.9, s, 0.0, 0.1)), (0.3, 0.6, 1.0), _nothing, (), nameless=True
    ),
    "settling": Effect(  # s: degrees in 300 s
        lambda rig, s: replace(rig, settle=(s * DEG / 300.0, 0.0)), (0.3, 0.6, 1.0), _nothing, (), ("tilt_offset",),
        nameless=True,
    ),
    "churning": Effect(  # s: times the rolling friction at 0.2 rad/s
        lambda rig, s: replace(rig, churn=5.0 * s * rig.roll), (2.0, 4.0, 8.0), _nothing, (), ("dry_friction",),
        nameless=True,
    ),
    "lost_pictures": Effect(_seen(lost=lambda c, s: s), (0.05, 0.15, 0.3), _nothing, ()),
    "camera_noise": Effect(_seen(noise=lambda c, s: c.noise * s), (1.3, 1.7, 2.2), _nothing, ()),
}  # fmt: skip


def changed(rig, name, size=1):
    """A rig behind an effect of a size (0: small, 1: middle, 2: large)."""
    effect = EFFECTS[name]
    return effect.change(rig, effect.sizes[size])


def truth(rig, name, told, radius, healthy):
    """Parameters that a finding called `told` should have on a changed rig, in a ring of a radius, m; none where that
    name stands for something else. healthy: the rig before."""
    effect = EFFECTS[name]
    if told != name:
        return effect.also[told](rig, radius) if told in effect.also else {}
    numbers = effect.truth(rig, radius)
    if effect.relative:
        return {key: value / effect.truth(healthy, radius)[key] for key, value in numbers.items()}
    return numbers
