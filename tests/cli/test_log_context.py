"""The rig and map of a record: those given, else those of its log."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pytest

from mazeplan.core.errors import InputError, ShortWarning
from mazeplan.core.logs.run_log import RunLogWriter
from mazeplan.maze.mapfile import dump_map, load_map, packaged_maps
from mazeplan.run.commands.diagnose_rig import diagnose_rig
from mazeplan.run.commands.diagnose_ring import diagnose_ring
from mazeplan.run.commands.diagnosis_request import DiagnosisRequest
from mazeplan.run.commands.log_context import logged_map

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


def test_the_further_record_of_one_ring_is_of_the_same_map(tmp_path):
    first, other = log(tmp_path, map=SEVEN).rename(tmp_path / "a.mcap"), log(tmp_path, map=CME)
    none: Any = dict.fromkeys(field.name for field in fields(DiagnosisRequest))
    with pytest.raises(InputError, match=r"log\.mcap: recorded on the map cme, but .*a\.mcap on seven"):
        diagnose_ring(first, DiagnosisRequest(**(none | {"logs": [first], "ring": 2, "test": other})))
