"""Fast planar motion of the ball on the tilting plate: both coordinates, walls, openings, servo, queued commands.

The ring model (`ring_dynamics`) holds the ball on a circle; this one lets it fall through openings and meet walls,
which
is what a prediction over the camera delay needs. Plate frame, metres:

    x_dd =  k g sin(beta + beta_0)                      - c x_dot - d x_dot / |v|
    y_dd = -k g sin(gamma + gamma_0) cos(beta + beta_0) - c y_dot - d y_dot / |v|

k is 5/7 (a solid sphere that rolls) where no wall is touched; along a wall the ball also turns against the wall,
and k is the
factor learned for that ring. What the floor of a ring adds along it (`surface`) comes on top. Contacts are inelastic:
the velocity into the wall is lost but for `restitution`.

Everything compiled works on two float vectors, so that one compilation serves every maze and model:
z = (x, y, x_dot, y_dot, beta, beta_dot, gamma, gamma_dot), shape (8,), and the packed `PlanarModel`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from mazeplan.maze.geometry import Maze
from mazeplan.models import surface
from mazeplan.models.modelfile import RigModel
from mazeplan.models.surface import force
from mazeplan.records import Array

GRAVITY = 9.81  # m/s^2
FREE_ROLLING = 5.0 / 7.0  # solid sphere rolling without slip
SUBSTEP = 1.0 / 300.0  # s; the ball moves at most about 1 mm in it
RESTITUTION = 0.15  # of the velocity into a wall; steel on printed plastic, slow
FLOOR = 5  # where in the numbers of a ring those of its floor begin
OPENINGS_ONLY = 3  # columns of the walls where no radial ones stand in any ring
ROUNDED = 1e-5  # of a factor in a file
STATE_SIZE = 8


@dataclass(frozen=True)
class PlanarModel:
    """Arrays for the compiled functions.

    scalars: (3,) gravity, ball radius m, factor where no wall is touched
    stage:   (2, 4) per axis gain, natural frequency rad/s, damping ratio, offset rad
    bias:    (2,) tilt of the table, beta and gamma, rad
    rings:   (R, 5) per ring, outermost first: inner radius, outer radius, factor at a wall, viscous 1/s, dry m/s^2;
             (R, 5 + surface.SIZE) where the floor of any adds something
    walls:   (W, 3) per wall between rings: inner radius, outer radius, index of its first gap;
             (W, 5) where radial walls stand in any ring: of the ring outside it, the first of their rows and the one
             behind the last
    gaps:    (G, 3) per opening, grouped by wall: cos(angle), sin(angle), half width; behind them radial walls, grouped
             by ring, with half of their thickness
    """

    scalars: Array
    stage: Array
    bias: Array
    rings: Array
    walls: Array
    gaps: Array

    @classmethod
    def build(cls, maze: Maze, model: RigModel) -> PlanarModel:
        """The arrays for one maze and one fitted (or nominal) model."""
        rings, bias = [], np.zeros(2)
        floors = [surface.pack(model.ball(ring.number)) for ring in maze.rings]
        for ring in maze.rings:
            ball = model.ball(ring.number)
            radius = max(ring.track_radius, 0.5 * ring.outer_radius)
            rings.append(
                [
                    ring.inner_radius,
                    ring.outer_radius,
                    ball.parameter("rolling_inertia", "factor", 1.0),
                    ball.parameter("viscous_friction", "coefficient", 0.0),
                    ball.parameter("dry_friction", "coefficient", 0.0) * radius,
                ]
            )
        if any(floor[0] for floor in floors):
            rings = [[*ring, *floor] for ring, floor in zip(rings, floors, strict=True)]
        ball = model.ball(1)
        bias[:] = ball.parameter("tilt_offset", "beta", 0.0), ball.parameter("tilt_offset", "gamma", 0.0)
        walls, gaps = [], []
        for wall in maze.walls[1:]:
            walls.append([wall.inner_radius, wall.outer_radius, float(len(gaps))])
            gaps.extend([math.cos(o.angle), math.sin(o.angle), 0.5 * o.width] for o in wall.openings)
        if maze.radial_walls:
            for row, wall in zip(walls, maze.walls[1:], strict=True):
                across = maze.radial_walls_of(wall.outer_ring)
                row += [float(len(gaps)), float(len(gaps) + len(across))]
                gaps.extend([math.cos(w.angle), math.sin(w.angle), 0.5 * w.thickness] for w in across)
        stage = [
            [axis.gain, axis.natural_frequency, axis.damping, axis.offset]
            for axis in (model.true_stage.beta, model.true_stage.gamma)
        ]
        return cls(
            scalars=np.array([GRAVITY, maze.ball.radius, _free_factor(maze, model)]),
            stage=np.array(stage, dtype=float),
            bias=bias,
            rings=np.array(rings, dtype=float),
            walls=np.array(walls, dtype=float).reshape(len(walls), -1) if walls else np.zeros((0, 3)),
            gaps=np.array(gaps, dtype=float).reshape(-1, 3),
        )

    def arrays(self) -> tuple[Array, Array, Array, Array, Array, Array]:
        """The arguments that the compiled functions take behind the state."""
        return self.scalars, self.stage, self.bias, self.rings, self.walls, self.gaps


def _free_factor(maze: Maze, model: RigModel) -> float:
    """The factor of the gravity part away from walls: what the model says of the disc, where that is not the nominal
    value but for its rounding."""
    disc = maze.rings[-1]
    if not disc.is_disc or disc.number not in model.balls:
        return FREE_ROLLING
    factor = model.ball(disc.number).parameter("rolling_inertia", "factor", FREE_ROLLING)
    return FREE_ROLLING if abs(factor - FREE_ROLLING) < ROUNDED else factor


@njit(cache=True)
def ring_index(r, rings):
    """Index of the ring whose floor, widened to the middle of its walls, holds radius r."""
    for i in range(rings.shape[0] - 1):
        if r > 0.5 * (rings[i, 0] + rings[i + 1, 1]):
            return i
    return rings.shape[0] - 1


@njit(cache=True)
def _push_out(z, px, py, reach, restitution):
    """Keep the ball's centre at least `reach` from the point (px, py): move it, and stop it going inwards."""
    dx, dy = z[0] - px, z[1] - py
    d = math.sqrt(dx * dx + dy * dy)
    if d >= reach or d < 1e-12:
        return False
    nx, ny = dx / d, dy / d
    z[0], z[1] = px + nx * reach, py + ny * reach
    vn = z[2] * nx + z[3] * ny
    if vn < 0.0:
        z[2] -= (1.0 + restitution) * vn * nx
        z[3] -= (1.0 + restitution) * vn * ny
    return True


@njit(cache=True)
def _limit_radius(z, limit, outward, restitution):
    """Keep the centre at radius >= limit (outward) or <= limit: move it, and stop it crossing."""
    r = math.sqrt(z[0] * z[0] + z[1] * z[1])
    if r < 1e-12 or (outward and r >= limit) or (not outward and r <= limit):
        return False
    nx, ny = z[0] / r, z[1] / r
    z[0], z[1] = nx * limit, ny * limit
    vn = z[2] * nx + z[3] * ny
    if (outward and vn < 0.0) or (not outward and vn > 0.0):
        z[2] -= (1.0 + restitution) * vn * nx
        z[3] -= (1.0 + restitution) * vn * ny
    return True


@njit(cache=True)
def _meet_gap(z, gap, low, high, radius, restitution):
    """Contact inside or in front of a gap (cos, sin, half width) of the wall from radius low to high."""
    c, s, half = gap[0], gap[1], gap[2]
    along, across = c * z[0] + s * z[1], -s * z[0] + c * z[1]
    first = math.sqrt(low * low - half * half)
    last = math.sqrt(high * high - half * half)
    if first <= along <= last:
        free = max(half - radius, 0.0)
        if abs(across) <= free:
            return False
        side = 1.0 if across > 0.0 else -1.0
        shift = side * free - across
        z[0] -= s * shift
        z[1] += c * shift
        vt = -s * z[2] + c * z[3]
        if vt * side > 0.0:
            z[2] += s * (1.0 + restitution) * vt
            z[3] -= c * (1.0 + restitution) * vt
        return True
    corner = first if along < first else last
    hit = False
    for side in (-1.0, 1.0):
        px, py = c * corner - s * side * half, s * corner + c * side * half
        hit = _push_out(z, px, py, radius, restitution) or hit
    return hit


@njit(cache=True)
def _meet_radial_walls(z, radius, rings, walls, gaps, restitution):
    """Contact with the flat sides of the radial walls in the ring of the ball; not in its openings, where their own
    sides keep the ball away from them."""
    r = math.sqrt(z[0] * z[0] + z[1] * z[1])
    touched = False
    for w in range(walls.shape[0]):
        if r <= rings[w, 0] or r >= rings[w, 1]:
            continue
        for j in range(int(walls[w, 3]), int(walls[w, 4])):
            c, s, reach = gaps[j, 0], gaps[j, 1], gaps[j, 2] + radius
            across = -s * z[0] + c * z[1]
            if abs(across) >= reach or c * z[0] + s * z[1] <= 0.0:
                continue
            side = 1.0 if across > 0.0 else -1.0
            shift = side * reach - across
            z[0] -= s * shift
            z[1] += c * shift
            vt = -s * z[2] + c * z[3]
            if vt * side < 0.0:
                z[2] += s * (1.0 + restitution) * vt
                z[3] -= c * (1.0 + restitution) * vt
            touched = True
    return touched


@njit(cache=True)
def contact(z, radius, rings, walls, gaps, restitution):
    """Resolve the walls for the ball's centre (in place); whether one is touched."""
    touched = _limit_radius(z, rings[0, 1] - radius, False, restitution)
    radial = walls.shape[1] > OPENINGS_ONLY
    if radial:
        touched = _meet_radial_walls(z, radius, rings, walls, gaps, restitution) or touched
    for w in range(walls.shape[0]):
        low, high = walls[w, 0], walls[w, 1]
        r = math.sqrt(z[0] * z[0] + z[1] * z[1])
        if r <= low - radius or r >= high + radius:
            continue
        first = int(walls[w, 2])
        last = int(walls[w + 1, 2]) if w + 1 < walls.shape[0] else int(walls[0, 3]) if radial else gaps.shape[0]
        in_gap = False
        for j in range(first, last):
            c, s, half = gaps[j, 0], gaps[j, 1], gaps[j, 2]
            if c * z[0] + s * z[1] > 0.0 and abs(-s * z[0] + c * z[1]) < half:
                touched = _meet_gap(z, gaps[j], low, high, radius, restitution) or touched
                in_gap = True
                break
        if not in_gap:
            if r > 0.5 * (low + high):
                touched = _limit_radius(z, high + radius, True, restitution) or touched
            else:
                touched = _limit_radius(z, low - radius, False, restitution) or touched
    return touched


@njit(cache=True)
def stage_step(z, at, u, axis, h):
    """Advance one axis of the stage (angle z[at], rate z[at + 1]) by h with the command u held.

    Semi-implicit in the damping: stable for every damping ratio at the sub-step used here."""
    gain, wn, zeta, offset = axis[0], axis[1], axis[2], axis[3]
    error = gain * u + offset - z[at]
    rate = (z[at + 1] + h * wn * wn * error) / (1.0 + 2.0 * zeta * wn * h + wn * wn * h * h)
    z[at] += h * rate
    z[at + 1] = rate


@njit(cache=True)
def ball_step(z, h, scalars, bias, rings, walls, gaps, touching):
    """Advance the ball by h with the plate's tilt as it stands in z; whether it touches a wall afterwards."""
    g, radius, free = scalars[0], scalars[1], scalars[2]
    r = math.sqrt(z[0] * z[0] + z[1] * z[1])
    ring = rings[ring_index(r, rings)]
    b, c = z[4] + bias[0], z[6] + bias[1]
    ax, ay = g * math.sin(b), -g * math.sin(c) * math.cos(b)
    if touching and r > 1e-6:
        nx, ny = z[0] / r, z[1] / r
        radial, along = ax * nx + ay * ny, -ax * ny + ay * nx
        radial, along = radial * free, along * ring[2]
        ax, ay = radial * nx - along * ny, radial * ny + along * nx
    else:
        ax, ay = ax * free, ay * free
    if ring.shape[0] > FLOOR and ring[FLOOR] != 0.0 and r > 1e-6:
        along = r * force(ring, FLOOR, math.atan2(z[1], z[0]))
        ax, ay = ax - along * z[1] / r, ay + along * z[0] / r
    vx, vy = z[2] + h * ax, z[3] + h * ay
    speed = math.sqrt(vx * vx + vy * vy)
    keep = max(0.0, 1.0 - h * ring[3])
    if speed > 1e-12:
        keep *= max(0.0, 1.0 - h * ring[4] / speed)
    z[2], z[3] = vx * keep, vy * keep
    z[0] += h * z[2]
    z[1] += h * z[3]
    return contact(z, radius, rings, walls, gaps, RESTITUTION)


@njit(cache=True)
def predict(z, t, until, times, commands, scalars, stage, bias, rings, walls, gaps):
    """Advance z (in place) from t to `until`, with commands[i] held from times[i] on (times ascending).

    Shapes: times (N,), commands (N, 2). Before times[0] the first command is held."""
    i = 0
    touching = False
    while i + 1 < times.shape[0] and times[i + 1] <= t + 1e-9:
        i += 1
    while t < until - 1e-9:
        h = min(SUBSTEP, until - t)
        if i + 1 < times.shape[0] and times[i + 1] - t < h:
            h = max(times[i + 1] - t, 1e-9)
        stage_step(z, 4, commands[i, 0], stage[0], h)
        stage_step(z, 6, commands[i, 1], stage[1], h)
        touching = ball_step(z, h, scalars, bias, rings, walls, gaps, touching)
        t += h
        if i + 1 < times.shape[0] and times[i + 1] <= t + 1e-9:
            i += 1


@njit(cache=True)
def predict_given_tilt(z, t, until, times, tilts, scalars, bias, rings, walls, gaps):
    """Advance the ball in z (in place) from t to `until` under a known tilt history.

    times (N,) ascending, tilts (N, 2); linear between samples, held outside them."""
    n = times.shape[0]
    i = 0
    touching = False
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
        touching = ball_step(z, h, scalars, bias, rings, walls, gaps, touching)
        t += h
