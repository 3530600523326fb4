"""An unbalanced ball: the second filter against the joint distribution of its innovations, and what is said of it."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from mazeplan.core.errors import ModelError
from mazeplan.diagnosis.rig.imbalance import BALANCED, Imbalance, _Along, _follow, also_in, imbalance_entry
from mazeplan.diagnosis.rig.reference import load_reference, reference_path, save_reference, textbook
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.mapfile import load_map

MAZE = load_map("cme")
FOUND = Imbalance(0.1, 0.01, 8.0, 200.0)


def spun(v, turn):
    """Rodrigues' rotation of a vector."""
    angle = np.linalg.norm(turn)
    axis = turn / angle
    return v * math.cos(angle) + np.cross(axis, v) * math.sin(angle) + axis * (axis @ v) * (1.0 - math.cos(angle))


def some(n, seed=0):
    """Innovations, gains and turns of n pictures; one picture is lost, and one begins a stretch."""
    rng = np.random.default_rng(seed)
    nu, begins = 1e-3 * rng.standard_normal(n), np.zeros(n, dtype=bool)
    nu[4], begins[[0, 9]] = np.nan, True
    angle = rng.uniform(-3.0, 3.0, n)
    S = np.where(np.isfinite(nu), rng.uniform(1e-7, 1e-6, n), 1.0)
    return _Along(nu, S, rng.uniform(0.2, 0.5, n), rng.uniform(1.0, 4.0, n), np.cos(angle), np.sin(angle),
                  rng.standard_normal((n, 3)), begins)  # fmt: skip


def responses(a, dt, rho):
    """Innovations (K, N) that follow from each unit of b at the begin of a stretch, and of its noise at a picture, with
    whether it is one at a begin."""
    out = []
    for at in range(len(a.nu)):
        for unit in np.eye(3):
            for first in (True, False) if a.begins[at] else (False,):
                e, v, b, row = 0.0, 0.0, unit if first else np.zeros(3), np.zeros(len(a.nu))
                for n in range(at, len(a.nu)):
                    if n > at and a.begins[n]:
                        break
                    row[n] = e
                    seen = np.isfinite(a.nu[n])
                    kept, slower = e - a.to_place[n] * e * seen, v - a.to_speed[n] * e * seen
                    pull = a.tx[n] * b[0] + a.ty[n] * b[1]
                    e, v = kept + dt * slower + 0.5 * dt**2 * pull, slower + dt * pull
                    b = rho * spun(b, a.turn[n]) + (unit if n == at and not first else 0.0)
                out.append((first, row))
    return out


def test_its_likelihood_is_that_of_the_joint_distribution():
    a, dt, size, coherence = some(20), 1.0 / 30.0, 0.7, 0.2
    rho = math.exp(-dt / coherence)
    cov = np.diag(a.S)
    for first, row in responses(a, dt, rho):
        cov = cov + size**2 / 3.0 * (1.0 if first else 1.0 - rho**2) * np.outer(row, row)
    seen = np.isfinite(a.nu)
    squares, logs, count = _follow(a, dt, size, coherence)
    told = squares + logs + np.sum(np.log(2.0 * math.pi * a.S[seen]))
    joint: Any = multivariate_normal
    expected = joint(cov=cov[np.ix_(seen, seen)]).logpdf(a.nu[seen])
    assert count == 19
    assert told == pytest.approx(-2.0 * expected, rel=1e-9)


def test_the_entry_has_the_amplitude_in_each_ring_and_a_phase_that_nobody_knows():
    entry = imbalance_entry(FOUND, BALANCED, {3: 0.05, 1: 0.09})
    assert entry is not None
    assert entry["parameters"]["amplitude"] == {
        "value": pytest.approx(2.0), "stderr": pytest.approx(0.2), "unit": "rad/s^2",
    }  # fmt: skip
    assert entry["parameters"]["phase"]["stderr"] == pytest.approx(np.std(np.linspace(-math.pi, math.pi, 10001)), 1e-3)
    assert entry["known_before"]["amplitude"] == 0.0
    assert list(entry["rings"]) == ["3", "1"]
    assert entry["rings"]["1"]["after"]["amplitude"] == pytest.approx(0.1 / 0.09)


@pytest.mark.parametrize(
    ("now", "was", "radii"),
    [
        (BALANCED, BALANCED, {1: 0.09}),
        (FOUND, FOUND._replace(size=0.12), {1: 0.09}),  # no larger than it was
        (FOUND, FOUND._replace(size=0.06), {1: 0.09}),  # not surely larger
        (FOUND._replace(size=0.008, stderr=0.001), BALANCED, {1: 0.09}),  # too small for a word
        (FOUND, BALANCED, {}),
    ],
)
def test_what_is_not_surely_larger_than_before_is_no_news(now, was, radii):
    assert imbalance_entry(now, was, radii) is None


@pytest.mark.parametrize(("gain", "shows"), [(12.0, True), (-5.0, True), (-30.0, False)])
def test_a_reference_may_show_an_imbalance_less_than_surely(monkeypatch, gain, shows):
    monkeypatch.setattr("mazeplan.diagnosis.rig.imbalance._along", lambda body, fit: some(10))
    minus2 = lambda along, dt, size, coherence: -gain if size > 0.06 else 0.0  # noqa: E731
    monkeypatch.setattr("mazeplan.diagnosis.rig.imbalance._minus2", minus2)
    pictures_then = type("Pictures", (), {"dt": 1.0 / 30.0, "__len__": lambda self: 1000})()
    earlier: Any = SimpleNamespace(pictures=pictures_then, run=lambda model: None)
    assert also_in(earlier, textbook().body.model, FOUND) is shows


def test_the_reference_keeps_the_imbalance(tmp_path):
    model = RigModel.nominal(MAZE)
    save_reference(replace(textbook(), imbalance=FOUND), model, tmp_path)
    kept = load_reference(tmp_path, model)
    assert kept is not None
    assert (kept.imbalance.size, kept.imbalance.stderr) == (0.1, 0.01)
    path = reference_path(tmp_path)
    path.write_text(path.read_text().replace("stderr: 0.01", "stderr: -1"))
    with pytest.raises(ModelError, match=r"reference\.yaml: imbalance: stderr: got -1, expected a number from 0"):
        load_reference(tmp_path, model)
    save_reference(textbook(), model, tmp_path)
    kept = load_reference(tmp_path, model)
    assert kept is not None
    assert kept.imbalance == BALANCED
