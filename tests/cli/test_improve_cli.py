"""`improve`: options, output and exit status; its rounds are stood in for."""

from __future__ import annotations

import json
import re

import pytest
from commands import plain

from mazeplan.core.errors import InputError, RigError
from mazeplan.core.whole_file import whole_folder


@pytest.fixture
def asked(monkeypatch):
    """Arguments of the rounds, which are stood in for."""
    asked = {}
    navigation = {"runs": 2, "success": 2, "time_s": {"mean": 3.0}, "failures": {}, "planner_ms": {}, "tick_ms": {}}
    diagnosis = {"verdict": "effect_found", "sentence": "The model lacks x.", "effects": [], "advice": []}
    diagnosis["model"] = "here/model"

    def stand_in(loop, model, references):
        asked["loop"] = loop
        loop.advance(30, 60)
        loop.tell("found [red]")
        loop.advance(60, 60)
        loop.progress("ring 1: stage")
        return [{"diagnosis": dict(diagnosis), "navigation": {"before": navigation, "after": dict(navigation)}}]

    monkeypatch.setattr("mazeplan.run.commands.improve.do_rounds", stand_in)
    return asked


def test_json_prints_one_document(call, asked, tmp_path):
    given = ("--rig", "toy", "--seed", "3", "--runs", "2", "--rounds", "2", "-o", tmp_path, "--json")
    code, out, err = call("improve", *given, terminal=True)
    assert code == 0, err
    document = json.loads(out)
    assert set(document) == {"rounds"}
    assert set(document["rounds"][0]) == {"diagnosis", "navigation"}
    assert set(document["rounds"][0]["navigation"]) == {"before", "after"}
    assert document["rounds"][0]["diagnosis"]["model"] == "here/model"
    loop = asked["loop"]
    assert (loop.rig, loop.usual.seed, loop.rounds, loop.usual.runs) == ("toy", 3, 2, 2)
    assert "\nfound [red]\n" in plain(err)
    for words in (r"improving .*50%", r"improving .*ring 1: stage"):
        assert re.search(words, plain(err))


@pytest.mark.parametrize(("error", "kept"), [(InputError, []), (RigError, ["a.mcap"]), (KeyboardInterrupt, ["a.mcap"])])
def test_what_was_measured_is_kept_where_the_rig_fails(tmp_path, error, kept):
    folder = tmp_path / "out" / "round1"

    def fail():
        with whole_folder(folder):
            (folder / "model").mkdir()
            (folder / "a.mcap").touch()
            raise error("no more")

    with pytest.raises(error):
        fail()
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == kept
    assert (tmp_path / "out").exists() == bool(kept)
    assert not (folder / "model").exists()
