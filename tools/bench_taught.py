"""The best that a Gaussian process of the ball can do on the toy: taught by the truth instead of by measurements.

It is trained on the same rows as any sp of `compare`, with the same inputs and kernel, but angle, rate, acceleration
and tilt are those of the simulator, without noise, delay or smoothing, and a roll-out begins at the true angle and rate
and goes along the true tilt. What it is off by then is no matter of data or filters: it is what the state of such a
model does not hold. Told at every sample, in the future of the roll-out too, how the ball spins and where in the
channel it is, it loses that excuse as well; begun where a straight line through FITTED pictures would begin it, which
no filter can do better that does not know all forces, it loses only that of a perfect start.
Used by tools/bench_predictability.py.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from mazeplan.core.records import Array, IntArray
from mazeplan.learning.features import INPUT_SETS, LOCAL_TERMS, TERMS, local_inputs
from mazeplan.learning.fitting import FitOptions, fit_kind
from mazeplan.learning.ring_scores import THOROUGH, RingData
from mazeplan.learning.rollout import STEPS, Windows, roll_out
from mazeplan.learning.samples import MatchedKinematics
from mazeplan.learning.split import uniform_downsample
from mazeplan.maze.geometry import Maze
from mazeplan.physics.formulas.arrays import RingKinematics

TAU = 2.0 * np.pi
FITTED, DRAWN = 20, 20  # samples of a straight line; starts drawn for each window
SLIDING = 0.3  # rad/s of slip at a wall over which its friction changes sign
AT_WALL = 0.95  # of the way from the middle of the channel to a wall: there the ball touches it


@dataclass(frozen=True)
class Truth:
    """What the simulator knows of each sample: arrays (N,). angle, rate of the ball, rad; radius and its rate, m; spin:
    about the upright axis, rad/s; beta, gamma: rad; dt: s."""

    angle: Array
    rate: Array
    radius: Array
    radius_dot: Array
    spin: Array
    beta: Array
    gamma: Array
    dt: float

    @classmethod
    def of(cls, rows: Array, dt: float) -> Truth:
        """From rows (N, 7): x, y (m), x_dot, y_dot (m/s) of the ball in the plate frame, its upright spin (rad/s), and
        beta, gamma (rad)."""
        x, y, x_dot, y_dot, spin, beta, gamma = rows.T
        r = np.hypot(x, y)
        return cls(
            np.unwrap(np.arctan2(y, x)), (x * y_dot - y * x_dot) / r**2, r, (x * x_dot + y * y_dot) / r, spin, beta,
            gamma, dt,
        )  # fmt: skip

    def slope(self, values: Array) -> Array:
        """Derivative (N,) by time, by differences either way."""
        return np.gradient(values) / self.dt


@dataclass(frozen=True)
class Told(MatchedKinematics):
    """States with what no model is told. spin: upright, rad/s of the ball's way round; place: -1 inner, 1 outer wall;
    drift: rate of the radius, m/s."""

    spin: Array
    place: Array
    drift: Array


def told_inputs(k: RingKinematics, xp: Any = np) -> Array:
    """The local inputs, spin, place, drift, and the sign of the slip at the wall that the ball touches: (N, 15)."""
    assert isinstance(k, Told)
    outer = np.tanh((k.theta_dot + k.spin) / SLIDING) * (k.place > AT_WALL)
    inner = np.tanh((k.theta_dot - k.spin) / SLIDING) * (k.place < -AT_WALL)
    more = [k.spin, np.abs(k.place) * k.place, 10.0 * k.drift, outer + inner]
    return np.concatenate([local_inputs(k), np.stack(more, axis=1)], axis=1)


INPUT_SETS["told"] = told_inputs
TERMS["told"] = ((LOCAL_TERMS[0][0] + (11, 12, 13, 14), ()), *LOCAL_TERMS[1:])


def taught_errors(
    truth: Truth, data: RingData, windows: Windows, sample: IntArray, maze: Maze, noise: float
) -> tuple[float, float, float]:
    """Mean absolute error (rad) after STEPS samples of a process taught by the truth; of one that is told spin and
    place, too; and of that from starts as pictures of some noise (m) allow. By its mean or by what is typical,
    whichever is better. sample: that each row of the data shows."""
    told = _told(truth, data, sample, maze)
    names = {f.name for f in fields(MatchedKinematics)}
    plain = MatchedKinematics(**{name: getattr(told, name) for name in names})
    taught, _ = _errors("local", plain, truth, data, windows, sample, 0.0)
    return taught, *_errors("told", told, truth, data, windows, sample, noise / maze.track_radius(data.test.ring))


def line_covariance(noise: float, dt: float, count: int = FITTED) -> Array:
    """Covariance (2, 2) of value and slope at the last of `count` samples, dt apart, of a straight line fitted to them;
    noise: standard deviation of one."""
    n = count
    both = 6.0 / (n * (n + 1) * dt)
    return noise**2 * np.array([[2.0 * (2 * n - 1) / (n * (n + 1)), both], [both, 12.0 / (n * (n * n - 1) * dt**2)]])


def _told(truth: Truth, data: RingData, sample: IntArray, maze: Maze) -> Told:
    k, place, ball = data.test.k, maze.ring(data.test.ring), maze.ball.radius
    assert isinstance(k, MatchedKinematics)
    angle = truth.angle[sample]
    angle = angle + TAU * np.round((k.theta - angle) / TAU)
    free = 0.5 * (place.outer_radius - place.inner_radius) - ball
    middle = 0.5 * (place.outer_radius + place.inner_radius)
    b_dot, c_dot = truth.slope(truth.beta), truth.slope(truth.gamma)
    return Told(
        radius=k.radius, theta=angle, theta_dot=truth.rate[sample],
        beta=truth.beta[sample], beta_dot=b_dot[sample], beta_ddot=truth.slope(b_dot)[sample],
        gamma=truth.gamma[sample], gamma_dot=c_dot[sample], gamma_ddot=truth.slope(c_dot)[sample],
        beta_past=k.beta_past, gamma_past=k.gamma_past,
        spin=truth.spin[sample] * ball / truth.radius[sample], place=(truth.radius[sample] - middle) / free,
        drift=truth.radius_dot[sample],
    )  # fmt: skip


def _errors(
    inputs: str,
    k: MatchedKinematics,
    truth: Truth,
    data: RingData,
    windows: Windows,
    sample: IntArray,
    noise: float,
) -> tuple[float, float]:
    """From the true start, and from starts that pictures allow; noise: of an angle in one, rad."""
    samples = replace(data.test, k=k, theta_ddot=truth.slope(truth.rate)[sample])
    options = FitOptions(inputs=inputs, heavy_tails=True, training=replace(THOROUGH, family="exponential"))
    rows = data.train_rows[uniform_downsample(len(data.train_rows), options.most)]
    fitted, at = fit_kind("sp", samples, rows, options), windows.start
    exact, off = [], []
    for model in (fitted.model, fitted.typical):
        exact.append(roll_out(model.mean, samples, at, k.theta[at], k.theta_dot[at]).after(STEPS))
        rng, found = np.random.default_rng(0), []
        for _ in range(DRAWN if noise > 0.0 else 0):
            d = rng.multivariate_normal(np.zeros(2), line_covariance(noise, truth.dt), size=len(at))
            found.append(
                roll_out(model.mean, samples, at, k.theta[at] + d[:, 0], k.theta_dot[at] + d[:, 1]).after(STEPS)
            )
        off.append(float(np.mean(found)) if found else exact[-1])
    return min(exact), min(off)
