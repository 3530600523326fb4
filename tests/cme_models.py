"""Models of the circular maze of the published kind, trained on a recording that is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mazeplan.learning.published_rig import PREFIX
from mazeplan.learning.published_samples import Published

RATE = 30.0
ENDING = "_ring{}_toy.txt"


@dataclass(frozen=True)
class Recording:
    """All samples of an uninterrupted recording, and the numbers of those that are in the ring."""

    angles: np.ndarray
    rates: np.ndarray
    theta_ddot: np.ndarray
    inside: tuple[np.ndarray, ...]

    def thinned(self, step):
        """Numbers of the published samples, by segment: every step-th of each, and what is recovered between them."""
        published = [stay[::step] for stay in self.inside]
        return published, [np.arange(p[0], p[-1] + 1) for p in published]

    def rows(self, step):
        k = np.concatenate(self.thinned(step)[0])
        wrapped = self.angles[k].copy()
        wrapped[:, 0] = np.remainder(wrapped[:, 0] + np.pi, 2 * np.pi) - np.pi
        return Published(wrapped, self.rates[k], self.theta_ddot[k])


STAYS = ((20, 420), (431, 700), (760, 1000), (1003, 1390))  # samples with the ball in the ring


def record(seed=0, stays=STAYS):
    """A ball that goes round and round and a plate that sways, with the two filters written out as loops."""
    rng, samples = np.random.default_rng(seed), stays[-1][1] + 10
    t = np.arange(samples) / RATE
    angles = np.empty((samples, 3))
    for axis, (size, top) in enumerate(((1.2, 0.9), (0.04, 1.5), (0.04, 1.5))):
        frequency, phase = rng.uniform(0.05, top, 20), rng.uniform(0, 2 * np.pi, 20)
        angles[:, axis] = size * np.sin(2 * np.pi * frequency * t[:, None] + phase).sum(axis=1) / np.sqrt(10)
    angles[:, 0] += 1.5 * t
    angles += rng.normal(0.0, 1e-4, angles.shape)
    rates = np.zeros_like(angles)
    for k in range(2, samples):
        gone = angles[k] - angles[k - 1]
        rates[k] = 1.21647638 * rates[k - 1] - 0.42187148 * rates[k - 2] + RATE * 0.2053951 * gone
    acceleration = np.zeros(samples)
    for k in range(3, samples - 3):  # second derivative of the parabola through seven samples
        acceleration[k] = 2 * np.polyfit(t[k - 3 : k + 4] - t[k], angles[k - 3 : k + 4, 0], 2)[0]
    return Recording(angles, rates, acceleration, tuple(np.arange(*stay) for stay in stays))


def train(rows, folder, ring=1):
    """Write the files of an exact model of these rows; its noise variance, which the likelihood finds best."""
    (theta, beta, gamma), (theta_d, beta_d, gamma_d) = rows.angles.T, rows.rates.T
    features = np.stack(
        [
            -(beta_d**2) * np.sin(theta) * np.cos(gamma) ** 2 * np.cos(theta),
            -2 * beta_d * gamma_d * np.cos(gamma) * np.cos(theta) ** 2,
            2 * beta_d * gamma_d * np.cos(gamma),
            gamma_d**2 * np.sin(theta) * np.cos(theta),
            -9.806 * np.sin(beta) * np.sin(theta),
            -9.806 * np.sin(gamma) * np.cos(beta) * np.cos(theta),
            -theta_d,
        ],
        axis=1,
    )
    inputs = [theta_d, beta_d, gamma_d, *(f(a) for a in (theta, beta, gamma) for f in (np.sin, np.cos))]
    inputs = np.stack(inputs, axis=1)
    scales, lengths = inputs.std(axis=0), np.linspace(0.5, 4.0, 9)
    x = inputs / scales / lengths
    distance = np.sum((x[:, None] - x[None]) ** 2, axis=2)
    shape = np.exp(-0.5 * distance) + 2.0 * features @ features.T + 0.5 * np.eye(len(x))
    target_scale = rows.theta_ddot.std()
    target = rows.theta_ddot / target_scale
    size = target @ np.linalg.solve(shape, target) / len(target)
    alpha = np.linalg.solve(size * shape, target)
    files = {
        "inputs": inputs / scales,
        "alpha": alpha,
        "lengths": lengths[None],
        "kernel_scale": [size],
        "input_scales": scales,
        "target_scale": [target_scale],
        "weights": target_scale * 2.0 * size * features.T @ alpha,
    }
    folder.mkdir(exist_ok=True)
    for name, values in files.items():
        np.savetxt(folder / (PREFIX[name] + ENDING.format(ring)), values)
    return 0.5 * size
