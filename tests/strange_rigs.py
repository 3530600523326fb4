"""Rigs as strangers build them: six named ones, and `StrangeRig` for any mixture. No physics of mazeplan is in them.

`--rig strange_rigs:Stepper`, or `class: strange_rigs:StrangeRig` in a YAML file with settings. The ball is a point with
a factor of gravity, pushed out of walls; servos, tilt sensor and camera are whatever the settings say.
"""

from __future__ import annotations

import math
from collections import deque
from typing import ClassVar

import numpy as np
from numba import njit

from mazeplan import Observation

G = 9.81
H = 1.0 / 1200.0  # s, step of the integrator
SERVOS = ("none", "delay", "first", "second", "rate", "stepper")
USUAL = {
    "rate_hz": 30.0,
    # servo: one of SERVOS
    "servo": "second", "servo_ms": 0.0, "servo_hz": 4.0, "damping": 0.9, "slew_deg_s": 0.0, "step_deg": 0.0,
    "play_beta_deg": 0.0, "play_gamma_deg": 0.0, "gain": 1.0,
    # tilt sensor; measured: False gives None; counted: it sees the servo, in front of the play
    "measured": True, "counted": False, "tilt_noise_deg": 0.0, "tilt_step_deg": 0.0, "tilt_late_ms": 0.0,
    # ball: share of gravity, m/s^2, 1/s, 1/m, heavy side m/s^2
    "share": 5.0 / 7.0, "mu": 0.02, "viscous": 0.1, "drag": 0.0, "heavy": 0.0, "lean_x_deg": 0.0, "lean_y_deg": 0.0,
    # walls; soft: stiffness 1/s^2 instead of impacts, 0: hard
    "rest": 0.2, "wall_mu": 0.0, "soft": 0.0,
    # camera
    "noise_mm": 0.2, "pixel_mm": 0.0, "late_ms": 0.0, "lost": 0.0, "turned_deg": 0.0,
    # changes for a diagnosis; 0: healthy. sticky: m/s^2 in ring 2 from 60 to 120 degrees; push: m/s^2 along x
    "sticky": 0.0, "push": 0.0,
}  # fmt: skip


class StrangeRig:
    """A table with the settings of USUAL."""

    realtime = False
    own: ClassVar[dict] = {}

    def __init__(self, maze, settings):
        self.s = USUAL | self.own | {k: v for k, v in dict(settings).items() if k in USUAL}
        self.maze, self.rate_hz = maze, float(self.s["rate_hz"])
        self.walls, self.gaps = packed(maze)

    def reset(self, *, ring, theta, rng):
        self.rng = rng
        r = self.maze.track_radius(ring)
        self.ball = np.array([r * math.cos(theta), r * math.sin(theta), 0.0, 0.0, rng.uniform(0.0, 6.28)])
        self.servo = np.zeros((2, 3))  # angle, rate, and what the gears pass on
        self.queue, self.u = deque(), (0.0, 0.0)
        self.steps, self.first = 0, True
        self.trail = deque([(*self.ball[:2], 0.0, 0.0)], maxlen=600)

    def observe(self):
        if not self.first:
            for _ in range(round(1.0 / self.rate_hz / H)):
                self._step()
        self.first, s, n = False, self.s, self.rng.normal(size=4)
        x, y = self._past(s["late_ms"])[:2]
        beta, gamma = self._past(s["tilt_late_ms"])[2:]
        turn = math.radians(s["turned_deg"])
        x, y = x * math.cos(turn) - y * math.sin(turn), x * math.sin(turn) + y * math.cos(turn)
        x, y = (rounded(p + 1e-3 * s["noise_mm"] * e, 1e-3 * s["pixel_mm"]) for p, e in ((x, n[0]), (y, n[1])))
        tilts = [
            rounded(a + math.radians(s["tilt_noise_deg"]) * e, math.radians(s["tilt_step_deg"]))
            for a, e in ((beta, n[2]), (gamma, n[3]))
        ]
        if not s["measured"]:
            tilts = [math.nan, math.nan]
        if self.rng.random() < s["lost"] and self.steps:
            x = y = None
        return Observation(self.steps * H, x, y, tilts[0], tilts[1])

    def command(self, u_beta, u_gamma):
        for u in (u_beta, u_gamma):
            if not abs(u) <= self.maze.tilt_limit + 1e-9:
                raise ValueError(f"command {u}")
        late = self.s["servo_ms"] if self.s["servo"] != "none" else 0.0
        self.queue.append((self.steps + round(1e-3 * late / H), (u_beta, u_gamma)))

    def level(self):
        self.command(0.0, 0.0)

    def close(self):
        pass

    def truth(self):
        """Place and velocity of the ball, m and m/s."""
        return tuple(self.ball[:4])

    def _past(self, ms):
        return self.trail[max(len(self.trail) - 1 - round(1e-3 * ms / H), 0)]

    def _step(self):
        s = self.s
        while self.queue and self.queue[0][0] <= self.steps:
            self.u = self.queue.popleft()[1]
        self.steps += 1
        kind, slew = SERVOS.index(s["servo"]), math.radians(s["slew_deg_s"]) or math.inf
        for i, play in ((0, s["play_beta_deg"]), (1, s["play_gamma_deg"])):
            target = s["gain"] * rounded(self.u[i], math.radians(s["step_deg"]))
            turn_servo(
                self.servo[i], target, kind, 2.0 * math.pi * s["servo_hz"], s["damping"], slew, math.radians(play)
            )
        tilt = self.servo[0, 2], self.servo[1, 2]
        lean = math.radians(s["lean_x_deg"]), math.radians(s["lean_y_deg"])
        roll(
            self.ball, tilt[0] + lean[0], tilt[1] + lean[1], s["push"], s["sticky"], s["share"], s["mu"], s["viscous"],
            s["drag"], s["heavy"], s["rest"], s["wall_mu"], s["soft"], self.maze.ball.radius, self.walls, self.gaps,
        )  # fmt: skip
        self.trail.append((self.ball[0], self.ball[1], *(self.servo[:, 0] if s["counted"] else tilt)))


class Stepper(StrangeRig):
    """Stepper motors with play, a rounded tilt, pixels, dead walls."""

    own: ClassVar = {
        "servo": "stepper", "slew_deg_s": 60.0, "step_deg": 0.05, "play_gamma_deg": 0.15, "tilt_step_deg": 0.1,
        "noise_mm": 0.05, "pixel_mm": 0.4, "late_ms": 33.0, "rest": 0.0,
    }  # fmt: skip


class Prompt(StrangeRig):
    """Servos that follow at once; a hollow ball, walls that give most of the speed back; pictures at 60 Hz."""

    own: ClassVar = {
        "rate_hz": 60.0, "servo": "none", "share": 0.6, "rest": 0.6, "noise_mm": 0.3, "late_ms": 25.0, "lost": 0.1,
    }  # fmt: skip


class Late(StrangeRig):
    """Servos that are a pure delay; a ball with a heavy side; walls with friction; a noisy tilt."""

    own: ClassVar = {
        "servo": "delay", "servo_ms": 60.0, "heavy": 0.06, "wall_mu": 0.2, "rest": 0.3, "tilt_noise_deg": 0.05,
        "late_ms": 20.0, "lean_x_deg": 0.4,
    }  # fmt: skip


class Springy(StrangeRig):
    """Slow springy servos, a ball that slides, soft walls, a tilt that is measured late."""

    own: ClassVar = {
        "servo": "second", "servo_hz": 14.0 / 2.0 / math.pi, "damping": 0.35, "share": 1.0, "mu": 0.05,
        "soft": 4e4, "tilt_late_ms": 50.0, "tilt_noise_deg": 0.02, "noise_mm": 0.3,
    }  # fmt: skip


class Blind(StrangeRig):
    """First-order servos whose tilt nobody measures; walls without friction."""

    own: ClassVar = {
        "servo": "first", "servo_hz": 4.0, "measured": False, "noise_mm": 0.3, "late_ms": 30.0, "rest": 0.3,
        "lean_y_deg": -0.3,
    }  # fmt: skip


class Slow(StrangeRig):
    """Pictures at 15 Hz, servos with a limited rate, a tenth of the pictures lost."""

    own: ClassVar = {
        "rate_hz": 15.0, "servo": "rate", "slew_deg_s": 50.0, "servo_hz": 5.0, "lost": 0.1, "noise_mm": 0.4,
        "late_ms": 20.0, "tilt_step_deg": 0.05, "wall_mu": 0.1,
    }  # fmt: skip


SIX = (Stepper, Prompt, Late, Springy, Blind, Slow)


def drawn(seed: int) -> dict:
    """Settings of a strange rig: kinds of servo, ball, walls, tilt sensor and camera, and their numbers."""
    rng = np.random.default_rng([seed, 4711])
    u = rng.uniform
    out = {"servo": str(rng.choice(SERVOS)), "rate_hz": float(rng.choice([15.0, 30.0, 30.0, 60.0]))}
    match out["servo"]:
        case "delay":
            out["servo_ms"] = u(20.0, 90.0)
        case "first":
            out |= {"servo_hz": u(2.5, 8.0), "servo_ms": u(0.0, 20.0)}
        case "second":
            out |= {"servo_hz": u(2.2, 6.0), "damping": u(0.3, 1.2), "servo_ms": u(0.0, 20.0)}
        case "rate":
            out |= {"servo_hz": u(4.0, 8.0), "slew_deg_s": u(40.0, 120.0)}
        case "stepper":
            out |= {"slew_deg_s": u(40.0, 150.0), "step_deg": u(0.02, 0.15)}
            out |= {f"play_{axis}_deg": float(rng.choice([0.0, u(0.05, 0.3)])) for axis in ("beta", "gamma")}
    tilt = str(rng.choice(["exact", "noisy", "rounded", "late", "unmeasured"]))
    out |= {
        "exact": {}, "noisy": {"tilt_noise_deg": u(0.02, 0.1)}, "rounded": {"tilt_step_deg": u(0.02, 0.15)},
        "late": {"tilt_late_ms": u(15.0, 60.0), "tilt_noise_deg": 0.02}, "unmeasured": {"measured": False},
    }[tilt]  # fmt: skip
    out |= {
        "share": float(rng.choice([1.0, 5.0 / 7.0, 5.0 / 7.0, 0.6])),
        "heavy": float(rng.choice([0.0, 0.0, u(0.05, 0.15)])),
        "mu": u(0.0, 0.05), "viscous": u(0.0, 0.3), "lean_x_deg": u(-0.4, 0.4), "lean_y_deg": u(-0.4, 0.4),
    }  # fmt: skip
    walls = str(rng.choice(["frictionless", "elastic", "soft", "rough", "dead"]))
    out |= {
        "frictionless": {"rest": u(0.1, 0.4)}, "elastic": {"rest": u(0.4, 0.65)}, "soft": {"soft": u(2e4, 2e5)},
        "rough": {"wall_mu": u(0.05, 0.3), "rest": u(0.0, 0.4)}, "dead": {"rest": 0.0},
    }[walls]  # fmt: skip
    out |= {
        "noise_mm": u(0.05, 0.5), "pixel_mm": float(rng.choice([0.0, u(0.2, 0.6)])), "late_ms": u(0.0, 70.0),
        "lost": float(rng.choice([0.0, 0.05, 0.1])),
    }  # fmt: skip
    return out


def rounded(value, step):
    return step * round(value / step) if step else value


def packed(maze):
    """Walls (W, 4): inner and outer radius, first and last of its gaps; gaps (G, 3): cos, sin, half width."""
    rows, gaps = [(maze.rings[0].outer_radius, maze.rings[0].outer_radius + 1.0, 0, 0)], []
    for n, (a, b) in enumerate(zip(maze.rings, maze.rings[1:], strict=False), 1):
        openings = maze.openings_between(n, n + 1)
        rows.append((b.outer_radius, a.inner_radius, len(gaps), len(gaps) + len(openings)))
        gaps += [(math.cos(o.angle), math.sin(o.angle), 0.5 * o.width) for o in openings]
    return np.array(rows, dtype=float), np.array(gaps, dtype=float).reshape(-1, 3)


@njit(cache=True)
def turn_servo(axis, target, kind, wn, zeta, slew, play):
    """One step of an axis: angle, rate, and what the gears pass on."""
    if kind <= 1:
        axis[0] = target
    elif kind == 2:
        axis[0] += H * wn * (target - axis[0])
    elif kind == 3:
        axis[1] += H * (wn * wn * (target - axis[0]) - 2.0 * zeta * wn * axis[1])
        axis[0] += H * axis[1]
    elif kind == 4:
        axis[0] += H * min(max(wn * (target - axis[0]), -slew), slew)
    else:
        axis[0] += min(max(target - axis[0], -H * slew), H * slew)
    axis[2] = min(max(axis[2], axis[0] - 0.5 * play), axis[0] + 0.5 * play)


@njit(cache=True)
def roll(ball, beta, gamma, push, sticky, share, mu, viscous, drag, heavy, rest, wall_mu, soft, radius, walls, gaps):
    x, y, vx, vy = ball[0], ball[1], ball[2], ball[3]
    ax, ay = share * G * math.sin(beta) + push, -share * G * math.sin(gamma)
    speed = math.sqrt(vx * vx + vy * vy)
    if heavy > 0.0 and speed > 1e-6:
        ax += heavy * math.cos(ball[4]) * vx / speed
        ay += heavy * math.cos(ball[4]) * vy / speed
    if sticky > 0.0 and 0.0614 < math.sqrt(x * x + y * y) < 0.0765:
        angle = math.degrees(math.atan2(y, x))
        if 60.0 <= angle <= 120.0:
            mu += sticky
    vx += H * (ax - (viscous + drag * speed) * vx)
    vy += H * (ay - (viscous + drag * speed) * vy)
    speed = math.sqrt(vx * vx + vy * vy)
    keep = max(0.0, 1.0 - mu * H / speed) if speed > 0.0 else 0.0
    ball[2], ball[3] = keep * vx, keep * vy
    ball[0], ball[1] = x + H * ball[2], y + H * ball[3]
    ball[4] += H * speed / radius
    r = math.sqrt(ball[0] * ball[0] + ball[1] * ball[1])
    for w in range(len(walls)):
        low, high = walls[w, 0], walls[w, 1]
        if low - radius < r < high + radius:
            meet(ball, r, low, high, int(walls[w, 2]), int(walls[w, 3]), gaps, radius, rest, wall_mu, soft)


@njit(cache=True)
def meet(ball, r, low, high, first, last, gaps, radius, rest, wall_mu, soft):
    x, y = ball[0], ball[1]
    for j in range(first, last):
        c, s, half = gaps[j, 0], gaps[j, 1], gaps[j, 2]
        across, along = c * y - s * x, c * x + s * y
        if along <= 0.0 or abs(across) >= half:
            continue
        near = min(max(along, math.sqrt(low * low - half * half)), math.sqrt(high * high - half * half))
        for side in (half, -half):
            da, dl = c * ball[1] - s * ball[0] - side, c * ball[0] + s * ball[1] - near
            gap = math.sqrt(da * da + dl * dl)
            if gap < radius:
                na, nl = da / gap, dl / gap
                bounce(ball, c * nl - s * na, s * nl + c * na, radius - gap, rest, wall_mu, soft)
        return
    if r > 0.5 * (low + high):
        bounce(ball, x / r, y / r, high + radius - r, rest, wall_mu, soft)
    else:
        bounce(ball, -x / r, -y / r, r - low + radius, rest, wall_mu, soft)


@njit(cache=True)
def bounce(ball, nx, ny, depth, rest, wall_mu, soft):
    """Push the ball along (nx, ny) out of a wall: at once, or by a damped spring."""
    vn = ball[2] * nx + ball[3] * ny
    if soft > 0.0 and depth < 2e-3:
        push = max(H * (soft * depth - 0.6 * math.sqrt(soft) * vn), 0.0)
    else:
        ball[0] += depth * nx
        ball[1] += depth * ny
        if vn >= 0.0:
            return
        push = -(1.0 + (rest if vn < -0.01 else 0.0)) * vn
    ball[2] += push * nx
    ball[3] += push * ny
    if wall_mu > 0.0:
        vt = ball[3] * nx - ball[2] * ny
        off = min(wall_mu * push, abs(vt)) * (1.0 if vt > 0.0 else -1.0)
        ball[2] += off * ny
        ball[3] -= off * nx
