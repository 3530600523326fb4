"""A ball in a ring as it really is, for tests of the diagnosis: written apart from the models, nothing of theirs in it.

A plate with two servos, a ball that rolls in a circle; effects are switched on by name. Everything is integrated by the
midpoint rule in steps of 0.8 ms; what is measured is the camera's x, y and the tilt sensor, with noise."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

RATE, FINE = 30.0, 40  # Hz; steps a sample
STEP = 1.0 / RATE / FINE
SERVO, DAMPING = 14.5, 0.82
SETTINGS = {  # what is in the plant without any effect
    "dry": 0.0, "viscous": 0.35, "quadratic": 0.0, "offset": (0.0, 0.0), "factor": 5 / 7, "torque": 0.0, "drift": 0.0,
    "bump": (0.0, 1.0, 0.0), "hum": (0.0, 0.0), "gate": (0.0, 0.0), "lean": 0.0, "wave": (0.0, 0.0, 0.0, 0.0),
    "memory": (0.0, 1.0), "cross": (0.0, 0.0),
    "wall": 0.0, "gates": (0.0, 0.0, 0.0),
}  # fmt: skip
STARTS = dict(zip(SETTINGS, np.cumsum([0] + [np.size(v) for v in SETTINGS.values()]).tolist(), strict=False))
VISCOUS, QUADRATIC, OFFSET, FACTOR, TORQUE = (STARTS[n] for n in ("viscous", "quadratic", "offset", "factor", "torque"))
DRIFT, BUMP, HUM, GATE, LEAN = (STARTS[name] for name in ("drift", "bump", "hum", "gate", "lean"))
WAVE, MEMORY, CROSS = (STARTS[name] for name in ("wave", "memory", "cross"))
WALL, GATES = STARTS["wall"], STARTS["gates"]


def commands(rng, n, amplitude=0.06):
    """Sums of sines (n, 2)."""
    t = np.arange(n) / RATE
    u = np.zeros((n, 2))
    for axis in range(2):
        for _ in range(12):
            u[:, axis] += rng.normal() * np.sin(2 * math.pi * rng.uniform(0.05, 1.2) * t + rng.uniform(0, 2 * math.pi))
    return np.clip(amplitude * u / np.abs(u).max(axis=0) * 1.6, -0.087, 0.087)


def play(seed=0, seconds=120.0, radius=0.0925, camera=3e-4, sensor=8e-4, process=0.0, u=None, **effects):
    """Columns t, theta, r, beta, gamma, u_beta, u_gamma of a record. effects by name: dry, viscous, quadratic, offset
    (2,), factor, torque, delay (s), angle (of the camera), camera_offset (2,), drift, bump (centre, width, height),
    wave (cos and sin of theta, of 2 theta), gate (angle, share of the speed lost), gain (2,), wall (friction
    coefficient at the walls), gates (side 1 outer or -1 inner, angle of the first of four, share of the speed lost
    by a ball that lies against that wall); and, which no library has: hum (Hz, size), lean (friction that grows with
    the tilt), memory (pull of the speed's past, s), cross (speed times beta, times gamma)."""
    rng = np.random.default_rng(seed)
    n = round(seconds * RATE)
    u = commands(rng, n) if u is None else np.asarray(u, dtype=float)
    seen = {name: effects.pop(name, default) for name, default in SEEN.items()}
    assert set(effects) <= set(SETTINGS), effects
    numbers = np.concatenate([np.atleast_1d(effects.get(k, v)).astype(float) for k, v in SETTINGS.items()])
    start = float(rng.uniform(-3, 3))
    kicks = process * math.sqrt(STEP) * rng.standard_normal(n * FINE)
    late = round(seen["delay"] * RATE * FINE)
    theta, tilt = _run(u, numbers, radius, start, kicks, late)
    theta = theta + seen["angle"]
    x = radius * np.cos(theta) + seen["camera_offset"][0] + camera * rng.standard_normal(n)
    y = radius * np.sin(theta) + seen["camera_offset"][1] + camera * rng.standard_normal(n)
    return {
        "t": np.arange(n) / RATE, "theta": np.arctan2(y, x), "r": np.hypot(x, y),
        "beta": seen["gain"][0] * tilt[:, 0] + sensor * rng.standard_normal(n),
        "gamma": seen["gain"][1] * tilt[:, 1] + sensor * rng.standard_normal(n), "u_beta": u[:, 0], "u_gamma": u[:, 1],
    }  # fmt: skip


SEEN = {"delay": 0.0, "angle": 0.0, "camera_offset": (0.0, 0.0), "gain": (1.0, 1.0)}


@njit(cache=True)
def _pull(th, w, past, time, b, g, bd, gd, bdd, radius, s):
    """Acceleration of the ball, dry friction apart."""
    sin, cos = math.sin(th), math.cos(th)
    a = bdd * math.sin(g) + gd * gd * sin * cos - bd * bd * sin * cos * math.cos(g) ** 2
    a += 2 * bd * gd * math.cos(g) * sin * sin
    level = b + s[OFFSET]
    a -= s[FACTOR] * 9.81 / radius * (math.sin(level) * sin + math.sin(g + s[OFFSET + 1]) * math.cos(level) * cos)
    a -= (s[VISCOUS] + s[DRIFT] * time) * w + s[QUADRATIC] * w * abs(w) - s[TORQUE] + s[LEAN] * math.hypot(b, g) * w
    e = ((th - s[BUMP] + math.pi) % (2 * math.pi) - math.pi) / s[BUMP + 1]
    a += s[BUMP + 2] * e * math.exp(0.5 - 0.5 * e * e) + s[HUM + 1] * math.sin(2 * math.pi * s[HUM] * time)
    a += s[WAVE] * cos + s[WAVE + 1] * sin + s[WAVE + 2] * math.cos(2 * th) + s[WAVE + 3] * math.sin(2 * th)
    return a - s[MEMORY] * past + w * (s[CROSS] * b + s[CROSS + 1] * g)


@njit(cache=True)
def _run(u, s, radius, th, kicks, late):
    """Angle (n,) of the ball as seen, tilts (n, 2)."""
    n, w, past, h = len(u), 0.0, 0.0, STEP
    b, g, bd, gd = u[0, 0], u[0, 1], 0.0, 0.0
    ring, tilt, angles = np.full(late + 1, th), np.empty((n, 2)), np.empty(n)
    stiff, soft, count = SERVO * SERVO, 2 * DAMPING * SERVO, 0
    for k in range(n):
        for i in range(FINE):
            time = (k * FINE + i) * h
            ring[count % (late + 1)] = th
            if i == 0:
                angles[k] = ring[(count + 1) % (late + 1)]
                tilt[k, 0], tilt[k, 1] = b, g
            count += 1
            bdd, gdd = stiff * (u[k, 0] - b) - soft * bd, stiff * (u[k, 1] - g) - soft * gd
            a = _pull(th, w, past, time, b, g, bd, gd, bdd, radius, s)
            bm, gm, bdm, gdm = b + 0.5 * h * bd, g + 0.5 * h * gd, bd + 0.5 * h * bdd, gd + 0.5 * h * gdd
            bddm, gddm = stiff * (u[k, 0] - bm) - soft * bdm, stiff * (u[k, 1] - gm) - soft * gdm
            middle = (th + 0.5 * h * w, w + 0.5 * h * a, past + 0.5 * h * (w - past) / s[MEMORY + 1])
            a = _pull(*middle, time + 0.5 * h, bm, gm, bdm, gdm, bddm, radius, s)
            past += h * (w - past) / s[MEMORY + 1]
            press = w * w + 9.81 / radius * 5 / 9 * (math.sin(b) * math.cos(th) - math.sin(g) * math.sin(th))
            free, most = w + h * a, h * (s[0] + s[WALL] * abs(press))
            new = 0.0 if abs(free) <= most else free - math.copysign(most, free)
            before, th, w = th, th + 0.5 * h * (w + new), new + kicks[k * FINE + i]
            turn = 2 * math.pi
            if s[GATE + 1] > 0.0 and math.floor((before - s[GATE]) / turn) != math.floor((th - s[GATE]) / turn):
                w *= 1.0 - s[GATE + 1]
            if s[GATES] * press > 0.0:
                quarter, at = 0.5 * math.pi, s[GATES + 1]
                if math.floor((before - at) / quarter) != math.floor((th - at) / quarter):
                    w *= 1.0 - s[GATES + 2]
            b, g, bd, gd = b + h * bdm, g + h * gdm, bd + h * bddm, gd + h * gddm
    return angles, tilt
