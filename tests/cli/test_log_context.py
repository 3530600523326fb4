"""The rig and map of a record: those given, else those of its log."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pytest

from mazeplan.apps.cli.diagnose_rig import diagnose_rig
from mazeplan.apps.cli.diagnose_ring import diagnose_ring, separating_commands
from mazeplan.apps.cli.diagnosis_request import DiagnosisRequest
from mazeplan.apps.cli.log_context import collect_options, logged_map
from mazeplan.core.errors import InputError, ShortWarning
from mazeplan.core.logs.run_log import RunLogWriter, read_log
from mazeplan.diagnosis.ring.ambiguity import experiment_for
from mazeplan.maze.mapfile import dump_map, load_map, packaged_maps

CME, SEVEN = dump_map(load_map("cme")), dump_map(load_map("seven"))
OTHER = next(name for name in packaged_maps() if name != "cme")


def log(folder, **header):
    path = folder / "log.mcap"
    with RunLogWriter(path, {"program": "mazeplan", **header}):
        pass
    return path


@pytest.mark.parametrize(
    ("name", "header", "expected", "known"),
    [(None, {"map": SEVEN}, "seven", True), ("lopsided", {"map": SEVEN}, "lopsided", True), (None, {}, "cme", False)],
)
@pytest.mark.filterwarnings("ignore:.*used with --map")
def test_the_map_is_the_given_one_else_that_of_the_log_else_cme(tmp_path, name, header, expected, known):
    found = logged_map(name, tmp_path / "table.csv", log(tmp_path, **header))
    assert (found.maze, found.known) == (load_map(expected), known)
    assert found.text == (SEVEN if expected == "seven" else Path(str(load_map(expected).source)).read_text())


def test_logs_of_two_maps_are_no_record_of_one_rig(tmp_path):
    both = [log(tmp_path, map=SEVEN).rename(tmp_path / "a.mcap"), log(tmp_path, map=CME)]
    with pytest.raises(
        InputError, match=r"log\.mcap: recorded on the map .*, but .*a\.mcap on .*; expected logs of one"
    ):
        logged_map(None, *both)
    assert logged_map(None, both[0], both[0]).maze == load_map("seven")


def test_a_log_is_known_by_its_content_under_any_name(tmp_path):
    path = log(tmp_path, map=SEVEN, rig="toy").rename(tmp_path / "LOG.MCAP")
    assert logged_map(None, path).maze == load_map("seven")
    assert collect_options(path, None)[0] == ["--rig", "toy", "--map", "seven"]


def test_maps_of_one_name_are_told_apart_by_their_plates(tmp_path):
    cme = load_map("cme")
    first, *others = cme.openings
    turned = replace(cme, openings=(replace(first, angle=first.angle + 0.1), *others))
    both = [log(tmp_path, map=dump_map(turned)).rename(tmp_path / "a.mcap"), log(tmp_path, map=CME)]
    with pytest.raises(InputError, match=r"log\.mcap: recorded on another map cme, but .*a\.mcap on cme; expected"):
        logged_map(None, *both)
    with pytest.warns(ShortWarning, match=r"a\.mcap: recorded on another map cme, used with --map cme"):
        logged_map("cme", *both)
    mine = replace(cme, name="mine", balls=2, openings=(replace(first, closed=True), *others))
    again = log(tmp_path, map=dump_map(mine)).rename(tmp_path / "b.mcap")
    assert logged_map(None, again, log(tmp_path, map=CME)).maze == mine


@pytest.mark.parametrize("option", ["logs", "test", "references"])
def test_all_logs_of_a_diagnosis_are_of_one_map(tmp_path, option):
    first, other = log(tmp_path, map=SEVEN).rename(tmp_path / "a.mcap"), log(tmp_path, map=CME)
    none: Any = dict.fromkeys(field.name for field in fields(DiagnosisRequest))
    given = {"logs": [first], "references": []}
    more = {"logs": [first, other], "test": other, "references": [other]}
    request = DiagnosisRequest(**(none | given | {option: more[option]}))
    with pytest.raises(InputError, match=r"log\.mcap: recorded on the map cme, but .*a\.mcap on seven"):
        diagnose_rig([], request)


@pytest.mark.parametrize(
    ("header", "map_", "options", "words"),
    [
        ({"rig": "toy", "map": CME}, None, ["--rig", "toy"], ""),
        ({"rig": "toy", "map": CME}, "x.yaml", ["--rig", "toy", "--map", "x.yaml"], ""),
        ({"rig": "leaning", "rig_given": "runs/leaning.yaml", "map": CME}, None, ["--rig", "runs/leaning.yaml"], ""),
        ({"rig": "leaning", "map": CME}, None, ["--rig", "YOUR_RIG"], "which the log calls leaning"),
        ({"rig": "toy", "map": dump_map(load_map(OTHER))}, None, ["--rig", "toy", "--map", OTHER], ""),
        ({"rig": "toy", "map": CME.replace("18", "19", 1), "map_given": "my/maze.yaml"}, None,
         ["--rig", "toy", "--map", "my/maze.yaml"], ""),
    ],
)  # fmt: skip
def test_options_of_collect_are_those_of_the_log(tmp_path, header, map_, options, words):
    found, note = collect_options(log(tmp_path, **header), map_)
    assert found == options
    assert words in note
    assert bool(words) == bool(note)


def test_a_table_names_no_rig(tmp_path):
    given = ["--rig", "YOUR_RIG"], "YOUR_RIG is the rig of this record"
    assert collect_options(tmp_path / "table.csv", None) == given


def test_commands_that_separate_effects_use_the_same_rig(tmp_path):
    way = experiment_for(("constant_torque", "dry_friction"), 1)
    (worn,) = separating_commands([way], log(tmp_path, rig="my rig", rig_given="my rig.yaml", map=CME), None)
    assert worn["command"].startswith("mazeplan collect --rig 'my rig.yaml' --ring ring1 --seconds 300 --tilt 1")
    (unknown,) = separating_commands([way], tmp_path / "table.csv", None)
    assert unknown["note"] == "YOUR_RIG is the rig of this record"


def test_collect_logs_the_given_names_of_rig_and_map(call, tmp_path):
    rig, path = tmp_path / "leaning.yaml", tmp_path / "x.mcap"
    rig.write_text("table_x_deg: 1.5\n")
    code, _, err = call("collect", "-o", path, "--seconds", "1", "--rig", rig)
    assert code == 0, err
    assert read_log(path).header["rig_given"] == str(rig)
    assert collect_options(path, None)[0] == ["--rig", str(rig)]


def test_the_further_record_of_one_ring_is_of_the_same_map(tmp_path):
    first, other = log(tmp_path, map=SEVEN).rename(tmp_path / "a.mcap"), log(tmp_path, map=CME)
    none: Any = dict.fromkeys(field.name for field in fields(DiagnosisRequest))
    with pytest.raises(InputError, match=r"log\.mcap: recorded on the map cme, but .*a\.mcap on seven"):
        diagnose_ring(first, DiagnosisRequest(**(none | {"logs": [first], "ring": 2, "test": other})))
