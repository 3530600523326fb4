"""`data import-cme`."""

from __future__ import annotations

import json
from functools import partial

import pytest
from cme_models import ENDING, record, train


@pytest.fixture
def run(call):
    return partial(call, "data", "import-cme")


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    """Models of two rings: every second sample of one recording, every third of another."""
    folder = tmp_path_factory.mktemp("models")
    stays = ((10, 210), (231, 400), (404, 600))
    train(record(1, stays).rows(2), folder, ring=1)
    train(record(2, stays).rows(3), folder, ring=4)
    return folder


def test_the_document_describes_each_ring(run, models, tmp_path):
    code, out, err = run(models, "-o", tmp_path / "out", "--json")
    document = json.loads(out)
    assert (code, err) == (0, f"wrote ring1.csv, ring4.csv to {tmp_path / 'out'}\n")
    assert list(document) == ["ring1", "ring4"]
    for ring, step in (("ring1", 2), ("ring4", 3)):
        got, rows = document[ring], (tmp_path / "out" / f"{ring}.csv").read_text().splitlines()[1:]
        assert got["file"] == str(tmp_path / "out" / f"{ring}.csv")
        assert got["source"] == "data_X_f_acc_SP" + ENDING.format(ring[-1])
        assert (got["step"], got["segments"]) == (step, 3)
        assert sum(row.split(",")[3] == "1" for row in rows) == got["published"]
        assert len(rows) == got["published"] + got["recovered"]
        assert len({row.split(",")[1] for row in rows}) == got["segments"]
        assert {row.split(",")[0] for row in rows} == {ring[-1]}
        assert got["noise"] > got["noise_variance"] > 0.0


def test_nothing_is_written_if_one_ring_cannot_be_read(refused, models, tmp_path):
    broken = tmp_path / "models"
    broken.mkdir()
    assert f"{broken}: no model in this folder" in refused("data", "import-cme", broken, "-o", tmp_path / "out")
    for path in models.iterdir():
        (broken / path.name).write_bytes(path.read_bytes())
    (broken / ("w_hat_SP" + ENDING.format(4))).write_text("1 2 3")
    assert "got 3 numbers, expected finite ones, 7" in refused("data", "import-cme", broken, "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()
