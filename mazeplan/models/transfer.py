"""A model that was fitted in one maze, for another: what is physics goes along, what was learned of places does not.

Stage, delays, sensors and the table's tilt are the rig's. Of the ball the factor of its rolling, viscous friction and
drag in m/s^2 at a speed in m/s are those of the ring of the old maze with the nearest radius (of its disc for the
disc); dry friction is a force, so that as an acceleration of theta it goes by 1 / radius, and drag by radius. Bumps of
the floor, losses at openings and the Gaussian processes belong to places that the other maze has not.
"""

from __future__ import annotations

from dataclasses import replace

from mazeplan.maze.geometry import Maze, Ring
from mazeplan.models.modelfile import RigModel
from mazeplan.physics.ball_model import BallModel

ALIKE = 1e-3  # m, of a ring's radii: a map that was measured again


def same_rings(a: Maze, b: Maze) -> bool:
    """Whether two mazes have the same rings, so that a model of one is a model of the other."""
    return len(a.rings) == len(b.rings) and all(
        abs(p.inner_radius - q.inner_radius) < ALIKE and abs(p.outer_radius - q.outer_radius) < ALIKE
        for p, q in zip(a.rings, b.rings, strict=True)
    )


def carried_over(model: RigModel, home: Maze, maze: Maze) -> RigModel:
    """The physics of a model of the maze `home`, for `maze`; the model itself where both have the same rings."""
    if same_rings(home, maze):
        return model
    balls = {}
    for ring in maze.rings:
        if ring.is_disc and len(home.rings) not in model.balls:
            continue  # the old disc had none either: what is nominal there is nominal here
        like = min((r for r in home.rings if r.is_disc == ring.is_disc), key=lambda r: abs(_radius(r) - _radius(ring)))
        ratio = _radius(ring) / _radius(like)
        effects = [
            e.effect(**{k: value * ratio ** powers[k] for k, value in e.values().items()})
            for e in model.ball(like.number).effects
            if (powers := e.effect.by_radius) is not None
        ]
        balls[ring.number] = BallModel(tuple(effects))
    return replace(model, balls=balls, kind="p" if model.kind == "p" else "pi", processes={})


def _radius(ring: Ring) -> float:
    """Where the ball is: on the track, in the disc half way out."""
    return ring.track_radius or 0.5 * ring.outer_radius
