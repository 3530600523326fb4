"""`behavior check`, `show`, `list` and `palette`; `map show` with the trail of a run."""

from __future__ import annotations

import json

import pytest

from mazeplan.behavior.registry import REGISTRY
from mazeplan.core import resources


def test_check_names_every_bad_file(call, tmp_path):
    good, bad, none = (str(tmp_path / name) for name in ("good.xml", "bad.xml", "no"))
    text = (resources.share("behaviors") / "navigate.xml").read_text(encoding="utf-8")
    (tmp_path / "good.xml").write_text(text, encoding="utf-8")
    (tmp_path / "bad.xml").write_text(text.replace("<Align ", "<Allign "), encoding="utf-8")
    code, out, _ = call("behavior", "check", "navigate", good)
    assert (code, out.count(": ok, ")) == (0, 2)
    code, out, err = call("behavior", "check", bad, good, none)
    assert (code, out.count(": ok, "), err.count("\n")) == (2, 1, 2)
    assert "bad.xml:" in err.splitlines()[0]
    assert "did you mean Align?" in err.splitlines()[0]


def test_check_and_list_for_programs(call, tmp_path):
    (tmp_path / "bad.xml").write_text("<root/>")
    code, out, err = call("behavior", "check", "navigate", str(tmp_path / "bad.xml"), "--json")
    good, bad = json.loads(out)
    assert (code, err) == (2, "")
    assert good == {
        "file": "navigate", "ok": True, "nodes": good["nodes"], "error": None, "errors": [], "warnings": [],
    }  # fmt: skip
    assert good["nodes"] > 20
    assert (bad["ok"], bad["nodes"]) == (False, None)
    assert "bad.xml:1" in bad["error"]
    document = json.loads(call("behavior", "list", "--json")[1])
    assert set(document["leaves"]) == set(REGISTRY)
    assert document["leaves"]["Align"]["ports"]["opening"] == {
        "type": "str", "direction": "in", "needed": True, "default": None, "what": "name of the opening",
        "allowed": None, "allowed_of_map": "openings",
    }  # fmt: skip
    assert {"Sequence", "SubTree"} <= set(document["control_nodes"])
    assert document["preconditions"] == ["_failureIf", "_successIf", "_skipIf", "_while"]


def test_show_list_and_palette(call, refused, tmp_path):
    assert "FailureIs kinds=missed_opening;stuck" in call("behavior", "show", "navigate")[1]
    palette = tmp_path / "palette.xml"
    out = call("behavior", "list")[1]
    assert all(f"{name}: " in out for name in REGISTRY)
    assert "opening (str, needed): name of the opening" in out
    assert "preconditions of any node: _failureIf, _successIf, _skipIf, _while" in out
    assert call("behavior", "palette", "-o", palette)[0] == 0
    assert call("behavior", "palette")[1] == palette.read_text()
    assert "expected a folder that can be made" in refused("behavior", "palette", "-o", palette / "x.xml")


@pytest.mark.slow
def test_map_show_draws_the_trail_of_a_run(call, refused, tmp_path):
    log, plain, trail = tmp_path / "run.mcap", tmp_path / "plain.svg", tmp_path / "trail.svg"
    assert call("navigate", "--rig", "ideal", "--from", "ring3", "--log", log)[0] == 0
    assert call("map", "show", "-o", plain)[0] == 0
    assert call("map", "show", "--log", log, "-o", trail) == (0, "", f"wrote {trail}\n")
    code, _, err = call("map", "show", "lopsided", "--log", log, "-o", tmp_path / "other.svg")
    assert (code, "recorded on another map, cme" in err) == (0, True)
    assert trail.stat().st_size > plain.stat().st_size + 3000
    refused("map", "show", "--log", tmp_path / "no.mcap", "-o", trail)
