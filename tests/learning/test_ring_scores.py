"""Scores of a model on one ring."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mazeplan.learning.comparison import nrmse


def test_the_figure_by_hand():
    truth = np.array([1.0, -1.0, 1.0, -1.0])
    assert nrmse(truth, np.zeros(4)) == 1.0
    assert nrmse(truth, truth) == 0.0
    assert nrmse(truth + 5.0, truth + 4.5) == pytest.approx(0.5)
    assert math.isnan(nrmse(np.ones(4), np.zeros(4)))
    assert math.isnan(nrmse(np.zeros(0), np.zeros(0)))
