"""Screening of settings by their plans on a model: what is surely worse is found worse."""

from __future__ import annotations

import numpy as np
import pytest
import screen as module
from screen import WORST, arrivals, correlation, judged, screen

from mazeplan.learning.modelfile import load_model
from mazeplan.run.settings import load_settings


@pytest.fixture(autouse=True)
def few(monkeypatch):
    monkeypatch.setattr(module, "SCENES", 3)
    monkeypatch.setattr(module, "DRAWS", 8)


def test_settings_that_go_slowly_cost_more_and_those_that_cannot_drive_most():
    lame = {"cost": {"control": 5.0, "rate": 5.0}}
    prices = screen([{}, lame, {"travel": {"speed_m_s": -1.0}}], load_model("ideal"), 3, "compiled")
    assert 0.05 < prices[0] < 1.3
    assert prices[0] + 0.1 < prices[1] < WORST
    assert prices[2] == WORST
    again = screen([lame], load_model("ideal"), 3, "compiled")
    assert again[0] == pytest.approx(prices[1], abs=1e-12)  # whoever else is screened


def test_the_time_of_arrival():
    settings = load_settings()
    states = np.zeros((3, 5, 6))
    states[0, :, 0] = [0.5, 0.3, 0.1, 0.0, 0.0]  # there after three samples
    states[1, :, 0] = 0.0
    states[1, :, 1] = [9.0, 9.0, 0.0, 0.0, 0.0]  # there at once, but too fast
    states[2, :, 0] = 0.5  # never
    times = arrivals(states, np.zeros(3), 0.2, settings, 0.1)
    assert times[:2] == pytest.approx([0.3, 0.2])
    assert 0.4 < times[2] < 0.4 + 2.0


def test_only_hopeless_candidates_are_passed_over(monkeypatch):
    import tune

    points = [np.full(len(tune.SEARCHED), 0.1 * i) for i in range(6)]
    monkeypatch.setattr(tune, "screen", lambda candidates, model, seed: np.array([0.3, 4.0, 0.2, 0.25, 0.31, 2.0]))
    model = load_model("ideal")
    assert [p[0] for p in tune.screened(points, 3, model, 1)] == pytest.approx([0.0, 0.2, 0.3])  # not by their prices
    assert [p[0] for p in tune.screened(points, 5, model, 1)] == pytest.approx([0.0, 0.2, 0.3, 0.4, 0.5])


def test_what_a_plan_depends_on():
    values = {"cost.speed": 1.0, "gate.kp": 2.0, "gate.window_mm": 3.0, "estimator.acceleration_sigma": 4.0}
    assert judged(values) == {"cost": {"speed": 1.0}, "gate": {"window_mm": 3.0}}


def test_rank_correlation():
    assert correlation(np.array([1.0, 2.0, 9.0]), np.array([0.1, 0.2, 0.3])) == pytest.approx(1.0)
    assert correlation(np.array([1.0, 2.0, 9.0]), np.array([3.0, 2.0, 1.0])) == pytest.approx(-1.0)
