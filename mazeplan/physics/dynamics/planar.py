"""Planar motion of the ball on the tilting plate: both coordinates, walls, openings, servo, queued commands.

The ring model (`ring_dynamics`) keeps the ball on a circle. The planar model predicts over the camera delay, so it also
has openings and walls. In the plate frame and in metres, it is:

    a = k (gravity along the plate) + r (force along the ring) e_theta - drag v - R (dry friction) v / |v|

The effects of the ball's ring give these terms (`generate.plane_routine`). Away from walls, k is 5/7 (a rolling solid
sphere). Along a wall, the ball also rolls on the wall; k is then the factor learned for the ring, and friction at the
wall acts. The plate's rotation is left out, because it is small over the delay. After a contact, the ball rebounds with
the share `restitution` of its velocity into the wall.

Compiled functions take two float vectors, so one compilation serves every maze and model:
z = (x, y, x_dot, y_dot, beta, beta_dot, gamma, gamma_dot), shape (8,), and the packed `PlanarModel`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numba import njit

from mazeplan.core.constants import FREE_ROLLING
from mazeplan.core.maths.compiled import CALLEE, KERNEL, pointer_to
from mazeplan.core.records import Array
from mazeplan.maze.geometry import Maze, Ring
from mazeplan.physics.ball_model import BallModel, ball_of, gravity_factor, packed
from mazeplan.physics.formulas.compiled import call_plane, ring_functions
from mazeplan.physics.formulas.symbols import PLATE
from mazeplan.physics.rig.stage import StageModel

SUBSTEP = 1.0 / 300.0  # s; the ball moves at most about 1 mm in it
RESTITUTION = 0.15  # share of the velocity into a wall; steel on printed plastic, slow
ROUNDED = 1e-5  # precision of a factor in a model file
# columns of a wall between two rings: radii; rows of `gaps`, from and up to: its openings, then the radial walls of the
# ring outside it
LOW, HIGH, OPENINGS_FROM, OPENINGS_TO, RADIAL_FROM, RADIAL_TO = range(6)
COS, SIN, HALF = range(3)  # columns of an opening, or of a radial wall: direction, half width
# columns of a ring: radii, factor at a wall, radius of the track, address of `plane`, whether `plane` depends on the
# angle; scratch space; then the parameters of the effects
INNER, OUTER, FACTOR, TRACK, PLANE, ANGLED, PUSH = range(7)
EFFECT_OUTPUTS = PUSH + 7  # outputs of `evaluate_effects`
FORMULA_INPUTS = EFFECT_OUTPUTS + 4  # inputs of formulas
PARAMETERS = FORMULA_INPUTS + len(PLATE)


class PlanarModel(NamedTuple):
    """Arrays for the compiled functions, in the order in which these take them.

    stage:   (2, 6) per axis gain, natural frequency rad/s, damping ratio, offset rad, coupling, largest rate rad/s
    gaps:    (G, 3) per opening, grouped by wall: cos(angle), sin(angle), half width; then per radial wall, grouped by
             ring: cos(angle), sin(angle), half thickness"""

    scalars: Array  # (2,) ball radius, m, and factor of gravity away from walls
    stage: Array
    rings: Array  # (R, C) per ring, outermost first: see the columns above
    walls: Array  # (W, 6) per wall between rings, outermost first: see the columns above
    gaps: Array

    @classmethod
    def build(cls, maze: Maze, stage: StageModel, balls: Mapping[int, BallModel]) -> PlanarModel:
        """The arrays for one maze, the stage in true tilts, and ball models by ring."""
        rows = [_ring_row(ring, maze, balls) for ring in maze.rings]
        width = max(map(len, rows))
        walls, gaps = _wall_rows(maze)
        axes = [
            [axis.gain, *axis.second_order(), axis.offset, axis.coupling, axis.rate_limit]
            for axis in (stage.beta, stage.gamma)
        ]
        return cls(
            scalars=np.array([maze.ball.radius, _free_factor(maze, balls)]),
            stage=np.array(axes, dtype=float),
            rings=np.array([[*row, *[0.0] * (width - len(row))] for row in rows]),
            walls=walls,
            gaps=gaps,
        )


def _wall_rows(maze: Maze) -> tuple[Array, Array]:
    """`walls` and `gaps` of a PlanarModel."""
    walls, gaps = list[list[int | float]](), list[tuple[float, float, float]]()
    for wall in maze.walls[1:]:
        walls.append([wall.inner_radius, wall.outer_radius, len(gaps), len(gaps) + len(wall.openings)])
        gaps += [(math.cos(o.angle), math.sin(o.angle), 0.5 * o.width) for o in wall.openings]
    for row, wall in zip(walls, maze.walls[1:], strict=True):
        across = maze.radial_walls_of(wall.outer_ring)
        row += [len(gaps), len(gaps) + len(across)]
        gaps += [(math.cos(w.angle), math.sin(w.angle), 0.5 * w.thickness) for w in across]
    return np.array(walls, dtype=float).reshape(-1, RADIAL_TO + 1), np.array(gaps, dtype=float).reshape(-1, HALF + 1)


def _ring_row(ring: Ring, maze: Maze, balls: Mapping[int, BallModel]) -> list[float]:
    """The columns of a ring, from the effects of this ring and the common effects of ring 1."""
    shared = [term for term in ball_of(balls, 1).planned if term.effect.common]
    own = [term for term in ball_of(balls, ring.number).planned if not term.effect.common]
    terms = [*own, *shared]
    functions = ring_functions([term.effect for term in terms])
    track = max(ring.track_radius, 0.5 * ring.outer_radius)
    plate = [0.0] * (len(PLATE) - 2) + [track, maze.ball.radius]
    head = [
        ring.inner_radius, ring.outer_radius, gravity_factor(terms), track, functions.address["plane"],
        functions.counts["angled"], *[0.0] * (FORMULA_INPUTS - PUSH), *plate,
    ]  # fmt: skip
    return [*head, *packed(terms)]


def _free_factor(maze: Maze, balls: Mapping[int, BallModel]) -> float:
    """The factor of gravity away from walls: the factor in the model of the central disc, else the nominal value."""
    disc = maze.rings[-1]
    if not disc.is_disc or disc.number not in balls:
        return FREE_ROLLING
    factor = balls[disc.number].parameter("rolling_inertia", "factor", FREE_ROLLING)
    return FREE_ROLLING if abs(factor - FREE_ROLLING) < ROUNDED else factor


@njit(**KERNEL)
def ring_index(r, rings):
    """Index of the ring whose floor, widened to the middle of its walls, holds radius r."""
    for i in range(rings.shape[0] - 1):
        if r > 0.5 * (rings[i, INNER] + rings[i + 1, OUTER]):
            return i
    return rings.shape[0] - 1


@njit(**CALLEE)
def _rebound(z, nx, ny, restitution):
    """Reverse the velocity against the normal (nx, ny), with a share of its size."""
    vn = z[2] * nx + z[3] * ny
    if vn < 0.0:
        z[2] -= (1.0 + restitution) * vn * nx
        z[3] -= (1.0 + restitution) * vn * ny


@njit(**CALLEE)
def _push_out(z, px, py, reach, restitution):
    """Keep the ball's centre at least `reach` from the point (px, py): correct position and velocity."""
    dx, dy = z[0] - px, z[1] - py
    d = math.sqrt(dx * dx + dy * dy)
    if d >= reach or d < 1e-12:
        return False
    nx, ny = dx / d, dy / d
    z[0], z[1] = px + nx * reach, py + ny * reach
    _rebound(z, nx, ny, restitution)
    return True


@njit(**CALLEE)
def _limit_radius(z, limit, outward, restitution):
    """Keep the centre at radius >= limit (outward) or <= limit: correct position and velocity."""
    r = math.sqrt(z[0] * z[0] + z[1] * z[1])
    if r < 1e-12 or (outward and r >= limit) or (not outward and r <= limit):
        return False
    nx, ny = z[0] / r, z[1] / r
    z[0], z[1] = nx * limit, ny * limit
    side = 1.0 if outward else -1.0
    _rebound(z, side * nx, side * ny, restitution)
    return True


@njit(**CALLEE)
def _shift_across(z, c, s, shift, side, restitution):
    """Move the ball by `shift` across the direction (c, s), and reverse its velocity across towards `side`."""
    z[0] -= s * shift
    z[1] += c * shift
    vt = -s * z[2] + c * z[3]
    if vt * side > 0.0:
        z[2] += s * (1.0 + restitution) * vt
        z[3] -= c * (1.0 + restitution) * vt


@njit(**CALLEE)
def _meet_gap(z, gap, low, high, radius, restitution):
    """Resolve contacts inside or in front of a gap (cos, sin, half width) of the wall from radius low to high."""
    c, s, half = gap[COS], gap[SIN], gap[HALF]
    along, across = c * z[0] + s * z[1], -s * z[0] + c * z[1]
    first = math.sqrt(low * low - half * half)
    last = math.sqrt(high * high - half * half)
    if first <= along <= last:
        free = max(half - radius, 0.0)
        if abs(across) <= free:
            return False
        side = 1.0 if across > 0.0 else -1.0
        _shift_across(z, c, s, side * free - across, side, restitution)
        return True
    corner = first if along < first else last
    hit = False
    for side in (-1.0, 1.0):
        px, py = c * corner - s * side * half, s * corner + c * side * half
        hit = _push_out(z, px, py, radius, restitution) or hit
    return hit


@njit(**CALLEE)
def _meet_radial_walls(z, radius, rings, walls, gaps, restitution):
    """Resolve contacts with the flat sides of radial walls in the ball's ring. Inside openings, `_meet_gap` acts."""
    r = math.sqrt(z[0] * z[0] + z[1] * z[1])
    touched = False
    for w in range(walls.shape[0]):
        if r <= rings[w, INNER] or r >= rings[w, OUTER]:
            continue
        for j in range(int(walls[w, RADIAL_FROM]), int(walls[w, RADIAL_TO])):
            c, s, reach = gaps[j, COS], gaps[j, SIN], gaps[j, HALF] + radius
            across = -s * z[0] + c * z[1]
            if abs(across) < reach and c * z[0] + s * z[1] > 0.0:
                side = 1.0 if across > 0.0 else -1.0
                _shift_across(z, c, s, side * reach - across, -side, restitution)
                touched = True
    return touched


@njit(**KERNEL)
def contact(z, radius, rings, walls, gaps, restitution):
    """Resolve contacts with walls (in place); returns whether the ball touches a wall."""
    touched = _limit_radius(z, rings[0, OUTER] - radius, False, restitution)
    touched = _meet_radial_walls(z, radius, rings, walls, gaps, restitution) or touched
    for w in range(walls.shape[0]):
        low, high = walls[w, LOW], walls[w, HIGH]
        r = math.sqrt(z[0] * z[0] + z[1] * z[1])
        if r <= low - radius or r >= high + radius:
            continue
        in_gap = False
        for j in range(int(walls[w, OPENINGS_FROM]), int(walls[w, OPENINGS_TO])):
            c, s, half = gaps[j, COS], gaps[j, SIN], gaps[j, HALF]
            if c * z[0] + s * z[1] > 0.0 and abs(-s * z[0] + c * z[1]) < half:
                touched = _meet_gap(z, gaps[j], low, high, radius, restitution) or touched
                in_gap = True
                break
        if not in_gap:
            outward = r > 0.5 * (low + high)
            touched = _limit_radius(z, high + radius if outward else low - radius, outward, restitution) or touched
    return touched


@njit(**KERNEL)
def stage_step(z, u_beta, u_gamma, stage, h):
    """Advance both axes of the stage (angles z[4] and z[6], rates z[5] and z[7]) by h s with the commands held.

    The damping is semi-implicit, so the step is stable for every damping ratio at the sub-step used here."""
    for i in range(2):
        axis, at = stage[i], 4 + 2 * i
        gain, wn, zeta, offset = axis[0], axis[1], axis[2], axis[3]
        u = u_beta + axis[4] * u_gamma if i == 0 else u_gamma + axis[4] * u_beta
        error = gain * u + offset - z[at]
        rate = (z[at + 1] + h * wn * wn * error) / (1.0 + 2.0 * zeta * wn * h + wn * wn * h * h)
        rate = min(max(rate, -axis[5]), axis[5])
        z[at] += h * rate
        z[at + 1] = rate


@njit(**KERNEL)
def evaluate_effects(z, ring, free, touching):
    """Evaluate the effects in the plane, into columns of `ring`; returns FELT, the first of these columns.

    The columns hold acceleration (2), m/s^2; drag, 1/s; dry friction, m/s^2."""
    r = math.sqrt(z[0] * z[0] + z[1] * z[1])
    speed = math.sqrt(z[2] * z[2] + z[3] * z[3]) / ring[TRACK]
    angle = rate = direction = 0.0
    if ring[ANGLED] != 0.0 and r > 1e-6:
        angle = math.atan2(z[1], z[0])
        rate = (z[0] * z[3] - z[1] * z[2]) / (r * r)
        direction = 1.0 if rate > 0.0 else (-1.0 if rate < 0.0 else 0.0)
    plate, p = pointer_to(ring, FORMULA_INPUTS), pointer_to(ring, PARAMETERS)
    plate[0], plate[3] = z[4], z[6]
    push = pointer_to(ring, PUSH)
    call_plane(np.int64(ring[PLANE]), (angle, rate, speed, direction, 0.0, plate, p, push))
    ax, ay = push[0], push[1]
    if touching and r > 1e-6:
        nx, ny = z[0] / r, z[1] / r
        radial, along = (ax * nx + ay * ny) * free, (-ax * ny + ay * nx) * ring[FACTOR]
        ax, ay = radial * nx - along * ny, radial * ny + along * nx
    else:
        ax, ay = ax * free, ay * free
    if push[2] != 0.0 and r > 1e-6:
        ax, ay = ax - push[2] * z[1], ay + push[2] * z[0]
    ring[EFFECT_OUTPUTS], ring[EFFECT_OUTPUTS + 1], ring[EFFECT_OUTPUTS + 2] = ax, ay, push[3]
    ring[EFFECT_OUTPUTS + 3] = ring[TRACK] * (push[4] + (push[5] if touching else 0.0))
    return EFFECT_OUTPUTS


@njit(**KERNEL)
def ball_step(z, h, scalars, rings, walls, gaps, touching):
    """Advance the ball by h s under the tilt in z; returns whether it then touches a wall."""
    radius, free = scalars[0], scalars[1]
    ring = rings[ring_index(math.sqrt(z[0] * z[0] + z[1] * z[1]), rings)]
    felt = evaluate_effects(z, ring, free, touching)
    vx, vy = z[2] + h * ring[felt], z[3] + h * ring[felt + 1]
    speed = math.sqrt(vx * vx + vy * vy)
    keep = max(0.0, 1.0 - h * ring[felt + 2])
    if speed > 1e-12:
        keep *= max(0.0, 1.0 - h * ring[felt + 3] / speed)
    z[2], z[3] = vx * keep, vy * keep
    z[0] += h * z[2]
    z[1] += h * z[3]
    return contact(z, radius, rings, walls, gaps, RESTITUTION)


@njit(**KERNEL)
def predict(z, t, until, times, commands, scalars, stage, rings, walls, gaps):
    """Advance z (in place) from t to `until`, with commands[i] held from times[i] on (times ascending).

    Shapes: times (N,), commands (N, 2). Before times[0] the first command is held."""
    i = 0
    touching = np.bool_(False)  # a constant would compile what it is passed to once more
    while i + 1 < times.shape[0] and times[i + 1] <= t + 1e-9:
        i += 1
    while t < until - 1e-9:
        h = min(SUBSTEP, until - t)
        if i + 1 < times.shape[0] and times[i + 1] - t < h:
            h = max(times[i + 1] - t, 1e-9)
        stage_step(z, commands[i, 0], commands[i, 1], stage, h)
        touching = ball_step(z, h, scalars, rings, walls, gaps, touching)
        t += h
        if i + 1 < times.shape[0] and times[i + 1] <= t + 1e-9:
            i += 1


@njit(**KERNEL)
def predict_given_tilt(z, t, until, times, tilts, scalars, rings, walls, gaps):
    """Advance the ball in z (in place) from t to `until` under a known tilt history.

    times (N,) ascending, tilts (N, 2); linear between samples, held outside them."""
    n = times.shape[0]
    i = 0
    touching = np.bool_(False)  # a constant would compile what it is passed to once more
    while t < until - 1e-9:
        h = min(SUBSTEP, until - t)
        middle = t + 0.5 * h
        while i + 1 < n and times[i + 1] <= middle:
            i += 1
        if i + 1 < n and middle > times[i]:
            w = (middle - times[i]) / (times[i + 1] - times[i])
            z[4] = (1.0 - w) * tilts[i, 0] + w * tilts[i + 1, 0]
            z[6] = (1.0 - w) * tilts[i, 1] + w * tilts[i + 1, 1]
        else:
            z[4], z[6] = tilts[i, 0], tilts[i, 1]
        touching = ball_step(z, h, scalars, rings, walls, gaps, touching)
        t += h
