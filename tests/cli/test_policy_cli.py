"""`policy train`, `show` and `export`, and `--policy`: what they print and what they refuse."""

from __future__ import annotations

import json

import pytest
from policies import hand_made

from mazeplan.control.policy import load_policy, save_policy


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_policy(hand_made(), "made")
    return tmp_path / "made"


@pytest.mark.slow
def test_a_policy_is_trained(call, folder):
    options = ("--rig", "ideal", "--rounds", "2", "--runs", "2", "--epochs", "1", "--seed", "3")
    code, out, _ = call("policy", "train", *options, "-o", "mine")
    first, second, wrote = out.splitlines()
    assert code == 0
    assert first.startswith("round 1: 2 of 2 arrived")
    assert second.startswith("round 2: ")
    assert wrote == "wrote mine/policy.yaml"
    facts = load_policy("mine").facts
    assert (facts["rig"], facts["rounds"], facts["seed"]) == ("ideal", 2, 3)


def test_a_run_follows_the_policy_with_the_tree_of_that_name(call, folder):
    code, out, _ = call("navigate", "--rig", "ideal", "--to", "ring3", "--policy", "made", "--json")
    result = json.loads(out)
    assert (code, result["reason"], result["planner_ms"]["max"]) == (0, "arrived", 0.0)
    code, out, _ = call("evaluate", "--rig", "ideal", "--to", "ring2", "--runs", "2", "--policy", "made", "--json")
    document = json.loads(out)
    assert (code, document["success"]) == (0, 2)
    assert (document["setup"]["behavior"], document["setup"]["policy"]) == ("policy", "made")
