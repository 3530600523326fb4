"""A ball in a round maze on a tilting plate, in three dimensions: it rolls, slides, hops, spins, meets walls and edges.

Nothing of mazeplan is in it. The ball has three components of velocity and three of spin, and may leave the floor. In
steps of 1/6000 s gravity and the plate's motion change both, then walls and floor answer with impulses (Coulomb's law
at the point of contact, Newton's restitution), and rolling and spinning friction with impulses of torque. That it
rolls, 5/7 on the floor and 5/9 along a wall, and what an impact does to its spin come out by themselves.

A wall is the part of an annulus outside its openings, whose sides are parallel; its corners there are rounded. The
plate is level at first, and turns about a point in its surface: R = Ry(beta) Rx(gamma), on a table that may lean.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

G = 9.81
RATE, PER = 30.0, 200  # Hz, of samples; steps a sample
H = 1.0 / (RATE * PER)
NEAR = 2e-7  # m; nearer than this is contact: a ball that leans on a wall falls by as much in a step
PASSES = 2  # over the walls in one step: a ball may touch two
# m; inner and outer radius of each wall, width of its openings; then degrees, of their middles
WALLS = (
    (0.07649, 0.08149, 0.0153, (45.0, 135.0, 225.0, 315.0)),
    (0.05634, 0.06134, 0.01485, (0.0, 90.0, 180.0, 270.0)),
    (0.03623, 0.04123, 0.01435, (45.0, 135.0, 225.0, 315.0)),
    (0.01611, 0.02111, 0.0155, (180.0,)),
)
RIM = 0.09689  # m
TRACKS = {1: 0.08919, 2: 0.068915, 3: 0.048785, 4: 0.02867}  # m, middles of the channels


class Body(NamedTuple):
    """The ball and what acts on it, in SI units.

    k: inertia over m R^2; roll, twist: m, of rolling and spinning friction (torque over normal force); floor, wall:
    Coulomb's; land, bounce: restitution of floor and walls; corner: m, radius of the walls' edges;
    viscous 1/s, drift 1/s^2, quadratic 1/m: drag over mass is (viscous + drift t + quadratic |v|) v; swirl: 1/s^2,
    force along the rings over m r; push: m/s^2, force over mass, x and y of the table; warp: 1/m, floor
    z = a (x^2 - y^2) + 2 b x y; magnet: x, y (m), largest pull (m/s^2), and width (m), at which it is largest; patch:
    inner and outer radius (m), first angle and width (rad), rolling friction that is added there (m); eccentric: m from
    the ball's middle to its mass; lean: rad, of the table about both axes; rock: Hz, two amplitudes and phase, rad;
    settle: rad/s, by which the lean grows; pulse: Hz and 1/s^2, a swirl that swings; kick: Hz, m/s^2 along x and y, and
    share of a period that it lasts; churn: m s/rad, rolling friction that comes with how fast the plate tilts."""

    radius: float
    k: float
    roll: float
    twist: float
    floor: float
    land: float
    wall: float
    bounce: float
    corner: float
    viscous: float
    drift: float
    quadratic: float
    swirl: float
    push: tuple[float, float]
    warp: tuple[float, float]
    magnet: tuple[float, float, float, float]
    patch: tuple[float, float, float, float, float]
    eccentric: float
    lean: tuple[float, float]
    rock: tuple[float, float, float, float]
    settle: tuple[float, float]
    pulse: tuple[float, float]
    kick: tuple[float, float, float, float]
    churn: float


class Servo(NamedTuple):
    """One axis: angle'' = frequency^2 (target - angle) - 2 damping frequency angle'; slew: rad/s, the fastest it
    turns; dead_time: s."""

    frequency: float
    damping: float
    slew: float
    dead_time: float


def packed_walls():
    """WALLS as an array (4, 11): inner, outer radius, half width, and cosine and sine of up to four openings."""
    out = np.full((len(WALLS), 11), np.nan)
    for row, (inner, outer, width, angles) in zip(out, WALLS, strict=True):
        row[:3] = inner, outer, 0.5 * width
        for j, angle in enumerate(np.radians(angles)):
            row[3 + 2 * j : 5 + 2 * j] = math.cos(angle), math.sin(angle)
    return out


@njit(cache=True)
def _opening(wall, x, y):
    """Index of the opening of a wall that is nearest by angle."""
    best, most = 0, -2.0
    for j in range(4):
        if wall[3 + 2 * j] * x + wall[4 + 2 * j] * y > most:  # never for NaN
            best, most = j, wall[3 + 2 * j] * x + wall[4 + 2 * j] * y
    return best


@njit(cache=True)
def gap_to(wall, corner, radius, side, x, y):
    """Gap (m; below nought: overlap) between a ball at (x, y) and the part of a wall on one side (-1, 1) of its nearest
    opening, and the normal (2 numbers) from wall to ball. What is opposite to the opening counts to side 1."""
    inner, outer, half = wall[0], wall[1], wall[2]
    r = math.hypot(x, y)
    if r < 1e-6 or r > outer + 2.0 * radius or r < inner - 2.0 * radius:
        return 1.0, 1.0, 0.0
    j = _opening(wall, x, y)
    c, s = wall[3 + 2 * j], wall[4 + 2 * j]
    along, across = c * x + s * y, side * (c * y - s * x)
    centre = half + corner  # of the rounded corners, across
    low, high = inner + corner, outer - corner
    if along < 0.0:
        if side < 0.0:
            return 1.0, 1.0, 0.0
        across = r  # nowhere near the opening
    if r > 0.5 * (inner + outer):
        if across * high >= centre * r:
            return r - outer - radius, x / r, y / r
    elif across * low >= centre * r:
        return inner - r - radius, -x / r, -y / r
    first, last = math.sqrt(low * low - centre * centre), math.sqrt(high * high - centre * centre)
    if first <= along <= last:
        return half - across - radius, side * s, -side * c
    da, db = along - (first if along < first else last), across - centre
    d = math.hypot(da, db) + 1e-15
    da, db = da / d, side * db / d
    return d - corner - radius, c * da - s * db, s * da + c * db


@njit(cache=True)
def _limited(a, b, most):
    """A vector (a, b), no longer than most."""
    size = math.hypot(a, b)
    return (a, b) if size <= most else (a * most / size, b * most / size)


@njit(cache=True)
def _struck(body, gap, nx, ny, p, v, s):
    """Answers of a wall with a normal to a ball that touches it: place, velocity and spin are changed."""
    R = body.radius
    u, deep = -(v[0] * nx + v[1] * ny), -gap
    if u > 0.0:
        press = (1.0 + body.bounce * max(0.0, 1.0 - 0.002 / u)) * u  # slow ones stay
        # slip of the point at -R n, along (-ny, nx, 0) and upwards
        slip = -ny * v[0] + nx * v[1] - R * s[2]
        rise = v[2] - R * (ny * s[0] - nx * s[1])
        share = 1.0 / (1.0 + 1.0 / body.k)
        j, up = _limited(-share * slip, -share * rise, body.wall * press)
        dx, dy = press * nx - j * ny, press * ny + j * nx
        if deep > 0.0:  # it met the wall a little earlier, and has gone on with its new velocity since
            since = min(deep / u, H)
            p[0] += since * dx
            p[1] += since * dy
            deep -= since * press
        v[0] += dx
        v[1] += dy
        v[2] += up
        turn = 1.0 / (body.k * R)
        s[0] -= turn * ny * up
        s[1] += turn * nx * up
        s[2] -= turn * j
    if deep > 0.0:  # no ball stays in a wall
        p[0] += min(deep, 1e-5) * nx
        p[1] += min(deep, 1e-5) * ny


@njit(cache=True)
def _walls(body, walls, p, v, s):
    """Answers of all walls that the ball touches."""
    R = body.radius
    for _ in range(PASSES):
        r = math.hypot(p[0], p[1])
        if RIM - R - r < NEAR:
            _struck(body, RIM - R - r, -p[0] / r, -p[1] / r, p, v, s)
        for i in range(len(walls)):
            if walls[i, 0] - R - NEAR < r < walls[i, 1] + R + NEAR:
                for side in (-1.0, 1.0):
                    gap, nx, ny = gap_to(walls[i], body.corner, R, side, p[0], p[1])
                    if gap < NEAR:
                        _struck(body, gap, nx, ny, p, v, s)


@njit(cache=True)
def _floor(body, roll, p, v, s):
    """The floor's answer to a ball that lies on it, friction against rolling (roll: m) and spinning with it."""
    if p[2] > NEAR or v[2] >= 0.0:
        return
    R, k = body.radius, body.k
    u = -v[2]
    press = (1.0 + body.land * max(0.0, 1.0 - 3.0 * G * H / u)) * u
    v[2] += press
    share = 1.0 / (1.0 + 1.0 / k)
    jx, jy = -share * (v[0] - R * s[1]), -share * (v[1] + R * s[0])
    slides = math.hypot(jx, jy) > body.floor * press
    # what rolling friction has to stop: the spin of a ball that slides, else that about the point of contact
    if slides:
        lx, ly = k * R * s[0], k * R * s[1]
    else:
        lx, ly = k * R * s[0] - v[1], k * R * s[1] + v[0]
    about, turned = math.hypot(lx, ly), k * R * abs(s[2])
    rate = about / (k if slides else 1.0 + k)
    a, b = roll * rate, body.twist * turned / k
    both = math.hypot(a, b) + 1e-300  # one patch, one cone: largest loss
    ends = min(1.0, press * roll * a / both / R / (about + 1e-300)) / (k * R)
    s[0] -= ends * lx
    s[1] -= ends * ly
    s[2] -= min(1.0, press * body.twist * b / both / R / (turned + 1e-300)) * s[2]
    jx, jy = _limited(-share * (v[0] - R * s[1]), -share * (v[1] + R * s[0]), body.floor * press)
    v[0] += jx
    v[1] += jy
    s[0] += jy / (k * R)
    s[1] -= jx / (k * R)


@njit(cache=True)
def _turned(axis, angle, rate, target):
    """Angle, rate and acceleration of an axis a step later."""
    a = axis.frequency**2 * (target - angle) - 2.0 * axis.damping * axis.frequency * rate
    new = min(max(rate + H * a, -axis.slew), axis.slew)
    return angle + H * new, new, (new - rate) / H


@njit(cache=True)
def _pull(body, t, b, c):
    """Gravity and draught in a plate that is tilted by (b, c) on its table, m/s^2, (3 numbers)."""
    swing = math.sin(2.0 * math.pi * body.rock[0] * t + body.rock[3])
    lb = body.lean[0] + body.rock[1] * swing + body.settle[0] * t
    lc = body.lean[1] + body.rock[2] * swing + body.settle[1] * t
    x, y = G * math.sin(lb) + body.push[0], -G * math.cos(lb) * math.sin(lc) + body.push[1]
    often, kx, ky, lasts = body.kick
    if (often * t) % 1.0 < lasts:
        x, y = x + kx, y + ky
    z = -G * math.cos(lb) * math.cos(lc)
    x, z = math.cos(b) * x - math.sin(b) * z, math.sin(b) * x + math.cos(b) * z
    return x, math.cos(c) * y + math.sin(c) * z, math.cos(c) * z - math.sin(c) * y


@njit(cache=True)
def _forces(body, t, p, v):
    """What acts on the ball besides gravity and the plate's motion, over its mass (2 numbers, m/s^2)."""
    drag = body.viscous + body.drift * t + body.quadratic * math.hypot(v[0], v[1])
    swirl = body.swirl + body.pulse[1] * math.sin(2.0 * math.pi * body.pulse[0] * t)
    ax, ay = -drag * v[0] - swirl * p[1], -drag * v[1] + swirl * p[0]
    a, b = body.warp
    ax -= 2.0 * G * (a * p[0] + b * p[1])
    ay -= 2.0 * G * (b * p[0] - a * p[1])
    mx, my, peak, width = body.magnet
    if peak != 0.0:
        dx, dy = (p[0] - mx) / width, (p[1] - my) / width
        pull = peak * math.exp(0.5 - 0.5 * (dx * dx + dy * dy))
        ax -= pull * dx
        ay -= pull * dy
    return ax, ay


@njit(cache=True)
def _rolling(body, p):
    """Rolling friction where the ball is, m."""
    inner, outer, start, width, more = body.patch
    if more == 0.0:
        return body.roll
    inside = inner < math.hypot(p[0], p[1]) < outer and (math.atan2(p[1], p[0]) - start) % (2.0 * math.pi) < width
    return body.roll + (more if inside else 0.0)


@njit(cache=True)
def _cross(a, b):
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@njit(cache=True)
def _unbalanced(body, d, g, s):
    """Spin (changed) of a ball whose mass is off its middle in direction d (changed; it turns with the ball)."""
    torque = _cross(d, g)
    for i in range(3):
        s[i] += H * body.eccentric * torque[i] / (body.k * body.radius**2)
    d += H * _cross(s, d)
    d /= math.sqrt(d[0] ** 2 + d[1] ** 2 + d[2] ** 2)


@njit(cache=True)
def roll(body, beta, gamma, walls, targets, began, start, places, states):
    """A stretch of time: the ball begins at start, (x, y) or (x, y, vx, vy, wx, wy, wz), the plate level and at rest.

    targets (N, 2): rad, what both servos turn to, each for a sample; began: s, time of the first one. Into places
    (N PER, 2): x, y at each step; into states (N, 11): x, y, height over the floor, velocity, spin (rad/s), and both
    tilts at each sample."""
    p, v, s, d = np.zeros(3), np.zeros(3), np.zeros(3), np.array([0.6, 0.0, 0.8])
    p[0], p[1] = start[0], start[1]
    if len(start) > 2:
        v[:2], s[:] = start[2:4], start[4:]
    b = bd = c = cd = 0.0
    late = round(beta.dead_time / H), round(gamma.dead_time / H)
    for i in range(len(places)):
        if i % PER == 0:
            n = i // PER
            states[n, :3], states[n, 3:6], states[n, 6:9] = p, v, s
            states[n, 9], states[n, 10] = b, c
        places[i, 0], places[i, 1] = p[0], p[1]
        t = began + (i + 0.5) * H
        b, bd, bdd = _turned(beta, b, bd, targets[(i - late[0]) // PER, 0] if i >= late[0] else 0.0)
        c, cd, cdd = _turned(gamma, c, cd, targets[(i - late[1]) // PER, 1] if i >= late[1] else 0.0)
        gx, gy, gz = _pull(body, t, b, c)
        sc, cc = math.sin(c), math.cos(c)
        ox, oy, oz = cd, bd * cc, -bd * sc  # how the plate turns, in its own axes, and how that changes
        qx, qy, qz = cdd, bdd * cc - bd * cd * sc, -bdd * sc - bd * cd * cc
        x, y, z = p[0], p[1], p[2] + body.radius
        dot, size = ox * x + oy * y + oz * z, ox * ox + oy * oy + oz * oz
        fx, fy = _forces(body, t, p, v)
        ax = gx + fx - (qy * z - qz * y) - 2.0 * (oy * v[2] - oz * v[1]) - (ox * dot - x * size)
        ay = gy + fy - (qz * x - qx * z) - 2.0 * (oz * v[0] - ox * v[2]) - (oy * dot - y * size)
        az = gz - (qx * y - qy * x) - 2.0 * (ox * v[1] - oy * v[0]) - (oz * dot - z * size)
        s0, s1, s2 = s
        s[0] -= H * (qx + oy * s2 - oz * s1)
        s[1] -= H * (qy + oz * s0 - ox * s2)
        s[2] -= H * (qz + ox * s1 - oy * s0)
        if body.eccentric != 0.0:
            _unbalanced(body, d, np.array([gx, gy, gz]), s)
        v[0] += H * ax
        v[1] += H * ay
        v[2] += H * az
        _walls(body, walls, p, v, s)
        _floor(body, _rolling(body, p) + body.churn * math.sqrt(bd * bd + cd * cd), p, v, s)
        p += H * v
        p[2] = max(p[2], 0.0)
