from __future__ import annotations

import json
import re

import pytest
from cme_models import ENDING, record, train
from commands import call, plain
from typer.testing import CliRunner

from mazeplan.cli.data import app
from mazeplan.errors import InputError, ModelError


def run(*arguments):
    return CliRunner().invoke(app, ["import-cme", *map(str, arguments)], catch_exceptions=False)


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    """Models of two rings: every second sample of one recording, every third of another."""
    folder = tmp_path_factory.mktemp("models")
    stays = ((10, 210), (231, 400), (404, 600))
    train(record(1, stays).rows(2), folder, ring=1)
    train(record(2, stays).rows(3), folder, ring=4)
    return folder


def test_json_is_one_document_that_tells_each_ring(models, tmp_path):
    done = run(models, "-o", tmp_path / "out", "--json")
    told = json.loads(done.stdout)
    assert done.stderr == f"wrote ring1.csv, ring4.csv to {tmp_path / 'out'}\n"
    assert done.exit_code == 0
    assert list(told) == ["ring1", "ring4"]
    for ring, step in (("ring1", 2), ("ring4", 3)):
        got, rows = told[ring], (tmp_path / "out" / f"{ring}.csv").read_text().splitlines()[1:]
        assert got["file"] == str(tmp_path / "out" / f"{ring}.csv")
        assert got["source"] == "data_X_f_acc_SP" + ENDING.format(ring[-1])
        assert (got["step"], got["segments"]) == (step, 3)
        assert sum(row.split(",")[3] == "1" for row in rows) == got["published"]
        assert len(rows) == got["published"] + got["recovered"]
        assert len({row.split(",")[1] for row in rows}) == got["segments"]
        assert {row.split(",")[0] for row in rows} == {ring[-1]}
        assert got["noise"] > got["noise_variance"] > 0.0
        assert list(got["checks"]) == ["weights", "noise", "input_scales", "rate_filter", "acceleration"]
        assert all(0.0 <= value < 1e-5 for value in got["checks"].values())


def test_for_people_a_line_a_ring(models, tmp_path, monkeypatch, capsys):
    code, out, err = call(monkeypatch, capsys, "data", "import-cme", models, "-o", tmp_path, terminal=True)
    lines = out.splitlines()
    assert (code, len(lines)) == (0, 2)
    assert re.search(r"importing .* 100 %  left 0:00:00 ring 4", plain(err))
    assert plain(err).endswith(f"wrote ring1.csv, ring4.csv to {tmp_path}\n")
    assert lines[0].startswith("ring 1: ")
    for part in ("rows published (1 sample in 2)", "recovered, 3 segments; noise", "rate filter", "acceleration"):
        assert part in lines[0]
    assert "(1 sample in 3)" in lines[1]


def test_tables_are_overwritten_only_with_force(models, tmp_path):
    (tmp_path / "ring4.csv").write_text("precious")
    with pytest.raises(InputError, match=r"ring4.csv: exists already; give --force"):
        run(models, "-o", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["ring4.csv"]
    assert (tmp_path / "ring4.csv").read_text() == "precious"
    assert run(models, "-o", tmp_path, "--force").exit_code == 0
    assert (tmp_path / "ring4.csv").read_text().startswith("ring,segment,t,")


def test_nothing_is_written_when_one_ring_cannot_be_read(models, tmp_path):
    broken = tmp_path / "models"
    broken.mkdir()
    for path in models.iterdir():
        (broken / path.name).write_bytes(path.read_bytes())
    (broken / ("w_hat_SP" + ENDING.format(4))).write_text("1 2 3")
    with pytest.raises(ModelError, match="got 3 numbers, expected 7"):
        run(broken, "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_command_line_exits_2_with_one_line(tmp_path, capsys, monkeypatch):
    from mazeplan.cli import main

    monkeypatch.setattr("sys.argv", ["mazeplan", "data", "import-cme", str(tmp_path), "-o", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as caught:
        main()
    assert caught.value.code == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert f"{tmp_path}: no model in this folder" in said
