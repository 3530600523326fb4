"""A ball in a round channel on a moving plate, by Newton and Euler in three dimensions and small steps.

It shares nothing with `mazeplan.physics`: ball and spin have three components each, and floor and
wall act by impulses that end slip at the points of contact. That it rolls, that 5/7 or 5/9 of gravity move it, and
what an impact does to its spin come out by themselves. The floor always grips; friction at the wall is along it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

G = 9.81


class Toy(NamedTuple):
    """radius: m, of the ball; inner, outer: m, walls of the channel; k: inertia over m R^2; c, c_s: m/s^2, rolling and
    spinning friction; wall: Coulomb's; e: restitution; push: rad/s^2, times cos(theta), along the ring."""

    radius: float = 6.35e-3
    inner: float = 0.045
    outer: float = 0.060
    k: float = 0.4
    c: float = 0.06
    c_s: float = 0.03
    wall: float = 0.22
    e: float = 0.5
    push: float = 0.0


def waves(seed, count=5, tilt=0.03):
    """Amplitudes (rad), angular speeds, phases of the plate's two axes, (2, count, 3)."""
    rng = np.random.default_rng(seed)
    a = rng.uniform(0.3, 1.0, (2, count)) * tilt / math.sqrt(count) * 1.5
    return np.stack([a, rng.uniform(1.0, 9.0, (2, count)), rng.uniform(0.0, 6.28, (2, count))], axis=-1)


@njit
def plate_at(wave, t):
    """beta, its rate and acceleration, gamma's."""
    out = np.zeros(6)
    for i in range(2):
        for j in range(wave.shape[1]):
            a, w, p = wave[i, j]
            out[3 * i] += a * math.sin(w * t + p)
            out[3 * i + 1] += a * w * math.cos(w * t + p)
            out[3 * i + 2] -= a * w * w * math.sin(w * t + p)
    return out


@njit
def _cross(a, b):
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@njit
def _gripped(v, s, toy):
    """Velocity and spin behind the floor's impulse that ends slip there."""
    arm = np.array([0.0, 0.0, -toy.radius])
    slip = v + _cross(s, arm)
    j = -slip / (1.0 + 1.0 / toy.k)
    j[2] = 0.0
    return v + j, s + _cross(arm, j) / (toy.k * toy.radius**2)


@njit
def _hit(v, s, arm, impulse, toy):
    """Velocity and spin behind an impulse of a wall, and what the floor answers."""
    return _gripped(v + impulse, s + _cross(arm, impulse) / (toy.k * toy.radius**2), toy)


@njit
def _impact(v, s, n, toy):
    """Velocity and spin behind an impact with a wall whose normal, away from it, is n; its contact has no height."""
    arm, along = -toy.radius * n, np.array([-n[1], n[0], 0.0])
    u = v[0] * n[0] + v[1] * n[1]
    one, _ = _hit(v, s, arm, n, toy)
    press = -(1.0 + toy.e) * u / (one[0] * n[0] + one[1] * n[1] - u)
    slip = (v + _cross(s, arm)) @ along
    tv, ts = _hit(v, s, arm, along, toy)
    ends = -slip / ((tv + _cross(ts, arm)) @ along - slip)
    grip = min(max(ends, -toy.wall * press), toy.wall * press)
    return _hit(v, s, arm, press * n + grip * along, toy)


@njit
def _rubbed(v, s, h, press, toy):
    """Velocity and spin behind the floor's friction against rolling and spinning, which it shares among both."""
    rolling, spinning = math.hypot(s[0], s[1]) * toy.radius, abs(s[2]) * toy.radius
    a, b = toy.c * rolling, toy.c_s * spinning
    both = math.hypot(a, b) + 1e-12
    s = s.copy()
    less = h * press * toy.c * a / both / (toy.k * toy.radius)
    if rolling > 0.0:
        turn = math.hypot(s[0], s[1])
        s[:2] *= max(0.0, 1.0 - less / turn)
    s[2] = math.copysign(max(0.0, abs(s[2]) - h * press * toy.c_s * b / both / (toy.k * toy.radius)), s[2])
    return _gripped(v, s, toy)


@njit
def play(toy, wave, table, start, h, steps, every, out):
    """States (M, 5) as (x, y, vx, vy, spin about the vertical times the radius), every so many steps of h s, into out.

    start: such a state at time 0; table: its tilt (2,), rad."""
    p, v = np.array([start[0], start[1], toy.radius]), np.array([start[2], start[3], 0.0])
    s = np.array([-v[1] / toy.radius, v[0] / toy.radius, start[4] / toy.radius])
    for i in range(steps):
        if i % every == 0:
            out[i // every] = np.array([p[0], p[1], v[0], v[1], s[2] * toy.radius])
        m = plate_at(wave, (i + 0.5) * h)
        b, c = m[0] + table[0], m[3] + table[1]
        sb, cb, sc, cc = math.sin(b), math.cos(b), math.sin(c), math.cos(c)
        g = np.array([G * sb, -G * cb * sc, -G * cb * cc])
        o = np.array([m[4], m[1] * cc, -m[1] * sc])
        q = np.array([m[5], m[2] * cc - m[1] * m[4] * sc, -m[2] * sc - m[1] * m[4] * cc])
        a = g - _cross(q, p) - 2.0 * _cross(o, v) - _cross(o, _cross(o, p))
        r = math.hypot(p[0], p[1])
        a[:2] += toy.push * (p[0] / r) * (1.0 + toy.k) * np.array([-p[1], p[0]])
        old = v.copy()
        press = max(-a[2], 0.0) / G
        a[2] = 0.0
        v, s = _gripped(v + h * a, s - h * (q + _cross(o, s)), toy)
        v, s = _rubbed(v, s, h, press, toy)
        p[:2] += 0.5 * h * (old + v)[:2]
        r = math.hypot(p[0], p[1])
        for wall, way in ((toy.outer - toy.radius, -1.0), (toy.inner + toy.radius, 1.0)):
            if way * (r - wall) < 0.0:
                n = way * np.array([p[0] / r, p[1] / r, 0.0])
                u = v[0] * n[0] + v[1] * n[1]
                deep = way * (wall - r)
                if u < 0.0:
                    before = min(deep / -u, h)
                    new, s = _impact(v, s, n, toy)
                    p[:2] += before * (new - v)[:2]
                    v = new


def record(toy, seed=1, seconds=60.0, table=(0.003, -0.004), noise=5e-4, delay=2.0 / 30.0):
    """t (N,), pictures (N, 2) in m that are `delay` s late, the waves and the true states (N, 5), at 30 Hz."""
    wave, per = waves(seed), 200
    n = round(seconds * 30.0)
    out = np.empty((n, 5))
    middle = 0.5 * (toy.inner + toy.outer)
    play(toy, wave, np.array(table), np.array([middle, 0.0, 0.0, 0.0, 0.0]), 1.0 / (30.0 * per), n * per, per, out)
    t, late = np.arange(n) / 30.0, round(delay * 30.0)
    seen = out[np.maximum(np.arange(n) - late, 0), :2]
    return t, seen + noise * np.random.default_rng(seed + 100).standard_normal((n, 2)), wave, out
