"""Training on a graphics card finds what training on the processor finds. Needs a card that torch sees."""

from __future__ import annotations

import numpy as np
import pytest
from test_policy_training import LIMIT, predicted, samples

from mazeplan.learning.policy_training import fit_network

torch = pytest.importorskip("torch")
pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="torch sees no CUDA device")


def test_the_same_seed_trains_the_same_policy_on_both_devices():
    made = samples(gain=2.0)
    one, other = (fit_network(*made, LIMIT, np.zeros(2), epochs=5, seed=1, device=d) for d in ("cpu", "cuda"))
    difference = predicted(one, made[0], made[2]) - predicted(other, made[0], made[2])
    assert np.abs(difference).max() < 0.02 * LIMIT  # single precision, summed in another order
    assert other.error == pytest.approx(one.error, rel=0.05)
