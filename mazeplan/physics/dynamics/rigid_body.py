"""Rigid-body model of the ball: rolling on the moving floor, contacts with walls, spin about the vertical.

The state (x, y, vx, vy, w) is in the plate's frame, m and m/s. w is the radius R times the spin about the vertical,
relative to the plate. The inertia is k m R^2, and f = 1 / (1 + k). The ball rolls without slip on a plate with angular
velocity O. Its centre is H above the pivot: p = (x, y, H), v = (vx, vy, 0). The equations of Newton and Euler are:

    v' = f (g - O' x p - 2 O x v - O x (O x p) - k (R O'_y - O_z vy - O_x w, -R O'_x - O_y w + O_z vx)) - drag v / |v|
    w' = -R O'_z - O_x vx - O_y vy - c_s (N / m g) b / k
    drag = f (c (N / m g) a + viscous |v| + quadratic |v|^2),      (a, b) = (c |v|, c_s w) / |(c |v|, c_s w)|

with c = g mu_roll / R and c_s = g mu_spin / R. Rolling and spinning share one contact patch. Its friction acts against
both motions together (Contensou). v becomes 0 when the drag of one step would take the whole speed.

A contact with a wall of normal n follows Coulomb's law, with impulses per mass. The ball approaches the wall at the
speed u = -v_n and rebounds at the speed e' u:

    e' = min(e, (e - k + J / u) / (1 + k))

A slow ball keeps rolling and rebounds with e. In a fast impact, the floor holds the rolling motion back only by the
impulse J. The rest of that rotation still turns towards the wall, and takes speed away when the ball rolls again
(momentum of v and rotation before and after).

The normal impulse of the wall is (1 + k) (1 + e') u. The tangential impulse -s / (f + 1 / k) would end the slip
s = v_t - w; it is limited to mu_wall times the normal impulse. v_t changes by f times the tangential impulse, w by
-1 / k times it. These laws give 5/7 of gravity for a solid ball on the floor, 5/9 for one that also rolls on a wall,
and all values between. Rolling friction at the wall then reduces |w| by at most wall_rolling / k times the normal
impulse. It never changes the sign of w.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from mazeplan.core.constants import GRAVITY as G
from mazeplan.core.maths.compiled import CALLEE, KERNEL, pointer_to, shifted
from mazeplan.core.records import Array
from mazeplan.physics.ball_model import packed
from mazeplan.physics.dynamics.plate import BALL_AT, FELT_AT, RADIUS_AT, STATED_AT, TIME_AT
from mazeplan.physics.dynamics.walls import (
    WallCore,
    gap_of,
    into_face,
    into_side,
    into_slab,
    near_wall,
    outside_rim,
    wall_core,
)
from mazeplan.physics.effect import DRAG, DRY, FORCE, GRAVITY, Term
from mazeplan.physics.effects.ball import rolling_inertia
from mazeplan.physics.formulas.compiled import call_moment, call_plane_at, plane_functions

STATE = 5
BESIDES = (GRAVITY, FORCE, DRAG, DRY)  # where further effects may act
PER_GRAVITY = 1.0 / G
TINY = 1e-12  # m^2/s^3; avoids 0 / 0 for a ball at rest
EDGES = 5.0  # weight of hits at the sides of an opening: at an edge, a small offset turns the rebound far
MIDDLE = 1e-3  # m; closer to the middle of the plate, the ball's angle is meaningless


class Ball(NamedTuple):
    """Parameters of the ball.

    height:       of the ball's centre above the pivot, m; NaN stands for the radius: the plate turns about its surface
    """

    inertia: float = 0.4  # k of the inertia k m R^2
    rolling: float = 0.03  # c, m/s^2
    viscous: float = 0.0  # 1/s
    quadratic: float = 0.0  # 1/m
    wall: float = 0.2  # friction coefficient at a wall
    restitution: float = 0.3  # e, share of the speed into a wall with which a slow ball rebounds
    hold: float = 0.02  # J, m/s
    spin: float = 0.02  # c_s, m/s^2
    wall_rolling: float = 0.0  # rolling friction at a wall, mu_roll / R
    height: float = math.nan


class Effects(NamedTuple):
    """Further effects on the ball, see `effects_of`. The caller keeps p alive."""

    address: int  # of the compiled `plane_at` of the effects; 0 without effects
    moment: int  # address of their compiled `moment`; 0 if `moment` has nothing to compute
    held: int  # how many numbers `moment` computes
    p: Array  # packed parameters, then room for these numbers, then FELT_ROOM numbers for the outputs
    angled: bool  # whether the effects depend on the ball's angle


FELT_ROOM = 7  # outputs: gravity along x and y, force, drag, dry friction, friction at a wall, factor of gravity


def effects_of(terms: Sequence[Term] = ()) -> Effects:
    """The sum of some effects of the registry, including those of users, for the compiled step.

    Raises ValueError for an effect that the rigid body has by itself (rolling, walls, openings), and for a formula with
    inputs of a record."""
    for effect in (term.effect for term in terms):
        if effect.acts not in BESIDES or effect.name == rolling_inertia.name:
            allowed = ", ".join(BESIDES)
            raise ValueError(f"got {effect.name}, which a ball with a body has by itself; expected {allowed}")
    terms = [term for term in terms if not term.idle]
    if not terms:
        return Effects(0, 0, 0, np.zeros(FELT_ROOM + 1), False)
    made = plane_functions([term.effect for term in terms])
    held = made.counts["held"]
    room = np.array([*packed(terms), *[0.0] * (held + FELT_ROOM)], dtype=np.float64)
    moment = made.address["moment"] if held else 0
    return Effects(made.address["plane_at"], moment, held, room, bool(made.counts["angled"]))


class BodyCore(NamedTuple):
    """Inputs of a step: the numbers of `Ball`, f, pointers to effects, and walls."""

    inertia: float
    factor: float
    rolling: float
    viscous: float
    quadratic: float
    wall: float
    restitution: float
    hold: float
    spin: float
    spin_gain: float
    wall_turn: float
    height: float
    address: int
    moment: int
    angled: bool
    p: Any
    held: Any
    felt: Any
    walls: WallCore


@njit(**CALLEE)
def body_core(ball, walls, effects):
    """The inputs of a step from `Ball`, `Walls` and `Effects`; the caller keeps these three alive."""
    height = walls.radius if math.isnan(ball.height) else ball.height
    return BodyCore(
        ball.inertia, 1.0 / (1.0 + ball.inertia), ball.rolling, ball.viscous, ball.quadratic, ball.wall,
        ball.restitution, ball.hold, ball.spin, ball.spin / ball.inertia,
        ball.wall_rolling * (1.0 + ball.inertia) / ball.inertia, height, effects.address, effects.moment,
        effects.angled, pointer_to(effects.p, 0), pointer_to(effects.p, len(effects.p) - FELT_ROOM - effects.held),
        pointer_to(effects.p, len(effects.p) - FELT_ROOM), wall_core(walls),
    )  # fmt: skip


@njit(**CALLEE)
def _strike(core, h, depth, nx, ny, x, y, vx, vy, w):
    """Resolve the contact with a wall that the ball overlaps by `depth` m at the end of a step of h s.

    Returns the state after the contact, and by how much (m/s) the wall changed the normal speed. The contact happened
    `late` s before the end of the step. Since then, the ball has moved with its new velocity. So the new state depends
    continuously on the old state, whichever step the contact falls into."""
    vn, vt = vx * nx + vy * ny, vy * nx - vx * ny
    if vn >= 0.0:
        return x + depth * nx, y + depth * ny, vx, vy, w, 0.0
    late = min(depth / -vn, h)
    e = min(core.restitution, (core.restitution - core.inertia - core.hold / vn) * core.factor)
    jump = -(1.0 + e) * vn
    most = core.wall * (1.0 + core.inertia) * jump
    grip = -(vt - w) / (core.factor + 1.0 / core.inertia)
    grip = min(max(grip, -most), most)
    out, along = depth - late * e * vn, late * core.factor * grip
    x, y = x + out * nx - along * ny, y + out * ny + along * nx
    vn, vt, w = vn + jump, vt + core.factor * grip, w - grip / core.inertia
    turned = core.wall_turn * jump
    w = 0.0 if abs(w) <= turned else w - math.copysign(turned, w)
    return x, y, vn * nx - vt * ny, vn * ny + vt * nx, w, jump


@njit(**CALLEE)
def meet_walls(core, h, x, y, vx, vy, w):
    """Resolve the contacts with all walls that the ball overlaps at the end of a step of h s.

    Returns the new state, and the sum of the changes of normal speed, m/s; hits at openings count EDGES times."""
    walls, hit = core.walls, 0.0
    depth, nx, ny = outside_rim(walls, x, y)
    if depth > 0.0:
        x, y, vx, vy, w, jump = _strike(core, h, depth, nx, ny, x, y, vx, vy, w)
        hit += jump
    for b in range(walls.n_slabs):
        depth, nx, ny = into_slab(walls, b, x, y)
        if depth > 0.0:
            x, y, vx, vy, w, jump = _strike(core, h, depth, nx, ny, x, y, vx, vy, w)
            hit += jump
    for i in range(walls.n_walls):
        if not near_wall(walls, i, x, y):
            continue
        j = gap_of(walls, i, x, y)
        for side in range(1 if j < 0 else 2):
            depth, nx, ny = into_face(walls, i, x, y) if j < 0 else into_side(walls, j, 2.0 * side - 1.0, x, y)
            if depth > 0.0:
                x, y, vx, vy, w, jump = _strike(core, h, depth, nx, ny, x, y, vx, vy, w)
                hit += jump if j < 0 else EDGES * jump
    return x, y, vx, vy, w, hit


@njit(**CALLEE)
def _effect_acceleration(core, row, x, y, vx, vy):
    """(ax, ay, drag) of the effects, m/s^2; row: pointer to a row of `plate`.

    The effects are written for a bead on a ring. Their gravity is that of a sliding point, so f times it moves the
    ball. Their forces, drag and friction are in rad/s^2, so the distance from the middle multiplies them."""
    r = math.sqrt(x * x + y * y)
    if r < MIDDLE:
        return 0.0, 0.0, 0.0
    row[RADIUS_AT], row[BALL_AT] = r, core.walls.radius
    rate, speed = (x * vy - y * vx) / (r * r), math.sqrt(vx * vx + vy * vy) / r
    way = 1.0 if rate > 0.0 else (-1.0 if rate < 0.0 else 0.0)
    out, level = core.felt, shifted(row, FELT_AT)
    angle = math.atan2(y, x) if core.angled else 0.0
    call_plane_at(core.address, (angle, rate, speed, way, row[TIME_AT], row, core.p, core.held, out))
    gx, gy = level[0], level[1]  # gravity, with the tilt of the table from `Tilting`
    mx, my = gx + out[0] - row[STATED_AT], gy + out[1] - row[STATED_AT + 1]
    ax, ay = core.factor * (out[6] * mx - gx), core.factor * (out[6] * my - gy)
    return ax - y * out[2], ay + x * out[2], r * (speed * out[3] + max(out[4], 0.0))


@njit(**CALLEE)
def accelerated(core, row, x, y, vx, vy, w):
    """(ax, ay, aw, n): acceleration without friction, and the floor's normal force per mass, m/s^2.

    row: pointer to a row of `plate`."""
    k, radius, height = core.inertia, core.walls.radius, core.height
    felt = shifted(row, FELT_AT)
    ox, oy, oz, qx, qy, qz = felt[3], felt[4], felt[5], felt[6], felt[7], felt[8]
    along, square = ox * x + oy * y + oz * height, ox * ox + oy * oy + oz * oz
    ax = felt[0] - (qy * height - qz * y) + 2.0 * oz * vy - (ox * along - square * x)
    ay = felt[1] - (qz * x - qx * height) - 2.0 * oz * vx - (oy * along - square * y)
    ax -= k * (radius * qy - oz * vy - ox * w)
    ay += k * (radius * qx + oy * w - oz * vx)
    n = -felt[2] + (qx * y - qy * x) + 2.0 * (ox * vy - oy * vx) + oz * along - square * height
    return core.factor * ax, core.factor * ay, -radius * qz - ox * vx - oy * vy, n


@njit(**CALLEE)
def begin_step(core, row):
    """Compute once what the steps of all points with this row share."""
    if core.moment != 0:
        call_moment(core.moment, (row[TIME_AT], row, core.p, core.held))


@njit(**CALLEE)
def step(core, row, h, x, y, vx, vy, w):
    """The state h s later, and the change of speed by walls as in `meet_walls`.

    row: pointer to the row of `plate` for the middle of this step; `begin_step` must have been called with it."""
    ax, ay, aw, n = accelerated(core, row, x, y, vx, vy, w)
    more = 0.0
    if core.address != 0:
        bx, by, more = _effect_acceleration(core, row, x, y, vx, vy)
        ax, ay = ax + bx, ay + by
    ux, uy, w = vx + h * ax, vy + h * ay, w + h * aw
    speed = math.sqrt(ux * ux + uy * uy)
    a, b = core.rolling * speed, core.spin * abs(w)
    press = max(n, 0.0) * PER_GRAVITY / (math.sqrt(a * a + b * b) + TINY)
    floor = core.rolling * press * a + speed * (core.viscous + speed * core.quadratic)
    lost, slower = h * (core.factor * floor + more), h * core.spin_gain * press * b
    keep = 1.0 - lost / speed if speed > lost else 0.0
    ux, uy = ux * keep, uy * keep
    w = 0.0 if abs(w) <= slower else w - math.copysign(slower, w)
    x, y = x + 0.5 * h * (vx + ux), y + 0.5 * h * (vy + uy)
    return meet_walls(core, h, x, y, ux, uy, w)


@njit(**KERNEL)
def advance(ball, walls, effects, rows, h, state, out):
    """Write the states after each of M steps of h s from `state` (5,) into out (M, 5).

    rows (M, ROW): from `plate.plate_rows`."""
    core = body_core(ball, walls, effects)
    x, y, vx, vy, w = state[0], state[1], state[2], state[3], state[4]
    for i in range(len(rows)):
        row = pointer_to(rows, i * rows.shape[1])
        begin_step(core, row)
        x, y, vx, vy, w, _ = step(core, row, h, x, y, vx, vy, w)
        out[i, 0], out[i, 1], out[i, 2], out[i, 3], out[i, 4] = x, y, vx, vy, w
