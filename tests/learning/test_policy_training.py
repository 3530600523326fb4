"""The network of a policy: fitted to commands inside limits, the same for the same seed."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from mazeplan.control.policy import Policy
from mazeplan.learning.policy_training import fit_network

LIMIT = 0.1


def samples(gain: float = 1.0, offset=(0.0, 0.0), count: int = 3000):
    """Inputs, and the commands of a law that wants a tilt out and along, cut at the limits."""
    rng = np.random.default_rng(0)
    inputs = rng.normal(size=(count, 18))
    angle = rng.uniform(-np.pi, np.pi, count)
    c, s = np.cos(angle), np.sin(angle)
    out, along = gain * 0.04 * inputs[:, 0], gain * 0.03 * np.tanh(inputs[:, 1]) * np.sign(1.5 + inputs[:, 2])
    wanted = np.stack([c * out - s * along, -(s * out + c * along)], axis=1) - np.asarray(offset)
    return inputs, np.clip(wanted, -LIMIT, LIMIT), np.stack([c, s], axis=1)


def predicted(fit, inputs, turned, offset=(0.0, 0.0)):
    policy = Policy(fit.layers, fit.mean, fit.scale, np.zeros((1, 12), np.float32), 1.0, LIMIT)
    out, along = policy.tilt(inputs).T
    c, s = turned.T
    wanted = np.stack([c * out - s * along, -(s * out + c * along)], axis=1) - np.asarray(offset)
    return np.clip(wanted, -LIMIT, LIMIT)


def test_it_learns_a_law_from_commands_that_the_limits_cut():
    inputs, commands, turned = samples(gain=4.0, offset=(0.01, -0.02))
    assert (np.abs(commands) == LIMIT).mean() > 0.2
    fit = fit_network(inputs, commands, turned, LIMIT, np.array([0.01, -0.02]), epochs=30)
    error = np.abs(predicted(fit, inputs, turned, (0.01, -0.02)) - commands).mean()
    assert error < 0.2 * np.abs(commands).mean()
    assert fit.error == pytest.approx(error, rel=0.6)  # of samples that it did not see


def test_the_held_out_error_is_that_of_samples_it_did_not_see():
    inputs, commands, turned = samples(count=400)
    noise = np.random.default_rng(1).uniform(-LIMIT, LIMIT, commands.shape)
    fit = fit_network(inputs, noise, turned, LIMIT, np.zeros(2), epochs=60)
    assert np.abs(predicted(fit, inputs, turned) - noise).mean() < 0.8 * fit.error


def test_the_same_seed_gives_the_same_network_and_another_one_another():
    made = samples(count=600)
    one, same, other = (fit_network(*made, LIMIT, np.zeros(2), epochs=2, seed=seed) for seed in (3, 3, 4))
    assert all(np.array_equal(a[0], b[0]) for a, b in zip(one.layers, same.layers, strict=True))
    assert not np.array_equal(one.layers[0][0], other.layers[0][0])


def test_a_decision_needs_no_torch():
    """Imported in a process of its own, policy, folder and leaf leave it out."""
    import subprocess

    code = "import sys, mazeplan.behavior.follow_policy, mazeplan.control.policy; print('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"
