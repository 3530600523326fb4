"""A ball in a ring as it really is, for tests of the diagnosis: written apart from the models, nothing of theirs in it.

A plate with two servos, a ball that rolls in a circle; effects are switched on by name. Everything is integrated with
small steps; what is measured is the camera's x, y and the tilt sensor, with noise."""

from __future__ import annotations

import math

import numpy as np

RATE, FINE = 30.0, 40  # Hz; steps a sample


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
    hum (Hz, size), gate (angle, share of the speed lost), lean (friction that grows with the tilt), gain (2,)."""
    rng = np.random.default_rng(seed)
    n = round(seconds * RATE)
    u = commands(rng, n) if u is None else u
    h, wn, zeta = 1.0 / RATE / FINE, 14.5, 0.82
    get = effects.get
    tilt, rate = u[0].astype(float).copy(), np.zeros(2)
    th, w = float(rng.uniform(-3, 3)), 0.0
    late = round(get("delay", 0.0) * RATE * FINE)
    past, out = [], np.empty((n, 4))
    kicks = process * math.sqrt(h) * rng.standard_normal(n * FINE)
    o, c0 = get("offset", (0.0, 0.0)), get("viscous", 0.35)
    for k in range(n):
        for i in range(FINE):
            time = (k * FINE + i) * h
            past.append(th)
            if i == 0:
                out[k] = past[max(0, len(past) - 1 - late)], 0.0, tilt[0], tilt[1]
            acc = wn * wn * (u[k] - tilt) - 2 * zeta * wn * rate
            b, g, bd, gd = tilt[0], tilt[1], rate[0], rate[1]
            s, c = math.sin(th), math.cos(th)
            a = acc[0] * math.sin(g) + gd * gd * s * c - bd * bd * s * c * math.cos(g) ** 2
            a += 2 * bd * gd * math.cos(g) * s * s
            pull = math.sin(b + o[0]) * s + math.sin(g + o[1]) * math.cos(b + o[0]) * c
            a -= get("factor", 5 / 7) * 9.81 / radius * pull + (c0 + get("drift", 0.0) * time) * w
            a -= get("quadratic", 0.0) * w * abs(w) - get("torque", 0.0) + get("lean", 0.0) * math.hypot(b, g) * w
            if "bump" in effects:
                centre, width, height = effects["bump"]
                e = ((th - centre + math.pi) % (2 * math.pi) - math.pi) / width
                a += height * e * math.exp(0.5 - 0.5 * e * e)
            if "hum" in effects:
                a += effects["hum"][1] * math.sin(2 * math.pi * effects["hum"][0] * time)
            free, most = w + h * a, h * get("dry", 0.0)
            new = 0.0 if abs(free) <= most else free - math.copysign(most, free)
            before, th, w = th, th + 0.5 * h * (w + new), new + kicks[k * FINE + i]
            if "gate" in effects:
                angle, loss = effects["gate"]
                if math.floor((before - angle) / (2 * math.pi)) != math.floor((th - angle) / (2 * math.pi)):
                    w *= 1.0 - loss
            tilt, rate = tilt + h * rate + 0.5 * h * h * acc, rate + h * acc
    theta = out[:, 0] + get("angle", 0.0)
    x = radius * np.cos(theta) + get("camera_offset", (0.0, 0.0))[0] + camera * rng.standard_normal(n)
    y = radius * np.sin(theta) + get("camera_offset", (0.0, 0.0))[1] + camera * rng.standard_normal(n)
    scale = get("gain", (1.0, 1.0))
    return {
        "t": np.arange(n) / RATE, "theta": np.arctan2(y, x), "r": np.hypot(x, y),
        "beta": scale[0] * out[:, 2] + sensor * rng.standard_normal(n),
        "gamma": scale[1] * out[:, 3] + sensor * rng.standard_normal(n), "u_beta": u[:, 0], "u_gamma": u[:, 1],
    }  # fmt: skip
