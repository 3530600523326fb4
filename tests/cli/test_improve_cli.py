"""`improve` from the command line; what it does itself is in test_improve."""

from __future__ import annotations

import json
import re

import pytest
from commands import call as command
from commands import plain


@pytest.fixture
def call(monkeypatch, capsys):
    def run(*arguments, **how):
        return command(monkeypatch, capsys, "improve", *arguments, **how)

    return run


@pytest.fixture
def rounds(monkeypatch):
    """Stands in for the rounds; takes what they were asked for."""
    asked = {}
    navigation = {"runs": 2, "success": 2, "time_s": {"mean": 3.0}, "failures": {}, "planner_ms": {}, "tick_ms": {}}
    diagnosis = {"verdict": "effect_found", "sentence": "The model lacks x.", "effects": [], "model": "here/model"}

    def stand_in(rig, folder, options, **more):
        asked.update(rig=rig, folder=folder, options=options, **more)
        more["advance"](30, 60)
        more["tell"]("found [red]")
        more["advance"](60, 60)
        more["working"]("ring 1: stage")
        return [{"diagnosis": dict(diagnosis), "navigation": {"before": navigation, "after": dict(navigation)}}]

    monkeypatch.setattr("mazeplan.improve.improve", stand_in)
    return asked


def test_one_document_and_the_answer_only_after_the_verdict(call, rounds, tmp_path):
    code, out, err = call(
        "--rig", "surprise", "--seed", "3", "--runs", "2", "--rounds", "2", "-o", tmp_path, "--json", terminal=True
    )
    assert code == 0, err
    document = json.loads(out)
    assert set(document) == {"rounds"}
    assert set(document["rounds"][0]) == {"diagnosis", "navigation"}
    assert set(document["rounds"][0]["navigation"]) == {"before", "after"}
    assert document["rounds"][0]["diagnosis"]["model"] == "here/model"
    assert rounds["rig"] == "surprise@3"
    assert (rounds["options"].rounds, rounds["options"].runs) == (2, 2)
    assert "the answer: table (tilt_offset)" in err
    assert "\nfound [red]\n" in plain(err)
    assert re.search(r"improving .* 30/60  left", plain(err))
    assert re.search(r"improving .* 0:00:00 +ring 1: stage", plain(err)), "how far that is nobody knows"


def test_in_words_and_no_path_to_what_is_not_kept(call, rounds):
    code, out, err = call("--rig", "toy", "--runs", "3")
    assert code == 1, "two of three arrived"
    assert err == ""
    assert "round 1: The model lacks x." in out
    assert "before  2 of 2 arrived, mean 3.00 s" in out
    assert "here/model" not in out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--rig", "nowhere"), "got rig 'nowhere', expected one of"),
        (("--rig", "toy@3"), "got @3, but there is no surprise in these settings"),
        (("--rig", "toy", "--model", "nowhere"), "no such model"),
        (("--rig", "toy", "--seconds", "0"), "--seconds: got 0, expected a finite number > 0"),
        (("--rig", "toy", "--reference", "nowhere.mcap"), "nowhere.mcap"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(call, arguments, message):
    code, out, err = call(*arguments)
    assert code == 2
    assert not out
    assert message in err
    assert "Traceback" not in err
