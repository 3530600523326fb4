"""Rigs with a hidden effect, and balls that are thrown in them, for tests of what a rig may have."""

from __future__ import annotations

import math

import numpy as np
from hidden_effects import hidden_effect

from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.files import validated
from mazeplan.rigs.sim.settings import SimulatedSettings
from mazeplan.rigs.sim.simulated import SimulatedRig

MAZE = load_map("cme")
R, BALL = MAZE.track_radius(1), MAZE.ball.radius
OUTER = MAZE.ring(1).outer_radius - BALL  # where the ball touches the wall
BARE = {"rolling_friction_m": 0.0, "wall_grip": 0.0}


def change_of(kind, seed=0, **settings):
    return hidden_effect(kind, validated(SimulatedSettings, settings), MAZE, seed)


def asked(kind, seed=0, **settings):
    """A rig with a hidden effect, and its true parameters in ring 1 or where it has its place."""
    hidden = change_of(kind, seed, **settings)
    return SimulatedRig(MAZE, {**settings, **hidden.changes}), hidden.parameters


def plain(rig, kind):
    """The same rig without what this kind changed."""
    before = {name: SimulatedSettings.model_fields[name].default for name in change_of(kind).changes}
    return SimulatedRig(MAZE, rig.settings.model_copy(update=before))


def started(rig, theta=0.1, ring=1):
    rig.reset(ring=ring, theta=theta, rng=np.random.default_rng(0))
    rig.observe()
    return rig


def thrown(rig, speed, theta=0.1, at=OUTER, upright=0.0):
    """Put the ball there, rolling along the ring; upright: share of the spin of one that rolls along the wall."""
    c, s = math.cos(theta), math.sin(theta)
    rig.machine.set_ball(
        np.array([at * c, at * s, BALL]), speed * np.array([-s, c, 0.0]), speed / BALL * np.array([-c, -s, -upright])
    )


def rolled(rig, samples, u=(0.0, 0.0)):
    """Angle (unwrapped, rad) and speed along the ring (m/s) at the samples."""
    angle, speed = [], []
    for _ in range(samples + 1):
        x, y, _, vx, vy = rig.truth()[:5]
        r = math.hypot(x, y)
        angle.append(math.atan2(y, x))
        speed.append((x * vy - y * vx) / r)
        rig.command(*u)
        rig.observe()
    return np.unwrap(angle), np.array(speed)


def gained(rig, speed=0.1, samples=6, theta=0.1, u=(0.0, 0.0)):
    """Mean acceleration along ring 1 of a ball that was thrown along it, m/s^2, and its mean speed."""
    thrown(started(rig, theta), speed, theta)
    _, v = rolled(rig, samples, u)
    return (v[-1] - v[0]) * 30.0 / samples, float(np.mean(v))


def gained_by(kind, speed=0.1, seed=0, **where):
    """Acceleration that a hidden effect makes, m/s^2, its mean speed, and its truth."""
    rig, truth = asked(kind, seed, **BARE)
    with_it, at = gained(rig, speed, **where)
    return with_it - gained(plain(rig, kind), speed, **where)[0], at, truth
