"""A command that would record more names the rig and the map of the record that there is."""

from __future__ import annotations

import pytest
from commands import call

from mazeplan.cli.machine import machine_options
from mazeplan.data.runlog import RunLogWriter, read_log
from mazeplan.diagnosis.ambiguity import experiment_for, on_machine
from mazeplan.maze.mapfile import dump_map, load_map, packaged_maps

CME = dump_map(load_map("cme"))
OTHER = next(name for name in packaged_maps() if name != "cme")


def log(folder, **header):
    path = folder / "log.mcap"
    with RunLogWriter(path, {"program": "mazeplan", **header}):
        pass
    return path


@pytest.mark.parametrize(
    ("header", "options", "words"),
    [
        ({"rig": "toy", "map": CME}, ["--rig", "toy"], ""),
        ({"rig": "surprise@4", "map": CME}, ["--rig", "surprise@4"], ""),
        ({"rig": "leaning", "rig_given": "runs/leaning.yaml", "map": CME}, ["--rig", "runs/leaning.yaml"], ""),
        ({"rig": "leaning", "map": CME}, ["--rig", "YOUR_RIG"], "which the log calls leaning"),
        ({"rig": "toy", "map": dump_map(load_map(OTHER))}, ["--rig", "toy", "--map", OTHER], ""),
        ({"rig": "toy", "map": CME.replace("18", "19", 1), "map_given": "my/maze.yaml"},
         ["--rig", "toy", "--map", "my/maze.yaml"], ""),
    ],
)  # fmt: skip
def test_they_are_those_of_the_log(tmp_path, header, options, words):
    found, note = machine_options(log(tmp_path, **header), None)
    assert found == options
    assert words in note
    assert bool(words) == bool(note)


def test_a_map_that_is_given_goes_before_that_of_the_log_and_a_table_tells_of_no_rig(tmp_path):
    assert machine_options(log(tmp_path, rig="toy", map=CME), "x.yaml")[0] == ["--rig", "toy", "--map", "x.yaml"]
    options, note = machine_options(tmp_path / "table.csv", None)
    assert options == ["--rig", "YOUR_RIG"]
    assert note == "YOUR_RIG is the rig of this record"


def test_they_stand_in_the_command():
    (way,) = on_machine([experiment_for(("constant_torque", "dry_friction"), 1)], ["--rig", "my rig.yaml"], "why")
    assert way["command"].startswith("mazeplan collect --rig 'my rig.yaml' --ring ring1 --seconds 300 --tilt 1")
    assert way["note"] == "why"


def test_collect_writes_down_what_a_person_called_rig_and_map(monkeypatch, capsys, tmp_path):
    (tmp_path / "leaning.yaml").write_text("table_x_deg: 1.5\n")
    path = tmp_path / "x.mcap"
    code, _, err = call(
        monkeypatch, capsys, "collect", "-o", path, "--seconds", "1", "--rig", tmp_path / "leaning.yaml"
    )
    assert code == 0, err
    assert read_log(path).header["rig_given"] == str(tmp_path / "leaning.yaml")
    assert machine_options(path, None)[0] == ["--rig", str(tmp_path / "leaning.yaml")]


def test_diagnose_proposes_a_command_for_the_same_rig(monkeypatch, tmp_path):
    from mazeplan.cli import diagnose as module

    told = []
    document = {"ring": 1, "declared": {}, "notes": [], "separate_by": [experiment_for(("a", "b"), 1)]}
    monkeypatch.setattr(module, "_of_ball", lambda *given: (None, document))
    monkeypatch.setattr(module, "finish", lambda done, document, *more: told.append(document))
    module.diagnose([log(tmp_path, rig="worn", map=CME)], ring=1, system="ring", output=None)
    (way,) = told[0]["separate_by"]
    assert way["command"] == "mazeplan collect --rig worn --ring ring1 --seconds 900 -o apart.mcap"
