"""A drive axis as it really is, for tests of the diagnosis: written apart from the models, nothing of theirs in it.

A mass under the force of a motor, with friction, follows a reference under position and speed control at 1 kHz; effects
are switched on by name. Recorded are the encoder's position and the control voltage, as in the public benchmark:
that of a sample is the mean of the voltages held before and behind it, so that the record is not shifted in time."""

from __future__ import annotations

import math

import numpy as np

DT, FINE, COUNT = 1e-3, 10, 5e-8  # s; steps a sample; m, one count of the encoder
GAIN, KP, KV = 35.0, 160.0, 240.0  # N/V, 1/s, V s/m


def reference(rng, n, stroke=0.25, fastest=0.14, ramp=1.5):
    """Positions (n,) of trips between random places, trapezoids of speed with a ramp in m/s^2."""
    q, v, goal, most = 0.0, 0.0, 0.0, fastest
    out = np.empty(n)
    for k in range(n):
        if abs(goal - q) < 1e-4 and abs(v) < 2 * ramp * DT:
            v, goal, most = 0.0, float(rng.uniform(0.0, stroke)), float(rng.uniform(0.25, 1.0)) * fastest
        wish = math.copysign(min(most, math.sqrt(2.0 * ramp * abs(goal - q))), goal - q)
        v += float(np.clip(wish - v, -ramp * DT, ramp * DT))
        q += v * DT
        out[k] = q
    return out


def play(seed=0, seconds=20.0, process=0.3, **effects):
    """Variables t, qm, qg, vir (n, 1), gtau, kp, kv of a record. process: N sqrt(s), white force that nobody measures.
    effects by name: mass (kg), viscous (N s/m), lopsided (more of it forwards, less backwards), dry (N), offset (N,
    against the motion forwards), quadratic (N s^2/m^2), stiffness (N/m), drift (N/m), hum (Hz, N)."""
    rng = np.random.default_rng(seed)
    n, h, get = round(seconds / DT), DT / FINE, effects.get
    goal = reference(rng, n)
    wish = np.gradient(goal, DT)
    mass, q, v, seen, before = get("mass", 95.0), 0.0, 0.0, 0.0, 0.0
    frequency, size = get("hum", (0.0, 0.0))
    kicks = process / math.sqrt(h) * rng.standard_normal(n * FINE)
    qm, vir = np.empty(n), np.empty(n)
    for k in range(n):
        qm[k] = seen = COUNT * round(q / COUNT)
        rate, before = (seen - before) / DT if k else 0.0, seen
        vir[k] = KV * (KP * (goal[k] - seen) + 0.7 * wish[k] - 0.7 * rate) / 3.0
        for i in range(FINE):
            time = (k * FINE + i) * h
            c = get("viscous", 200.0) + get("drift", 0.0) * time
            force = (
                GAIN * vir[k]
                - c * v
                - get("lopsided", 0.0) * abs(v)
                - get("quadratic", 0.0) * v * abs(v)
                - get("stiffness", 0.0) * q
            )
            force += size * math.sin(2.0 * math.pi * frequency * time) - get("offset", 0.0) + kicks[k * FINE + i]
            free, most = v + h * force / mass, h * get("dry", 20.0) / mass
            new = 0.0 if abs(free) <= most else free - math.copysign(most, free)
            q, v = q + 0.5 * h * (v + new), new
    vir[1:] = 0.5 * (vir[1:] + vir[:-1])
    columns = {"t": DT * np.arange(n), "qm": qm, "qg": goal, "vir": vir}
    return {name: column[:, None] for name, column in columns.items()} | {"gtau": GAIN, "kp": KP, "kv": KV}
