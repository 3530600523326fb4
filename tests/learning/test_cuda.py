"""Training on a graphics card finds what training on the processor finds. Needs a card that torch sees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_policy_training import LIMIT, predicted, samples

from mazeplan.learning.gaussian_process import GaussianProcess
from mazeplan.learning.gp_training import TrainingOptions, train
from mazeplan.learning.policy_training import fit_network
from mazeplan.learning.posterior import ProcessDraws

torch = pytest.importorskip("torch")
pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="torch sees no CUDA device")


def test_the_same_seed_trains_the_same_policy_on_both_devices():
    made = samples(gain=2.0)
    one, other = (fit_network(*made, LIMIT, np.zeros(2), epochs=5, seed=1, device=d) for d in ("cpu", "cuda"))
    difference = predicted(one, made[0], made[2]) - predicted(other, made[0], made[2])
    assert np.abs(difference).max() < 0.02 * LIMIT  # single precision, summed in another order
    assert other.error == pytest.approx(one.error, rel=0.05)


def test_a_process_gets_the_same_hyperparameters_on_both_devices():
    rng = np.random.default_rng(0)
    inputs, features = rng.normal(size=(400, 9)), rng.normal(size=(400, 2))
    y = np.sin(inputs[:, 0]) + features @ [0.5, -0.2] + 0.05 * rng.normal(size=400)
    options = TrainingOptions(first=150, rows=300, starts=1, iterations=15, refinement=8)
    one, other = (train(inputs, features, y, replace(options, device=d)) for d in ("cpu", "cuda"))
    assert other.refined == pytest.approx(one.refined, abs=1e-4)
    assert other.hyper.noise == pytest.approx(one.hyper.noise, rel=1e-2)


@pytest.mark.parametrize("family", ["rbf", "exponential"])
def test_draws_of_a_process_are_the_same_on_both_devices(family):
    rng = np.random.default_rng(0)
    inputs, features = rng.normal(size=(200, 9)), rng.normal(size=(200, 2))
    y = np.sin(inputs[:, 0]) + features @ [0.5, -0.2] + 0.05 * rng.normal(size=200)
    hyper = replace(train(inputs, features, y, TrainingOptions(first=150, rows=200, starts=1)).hyper, family=family)
    process = GaussianProcess.condition(hyper, inputs, features, y)
    draws = [ProcessDraws(process, process, 5, np.random.default_rng(1), d, "float64") for d in ("cpu", "cuda")]
    asked = rng.normal(size=(20, 9)), rng.normal(size=(20, 2))
    one, other = (draw.mean(*asked) for draw in draws)
    assert np.ptp(one) > 0.1
    np.testing.assert_allclose(other, one, rtol=1e-8, atol=1e-8)
