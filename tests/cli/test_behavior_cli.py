"""behavior check, show, list, palette; map show with the trail of a run."""

from __future__ import annotations

import json

import pytest
from commands import call as command

from mazeplan import resources
from mazeplan.behavior.registry import REGISTRY


@pytest.fixture
def call(monkeypatch, capsys):
    def run(*arguments):
        return command(monkeypatch, capsys, *arguments)

    return run


def test_check_names_every_bad_file(call, tmp_path):
    good = (resources.share("behaviors") / "navigate.xml").read_text(encoding="utf-8")
    (tmp_path / "good.xml").write_text(good, encoding="utf-8")
    (tmp_path / "bad.xml").write_text(good.replace("<Align ", "<Allign "), encoding="utf-8")
    code, out, err = call("behavior", "check", "navigate", str(tmp_path / "good.xml"))
    assert (code, out.count(": ok, ")) == (0, 2)
    code, out, err = call(
        "behavior", "check", str(tmp_path / "bad.xml"), str(tmp_path / "good.xml"), str(tmp_path / "no")
    )
    assert code == 2
    assert out.count(": ok, ") == 1
    lines = err.strip().splitlines()
    assert len(lines) == 2
    assert "bad.xml:" in lines[0]
    assert "did you mean Align?" in lines[0]


def test_check_and_list_for_programs(call, tmp_path):
    (tmp_path / "bad.xml").write_text("<root/>")
    code, out, err = call("behavior", "check", "navigate", str(tmp_path / "bad.xml"), "--json")
    good, bad = json.loads(out)
    assert (code, err) == (2, "")
    assert good == {"file": "navigate", "ok": True, "nodes": good["nodes"], "error": None}
    assert good["nodes"] > 20
    assert (bad["ok"], bad["nodes"]) == (False, None)
    assert "bad.xml:1" in bad["error"]
    code, out, _ = call("behavior", "list", "--json")
    document = json.loads(out)
    assert set(document["leaves"]) == set(REGISTRY)
    assert document["leaves"]["Align"]["ports"]["opening"] == {
        "type": "str", "direction": "in", "needed": True, "default": None, "what": "name of the opening",
        "allowed": None, "allowed_of_map": "openings",
    }  # fmt: skip
    assert {"Sequence", "SubTree"} <= set(document["control_nodes"])
    assert document["preconditions"] == ["_failureIf", "_successIf", "_skipIf", "_while"]


def test_show_list_and_palette(call, tmp_path):
    code, out, _ = call("behavior", "show", "navigate")
    assert code == 0
    assert "FailureIs kinds=missed_opening;stuck" in out
    picture = tmp_path / "tree.svg"
    assert call("behavior", "show", "-o", str(picture))[0] == 0
    assert picture.read_text().startswith("<?xml")
    assert call("behavior", "show", "-o", str(tmp_path / "tree.xyz"))[0] == 2
    _, out, _ = call("behavior", "list")
    for name in REGISTRY:
        assert f"{name}: " in out
    assert "opening (str, needed): name of the opening" in out
    assert "preconditions of any node: _failureIf, _successIf, _skipIf, _while" in out
    palette = tmp_path / "palette.xml"
    assert call("behavior", "palette", "-o", str(palette))[0] == 0
    assert call("behavior", "palette")[1] == palette.read_text()
    assert call("behavior", "palette", "-o", str(tmp_path / "no" / "x.xml"))[0] == 2


def test_map_show_draws_the_trail_of_a_run(call, tmp_path):
    log, plain, trail = tmp_path / "run.mcap", tmp_path / "plain.svg", tmp_path / "trail.svg"
    assert call("navigate", "--rig", "ideal", "--from", "ring3", "--log", str(log))[0] == 0
    assert call("map", "show", "-o", str(plain))[0] == 0
    told = call("map", "show", "--log", str(log), "-o", str(trail))
    assert (told[0], "another map" in str(told)) == (0, False)
    told = call("map", "show", "lopsided", "--log", str(log), "-o", str(tmp_path / "other.svg"))
    assert (told[0], "is of another map (cme)" in str(told)) == (0, True)
    assert trail.stat().st_size > plain.stat().st_size + 3000
    assert call("map", "show", "--log", str(tmp_path / "no.mcap"), "-o", str(trail))[0] == 2
