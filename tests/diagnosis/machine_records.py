"""Machines for tests of the diagnosis engine: plain integrators that share nothing with the models."""

from __future__ import annotations

import numpy as np

from mazeplan.diagnosis.engine.record import Record
from mazeplan.physics import Parameter, sin

FEW = ("viscous_friction", "dry_friction", "quadratic_drag", "constant_torque")


class Pendulum:
    """A pendulum with a motor; its stiffness and the gain of its motor are not known."""

    position, unit, inputs = "theta", "rad", ("torque",)
    parameters = {  # noqa: RUF012
        "stiffness": Parameter("1/s^2", 20.0, 1.0, 200.0), "gain": Parameter("rad/s^2/N m", 5.0, 0.1, 100.0)
    }  # fmt: skip
    effects = FEW

    @staticmethod
    def motion(s, p):
        return p.gain * s.torque - p.stiffness * sin(s.theta)


class Slider:
    """A mass under a force; the gain is not known."""

    position, unit, inputs = "x", "m", ("force",)
    parameters = {"gain": Parameter("1/kg", 1.0, 0.01, 100.0)}  # noqa: RUF012
    effects = FEW

    @staticmethod
    def motion(s, p):
        return p.gain * s.force


def torque(t, rng, size=1.0, stop=np.inf):
    """A sum of sines with random phases, and nothing after `stop` (s)."""
    f, phase = rng.uniform(0.1, 1.3, 6), rng.uniform(0.0, 2.0 * np.pi, 6)
    return size * np.where(t < stop, np.sin(2.0 * np.pi * f * t[:, None] + phase).sum(axis=1), 0.0)


def play(
    seed, acceleration, *, seconds=30.0, rate=100.0, noise=1e-3, quantum=0.0, start=0.3, dry=0.0, late=0.0, lag=0.0,
    stop=np.inf, size=1.0, jitter=0.0, offset=0.0, one_way=False, fine=20,
):  # fmt: skip
    """A record of a machine with one coordinate: semi-implicit Euler; friction is an impulse.

    acceleration(x, v, u): without dry friction; dry: its size; late, lag: of the input, s
    fine: steps a sample"""
    rng = np.random.default_rng(seed)
    n = round(seconds * rate)
    h = 1.0 / (rate * fine)
    t = np.arange(n * fine) * h
    u = torque(t, rng, size, stop) + offset
    if one_way:
        u = np.abs(u) + 0.3 * size
    acts = np.interp(t - late, t, u)
    x, v, behind = start, 0.0, float(acts[0])
    out = np.empty(n)
    for k in range(n * fine):
        if k % fine == 0:
            out[k // fine] = x
        behind = behind + (acts[k] - behind) * (h / lag) if lag > 0.0 else acts[k]
        v += h * acceleration(x, v, behind)
        v = 0.0 if abs(v) <= h * dry else v - h * dry * np.sign(v)
        x += h * v
    times, position, given = t[::fine].copy(), out, u[::fine].copy()
    if jitter:
        moved = np.sort(np.clip(times + rng.uniform(-jitter, jitter, n) / rate, 0.0, times[-1]))
        position, given, times = np.interp(moved, times, position), np.interp(moved, times, given), moved
        keep = np.diff(times, prepend=-1.0) > 1e-6
        position, given, times = position[keep], given[keep], times[keep]
    seen = position + noise * rng.standard_normal(len(position))
    if quantum:
        seen = quantum * np.round(seen / quantum)
    return Record(times - times[0], seen[:, None], given[:, None])
