"""Reports of models: tables and heat maps by a second route."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from commands import call
from report_documents import comparison, drawn, kept
from ring_record import RADII, Ball, columns, ring_table, write_csv
from standalone_page import alone

from mazeplan.apps.report.documents import ResidualDocument, best_kind
from mazeplan.apps.report.inputs import Input
from mazeplan.apps.report.learned import effects_table, judged, learned_from
from mazeplan.apps.report.models import around, model_section, models_section
from mazeplan.apps.report.page import Note, PagePicture, PageTable
from mazeplan.apps.report.words import MISSING
from mazeplan.core.errors import InputError
from mazeplan.core.logs.table import Table as Record
from mazeplan.core.logs.table import read_table
from mazeplan.learning.modelfile import RigModel, save_model
from mazeplan.learning.ring_scores import ANGLES, FEWEST, residual_map
from mazeplan.learning.rollout import Rollout
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.effects.ball import rolling_inertia
from mazeplan.physics.rig.stage import StageModel


def given(document):
    return Input("comparison", Path("c.json"), "c", document)


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
    found = ResidualDocument.model_validate(residual_map(theta, rate, {"p": left}).document())
    together = around(found, "p")
    for column in (0, 20):
        here = np.floor(np.degrees(theta) / 10.0) == column
        assert together[column] == pytest.approx(math.sqrt((left[here] ** 2).mean()), abs=2e-3)
    assert around(given(comparison()).document[1].residual, "sp")[4] == pytest.approx(math.sqrt((10 * 4 + 30) / 40))


def test_bands_of_a_roll_out():
    error = np.abs(np.random.default_rng(2).normal(size=(101, 41)))
    bands = Rollout(error, error).bands()
    assert bands["mean"][40] == pytest.approx(Rollout(error, error).after(40))
    assert bands["p10"][7] == pytest.approx(np.sort(error[:, 7])[10])
    assert bands["p90"][7] == pytest.approx(np.sort(error[:, 7])[90])


def section(document):
    return models_section(given(document))


def test_tables_have_the_numbers_of_the_document_and_the_published_ones():
    assert best_kind(given(comparison()).document) == "sp"
    first, second = kept(section(comparison()).parts, PageTable)
    assert list(first.head) == ["", "bare equation (p)", "terms and process (sp)"]
    plain = [[cell.replace("\u00a0", " ") for cell in row] for row in first.rows]
    assert plain[0] == ["ring 1: 400 rows, 100 to test", "0.910 / 0.910", "0.200 / 0.345\n[0.31, 0.37]"]
    assert first.strong == {(0, 2), (1, 2)}
    assert plain[2] == ["published, ring 1", MISSING, "0.35"]
    degrees = [[cell.replace("\u00a0", " ") for cell in row] for row in second.rows]
    assert degrees[0] == ["ring 1: 7 windows, evenly spaced", "7.1 / 14.1"]
    assert degrees[-1] == ["published, ring 2", "8.6 / 18.9"]
    assert "deg" in second.caption
    assert first.caption.endswith("; bold: least on test rows")
    assert second.caption.endswith("; bold: least after 40")
    late = comparison()
    late["ring1"]["rollout"] |= {"p": {"20": 0.1, "40": 0.3}, "np": {"20": 0.3, "40": 0.2}}
    table = kept(section(late).parts, PageTable)[1]
    assert [table.head[column] for row, column in table.strong if row == 0] == ["Gaussian process"]


def test_pictures_are_those_that_there_are_numbers_for():
    names = [part.name for part in kept(section(comparison()).parts, PagePicture)]
    assert names == ["rollouts", "residual-maze"]
    old = comparison()
    for scores in old.values():
        for name in ("bands", "residual"):
            del scores[name]
    assert not kept(section(old).parts, PagePicture)


def test_the_picture_over_the_maze_needs_a_map_with_all_rings():
    document = comparison((1, 7))
    without = section(document).parts
    assert [part.name for part in kept(without, PagePicture)] == ["rollouts"]
    note = Note(
        "The picture over the maze needs the map. This command draws it:",
        "mazeplan compare LOG... --report FILE.html",
    )
    assert note in without
    parts = models_section(Input("comparison", Path("c.json"), "c", document, maze=load_map("seven"))).parts
    assert note not in parts
    axes = drawn(parts, "residual-maze").axes[0]
    reach = max(np.abs(np.asarray(path.vertices)).max() for c in axes.collections for path in c.get_paths())
    assert reach > load_map("seven").ring(7).inner_radius
    assert note not in section(comparison()).parts


def test_too_few_samples_to_judge_by_are_counted():
    record = Record({**columns(Ball(RADII[2]), 1.0), "ring": np.full(30, 2.0)})
    model = RigModel(StageModel(), {2: BallModel(())})
    with pytest.raises(InputError, match=r"got at most \d+ usable samples in a ring, expected 50: record for longer"):
        judged(model, [record], load_map("cme"))


def test_a_model_is_judged_on_a_table_as_the_equation_says():
    """A model that is the truth leaves next to nothing, and the bare equation the share that it lacks."""
    ball = Ball(RADII[2], factor=0.6)
    model = RigModel(StageModel(), {2: BallModel((rolling_inertia(0.6),), {"rolling_inertia": {"factor": 0.01}})})
    record = Record({**columns(ball, 40.0), "ring": np.full(1200, 2.0)})
    scores = judged(model, [record], load_map("cme"))[2]
    assert scores.nrmse_test["model"] < 0.25 * scores.nrmse_test["p"]
    assert scores.nrmse_test["p"] == pytest.approx(0.4 / 0.6, abs=0.2)  # smoothing takes from both
    assert scores.rollout["model"]["40"] < 0.1 * scores.rollout["p"]["40"]
    size = ["0.600\u00a0±\u00a00.010", "rolling_inertia.factor"]
    assert effects_table(model).rows == [["rolling inertia: factor of the gravity part", *size]]


@pytest.mark.slow
def test_a_models_folder_is_a_page(monkeypatch, capsys, tmp_path):
    folder = save_model(RigModel.nominal(load_map("cme")), tmp_path / "mine").parent
    record = write_csv(ring_table((2,), 40.0), tmp_path / "x.csv")
    done = partial(call, monkeypatch, capsys, "report")
    code, _, err = done(folder, record, "-o", tmp_path / "m.html")
    assert code == 0, err
    page = alone(tmp_path / "m.html")
    assert "Model mine on x.csv" in page
    assert page.count("<figure") == 2
    assert "viscous friction: coefficient, 1/s" in page
    code, _, err = done(folder, "-o", tmp_path / "n.html")
    assert code == 0, err
    assert "Kind of model: bare equation (p)." in alone(tmp_path / "n.html")
    code, _, err = done(record, "-o", tmp_path / "o.html")
    assert code == 2
    assert "x.csv: got a table, expected the folder of a model to score on it as well" in err
    code, _, err = done("none.csv", "-o", tmp_path / "o.html")
    assert (code, err.count("none.csv: no such file")) == (2, 1)


def test_a_model_on_the_log_that_it_was_learned_from_carries_a_warning(tmp_path):
    """It is known by what is in it, under whatever name; another of the same name is another."""
    ball = BallModel((rolling_inertia(0.5),))
    write_csv(ring_table((2,), 20.0), tmp_path / "log.csv")
    write_csv(ring_table((2,), 19.0), tmp_path / "new.csv")
    source = read_table(tmp_path / "log.csv").source
    model = RigModel(StageModel(), {2: ball}, data=(source,))
    folder = save_model(model, tmp_path / "model").parent
    (tmp_path / "log.csv").rename(tmp_path / "renamed.csv")
    (tmp_path / "new.csv").rename(tmp_path / "log.csv")
    assert "Beware: the model was learned from renamed.csv" in model_section(folder, [tmp_path / "renamed.csv"]).lead
    assert "Beware" not in model_section(folder, [tmp_path / "log.csv"]).lead
    assert learned_from(replace(model, data=({"file": "log.csv"},)), [tmp_path / "log.csv"]) == ["log.csv"]


def test_the_lead_says_where_another_is_better_than_the_best_on_average():
    document = comparison()
    lead = section(document).lead
    assert "best on average: terms and process" in lead
    assert "Better there" not in lead
    ring = next(iter(document))
    document[ring]["nrmse_test"]["p"] = 0.3
    lead = section(document).lead
    assert f"Better there: in ring {ring.removeprefix('ring')} bare equation, 0.300." in lead


def test_too_few_blocks_are_said_instead_of_an_interval():
    document = comparison()
    document["ring1"]["blocks"] = {"test": 4, "windows": 4}
    document["ring2"]["blocks"] = {"test": 5, "windows": 5}
    table = kept(section(document).parts, PageTable)[0]
    rows = [[cell.replace("\u00a0", " ") for cell in row] for row in table.rows]
    assert rows[0] == ["ring 1: 400 rows, 100 to test in 4 blocks", "0.910 / 0.910", "0.200 / 0.345\ntoo few"]
    assert rows[1][0] == "ring 2: 400 rows, 100 to test"
    document["ring1"] |= {"blocks": {"test": 1, "windows": 0}, "interval95": {"nrmse_test": {"sp": [None, None]}}}
    table = kept(section(document).parts, PageTable)[0]
    assert table.rows[0][0].endswith("100 to test in 1 block")
    assert table.rows[0][2].endswith("\ntoo few")
    assert rows[1][2].endswith("[0.31, 0.37]")


def test_intervals_are_explained_where_they_are_shown():
    parts = section(comparison()).parts
    notes = [p.text for p in kept(parts, Note)]
    assert any("with few blocks an interval may begin at" in text for text in notes)
