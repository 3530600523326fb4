"""A ball on the track of a ring, integrated by scipy along a tilt that is known in closed form: records for tests.

The equation is written out here once more, on purpose: nothing of the package is used to make the truth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from mazeplan.core.logs.table import Table

DT = 1.0 / 30.0  # s
G = 9.81  # m/s^2
RADII = {1: 0.08919, 2: 0.068915, 3: 0.048785, 4: 0.02867}  # m, of the tracks of the packaged map


@dataclass(frozen=True)
class Tilt:
    """beta and gamma (rad) as sums of sines: amplitude (rad), frequency (rad/s), phase of each, (2, S)."""

    amplitude: np.ndarray
    frequency: np.ndarray
    phase: np.ndarray

    @classmethod
    def drawn(cls, seed: int, largest: float = 0.06) -> Tilt:
        rng, n = np.random.default_rng(seed), 6
        amplitude = rng.uniform(0.3, 1.0, (2, n))
        amplitude *= largest / amplitude.sum(axis=1, keepdims=True)
        return cls(amplitude, 2.0 * np.pi * rng.uniform(0.05, 1.2, (2, n)), rng.uniform(0.0, 2.0 * np.pi, (2, n)))

    def at(self, t):
        """(beta, beta_dot, beta_ddot, gamma, gamma_dot, gamma_ddot), each of the shape of t."""
        t, out = np.asarray(t, dtype=float), []
        for a, w, p in zip(self.amplitude, self.frequency, self.phase, strict=True):
            turn = np.multiply.outer(t, w) + p
            out += [np.sin(turn) @ a, np.cos(turn) @ (a * w), -np.sin(turn) @ (a * w * w)]
        return tuple(out)


@dataclass(frozen=True)
class Ball:
    """What the ball does: gravity times factor, viscous 1/s, dry rad/s^2 (over +-.1 rad/s), and a pull by the walls."""

    radius: float
    factor: float = 5.0 / 9.0
    viscous: float = 0.0
    dry: float = 0.0
    wave: float = 0.0  # rad/s^2, of sin 4 theta

    def acceleration(self, theta, theta_dot, tilt):
        b, bd, bdd, g, gd, _ = tilt
        s, c = np.sin(theta), np.cos(theta)
        turning = bdd * np.sin(g) - bd**2 * s * c * np.cos(g) ** 2 + gd**2 * s * c + 2.0 * bd * gd * np.cos(g) * s**2
        pull = -self.factor * G / self.radius * (np.sin(b) * s + np.sin(g) * np.cos(b) * c)
        drag = self.viscous * theta_dot + self.dry * np.tanh(theta_dot / 0.1)
        return turning + pull - drag + self.wave * np.sin(4.0 * theta)


def motion(ball: Ball, tilt: Tilt, t, start: float = 0.3):
    """theta, theta_dot, theta_ddot at times t (s), the ball at rest at `start` (rad) at the first of them."""

    def rate(now, x):
        return np.array([x[1], ball.acceleration(x[0], x[1], tilt.at(now))])

    done = solve_ivp(rate, (t[0], t[-1]), [start, 0.0], rtol=1e-8, atol=1e-9, dense_output=True)
    assert done.success
    theta, theta_dot = done.sol(t)
    return theta, theta_dot, ball.acceleration(theta, theta_dot, tilt.at(t))


def columns(ball: Ball, seconds: float, seed: int = 0, *, noise: float = 0.0, delay: float = 0.0, largest=0.06):
    """Columns of a table: theta wrapped, `noise` rad off and `delay` s late; tilt."""
    t = np.arange(round(seconds / DT)) * DT
    tilt = Tilt.drawn(seed, largest)
    theta = motion(ball, tilt, np.concatenate([[-delay - 1e-9], t - delay]))[0][1:]
    theta = theta + noise * np.random.default_rng([seed, 7]).standard_normal(len(t))
    beta, _, _, gamma, _, _ = tilt.at(t)
    return {"t": t, "theta": (theta + math.pi) % (2.0 * math.pi) - math.pi, "beta": beta, "gamma": gamma}


def ring_table(rings=(2, 3), seconds: float = 60.0, *, seed: int = 0, noise: float = 2e-4, **ball) -> Table:
    """A record of each ring, one segment each, with the columns ring and segment."""
    ball = {"viscous": 0.3, "dry": 0.3, "wave": 0.5, **ball}
    parts = []
    for i, ring in enumerate(rings):
        part = columns(Ball(RADII[ring], **ball), seconds, seed=10 * seed + ring, noise=noise)
        part["t"] = part["t"] + i * (seconds + 1.0)
        n = len(part["t"])
        parts.append({**part, "ring": np.full(n, float(ring)), "segment": np.full(n, float(i))})
    return Table({name: np.concatenate([part[name] for part in parts]) for name in parts[0]})


def write_csv(table: Table, path):
    """The table as CSV; where NaN is, the cell is empty. Returns the path."""
    cells = [["" if math.isnan(x) else repr(float(x)) for x in column] for column in table.columns.values()]
    rows = [tuple(table.columns), *zip(*cells, strict=True)]
    path.write_text("\n".join(",".join(row) for row in rows) + "\n")
    return path
