"""Reports of models: tables and heat maps by a second route."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from report_documents import comparison

from mazeplan.models.residual_map import ANGLES, FEWEST, residual_map
from mazeplan.models.rollout import Rollout
from mazeplan.report.inputs import Input, of_document
from mazeplan.report.models import around, best_kind, models_section
from mazeplan.report.page import Picture, Table


def test_a_cell_has_the_samples_of_its_angle_and_rate():
    rng = np.random.default_rng(0)
    theta, rate = rng.uniform(-7.0, 7.0, 3000), rng.normal(0.0, 1.0, 3000)
    left = rng.normal(0.3, 1.0, 3000)
    found = residual_map(theta, rate, {"p": left})
    assert found.count.sum() == 3000
    for row, column in ((0, 0), (2, 17), (5, ANGLES - 1)):
        here = [
            k for k in range(3000)
            if math.floor(math.degrees(theta[k]) % 360.0 / 10.0) == column
            and found.rate[row] <= rate[k] <= found.rate[row + 1]
        ]  # fmt: skip
        assert found.count[row, column] == len(here) >= FEWEST
        assert found.mean["p"][row, column] == pytest.approx(left[here].mean())
        assert found.rms["p"][row, column] == pytest.approx(math.sqrt((left[here] ** 2).mean()))


def test_cells_with_few_samples_say_nothing():
    theta = np.radians([5.0] * FEWEST + [15.0] * (FEWEST - 1))
    found = residual_map(theta, np.ones(len(theta)), {"p": np.ones(len(theta))})
    document = found.document()
    known = [(i, j) for i, row in enumerate(document["rms"]["p"]) for j, cell in enumerate(row) if cell is not None]
    assert [j for _, j in known] == [0]
    assert json.dumps(document, allow_nan=False)


def test_all_rates_together_are_the_rms_of_all_samples():
    rng = np.random.default_rng(1)
    theta, rate, left = rng.uniform(0.0, 2 * np.pi, 9000), rng.normal(size=9000), rng.normal(size=9000)
    together = around(residual_map(theta, rate, {"p": left}).document(), "p")
    for column in (0, 20):
        here = np.floor(np.degrees(theta) / 10.0) == column
        assert together[column] == pytest.approx(math.sqrt((left[here] ** 2).mean()), abs=2e-3)
    assert around(comparison()["ring1"]["residual"], "sp")[4] == pytest.approx(math.sqrt((10 * 4 + 30) / 40))


def test_bands_of_a_roll_out():
    error = np.abs(np.random.default_rng(2).normal(size=(101, 41)))
    bands = Rollout(error, error).bands()
    assert bands["mean"][40] == pytest.approx(Rollout(error, error).after(40))
    assert bands["p10"][7] == pytest.approx(np.sort(error[:, 7])[10])
    assert bands["p90"][7] == pytest.approx(np.sort(error[:, 7])[90])


def section(document):
    return models_section(Input("comparison", Path("c.json"), "c", document))


def test_tables_have_the_numbers_of_the_document_and_the_published_ones():
    assert best_kind(comparison()) == "sp"
    tables = [part for part in section(comparison()).parts if isinstance(part, Table)]
    first, second = tables
    assert list(first.head) == ["", "p", "sp"]
    assert first.rows[0] == ["ring 1: 400 rows, 100 to test", "0.910 / 0.910", "0.200 / 0.345 [0.31, 0.37]"]
    assert first.strong == {(0, 2), (1, 2)}
    assert first.rows[2] == ["published, ring 1", "-", "0.35"]
    assert second.rows[0] == ["ring 1: 7 windows, evenly spaced", "0.123 / 0.247"]
    assert second.rows[-1] == ["published, ring 2", "0.15 / 0.33"]


def test_pictures_are_those_that_there_are_numbers_for():
    names = [part.name for part in section(comparison()).parts if isinstance(part, Picture)]
    assert names == ["learning", "rollouts", "residual-maze", "residual-rings"]
    old = comparison()
    for scores in old.values():
        for name in ("curve", "bands", "residual"):
            del scores[name]
    assert not [part for part in section(old).parts if isinstance(part, Picture)]


def test_the_heat_map_shows_the_cell_and_its_sign():
    from matplotlib.figure import Figure

    from mazeplan.report.models_pictures import _heat, _learning

    figure = Figure()
    _heat(figure, comparison(), [1, 2])
    axes = figure.axes[0]
    cells = axes.collections[0].get_array()
    assert cells[0, 4] == -1.75
    assert cells[5, 4] == 0.5
    assert int((~np.ma.getmaskarray(cells)).sum()) == 2
    assert [(t.get_text(), t.get_position()) for t in axes.texts] == [("−", (45.0, 0.5))]  # .5 is not worth a sign
    figure = Figure()
    _learning(figure, comparison())
    (curve,) = figure.axes[0].lines
    assert curve.get_xydata().tolist() == [[50, 0.8], [200, 0.5], [400, 0.3451]]


def test_of_document_knows_it():
    assert [part.kind for part in of_document(comparison(), Path("c.json"))] == ["comparison"]
