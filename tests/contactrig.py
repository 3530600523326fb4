"""A whole rig around `contactplant`: servos, tilt sensor and camera, and records of it as `collect --rings` makes them.

`drawn_rig` draws a healthy one; `record` gives columns at 30 Hz. Nothing of mazeplan is in it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from contactplant import PER, RATE, TRACKS, Body, H, Servo, packed_walls, roll

SINES, FASTEST, CREST, TILT = 50, 1.5, 2.5, math.radians(5.0)  # -, Hz, -, rad: of the commands
STRETCH = 20.0  # s in a ring, before the ball is placed in the next


@dataclass(frozen=True)
class Axis:
    """A servo. gain: tilt per command; frequency rad/s; damping; dead_time s; slew rad/s; play rad, of its gears, which
    follow as late as they can; deadband rad, change of a command below which it stays; coupling: share of the other
    axis's command that it takes."""

    gain: float = 1.0
    frequency: float = 22.0
    damping: float = 0.9
    dead_time: float = 0.01
    slew: float = 4.0
    play: float = 0.0
    deadband: float = 0.0
    coupling: float = 0.0

    def passed_on(self, u):
        """What of its commands (N,) reaches the plate, beginning with a level one."""
        out, servo, plate = np.empty(len(u)), 0.0, 0.0
        for i, value in enumerate(u):
            servo = value if abs(value - servo) >= self.deadband else servo
            plate = min(max(plate, servo - 0.5 * self.play), servo + 0.5 * self.play)
            out[i] = plate
        return out


@dataclass(frozen=True)
class Camera:
    """Seen: lens(scale Rot(angle) true + offset), `delay` s late, with noise (m, one sigma); the lens draws p to
    p (1 + k |p|^2), k in 1/m^2. lost: share of the pictures without a ball; a lost one is followed by another one with
    probability `runs`."""

    offset: tuple[float, float] = (0.0, 0.0)
    angle: float = 0.0
    scale: float = 1.0
    k: float = 0.0
    delay: float = 0.06
    noise: float = 5e-4
    lost: float = 0.0
    runs: float = 0.3

    def seen(self, x, y):
        """Where a ball at x, y is seen, without delay and noise."""
        c, s = self.scale * math.cos(self.angle), self.scale * math.sin(self.angle)
        x, y = c * x - s * y + self.offset[0], s * x + c * y + self.offset[1]
        over = 1.0 + self.k * (x * x + y * y)
        return x * over, y * over


@dataclass(frozen=True)
class Rig:
    """Everything that a rig is. Lengths in m, angles in rad; names as in `contactplant.Body`.

    sensor: scales of the tilt sensor; sensor_noise: rad. What lies around (swirl, push, warp, magnet, patch, rock,
    settle, pulse, kick, churn) is nothing on a healthy rig."""

    radius: float = 6.35e-3
    k: float = 0.4
    roll: float = 4e-5
    twist: float = 2e-5
    floor: float = 0.4
    land: float = 0.1
    wall: float = 0.22
    bounce: float = 0.3
    corner: float = 1e-3
    viscous: float = 0.0
    drift: float = 0.0
    quadratic: float = 0.0
    swirl: float = 0.0
    push: tuple[float, float] = (0.0, 0.0)
    warp: tuple[float, float] = (0.0, 0.0)
    magnet: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.015)
    patch: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    eccentric: float = 0.0
    lean: tuple[float, float] = (0.0, 0.0)
    rock: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    settle: tuple[float, float] = (0.0, 0.0)
    pulse: tuple[float, float] = (0.0, 0.0)
    kick: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    churn: float = 0.0
    beta: Axis = Axis()
    gamma: Axis = Axis()
    sensor: tuple[float, float] = (1.0, 1.0)
    sensor_noise: float = 1e-3
    camera: Camera = Camera()

    def body(self):
        """As `contactplant` takes it."""
        return Body(*(getattr(self, name) for name in Body._fields))

    def targets(self, u):
        """What both servos turn to (N, 2) under commands (N, 2)."""
        reach = [axis.passed_on(u[:, i]) for i, axis in enumerate((self.beta, self.gamma))]
        rows = ((self.beta, *reach), (self.gamma, *reach[::-1]))
        return np.column_stack([axis.gain * (own + axis.coupling * other) for axis, own, other in rows])


def drawn_rig(rng):
    """A healthy rig."""

    def between(low, high):
        return float(rng.uniform(low, high))

    def axis():
        return Axis(
            gain=between(0.97, 1.03), frequency=between(16.0, 28.0), damping=between(0.7, 1.05), slew=between(3.0, 7.0),
            play=between(0.0, 1e-3), coupling=between(-0.01, 0.01),
        )  # fmt: skip

    beta, gamma, late, most = axis(), axis(), between(0.0, 0.02), math.radians(0.4)
    camera = Camera(
        offset=(between(-1e-3, 1e-3), between(-1e-3, 1e-3)), angle=between(-0.01, 0.01), scale=between(0.995, 1.005),
        delay=between(0.03, 0.11), noise=between(3e-4, 1e-3),
    )  # fmt: skip
    return Rig(
        roll=math.exp(between(math.log(1e-5), math.log(8e-5))), twist=between(1e-5, 5e-5), floor=between(0.25, 0.6),
        land=between(0.0, 0.3), wall=between(0.1, 0.35), bounce=between(0.1, 0.6), corner=between(2e-4, 1.5e-3),
        viscous=between(0.0, 0.05), lean=(between(-most, most), between(-most, most)),
        beta=replace(beta, dead_time=late), gamma=replace(gamma, dead_time=late),
        sensor=(between(0.98, 1.02), between(0.98, 1.02)), sensor_noise=between(5e-4, 1.5e-3), camera=camera,
    )  # fmt: skip


def sines(rng, n, tilt=TILT):
    """Commands (n, 2), rad: sums of sines, cut at tilt."""
    t, out = np.arange(n) / RATE, np.empty((n, 2))
    for i in range(2):
        f, phase = rng.uniform(0.0, FASTEST, SINES), rng.uniform(0.0, 2.0 * math.pi, SINES)
        wave = np.sin(2.0 * math.pi * np.outer(t, f) + phase).sum(axis=1) / math.sqrt(0.5 * SINES)
        out[:, i] = tilt * np.clip(wave / CREST, -1.0, 1.0)
    return out


def rolled(rig, u, start, began=0.0):
    """Places (N PER, 2) at each step and states (N, 11) at each sample under commands u (N, 2); see `contactplant`."""
    places, states = np.empty((len(u) * PER, 2)), np.empty((len(u), 11))
    servos = [Servo(axis.frequency, axis.damping, axis.slew, axis.dead_time) for axis in (rig.beta, rig.gamma)]
    walls, targets = packed_walls(), np.ascontiguousarray(rig.targets(u))
    roll(rig.body(), *servos, walls, targets, float(began), np.array(start, dtype=float), places, states)
    return places, states


def _lost(rng, n, camera):
    """Which of n pictures show no ball."""
    out, before = np.zeros(n, dtype=bool), False
    begins = camera.lost * (1.0 - camera.runs) / max(1.0 - camera.lost, 1e-9)
    for i, chance in enumerate(rng.random(n)):
        out[i] = before = bool(chance < (camera.runs if before else begins))
    return out


def record(rig, seconds, seed, rings=(1, 2, 3, 4), tilt=TILT):
    """Columns t, x, y (NaN: not seen), beta, gamma, u_beta, u_gamma, segment (N,) of a rig under random sines; every
    20 s the ball is placed in the next of the rings, at rest, and the plate is level."""
    rng = np.random.default_rng(seed)
    n, stretch = round(seconds * RATE), round(STRETCH * RATE)
    u, columns = sines(rng, n, tilt), np.empty((n, 4))
    for number, first in enumerate(range(0, n, stretch)):
        rows = slice(first, min(first + stretch, n))
        ring, angle = TRACKS[rings[number % len(rings)]], float(rng.uniform(-math.pi, math.pi))
        begins = (ring * math.cos(angle), ring * math.sin(angle))
        places, states = rolled(rig, u[rows], begins, first / RATE)
        at = np.arange(len(states)) * PER - rig.camera.delay / H  # steps, at which a picture was taken
        shown = [np.interp(at, np.arange(len(places)), places[:, i]) for i in (0, 1)]
        columns[rows, :2] = np.column_stack(rig.camera.seen(*shown))
        columns[rows, 2:] = states[:, 9:] * rig.sensor
    columns[:, :2] += rig.camera.noise * rng.standard_normal((n, 2))
    columns[:, 2:] += rig.sensor_noise * rng.standard_normal((n, 2))
    columns[_lost(rng, n, rig.camera), :2] = np.nan
    names = ("x", "y", "beta", "gamma")
    return {
        "t": np.arange(n) / RATE, **dict(zip(names, columns.T.copy(), strict=True)),
        "u_beta": u[:, 0].copy(), "u_gamma": u[:, 1].copy(), "segment": (np.arange(n) // stretch).astype(float),
    }  # fmt: skip
