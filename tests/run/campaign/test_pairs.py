"""Two evaluations, seed by seed."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mazeplan.core.errors import InputError
from mazeplan.run.campaign.pairs import paired


def document(times, arrived=None, first=0, **setup):
    arrived = [True] * len(times) if arrived is None else arrived
    results = [
        {"seed": first + i, "success": bool(done), "time_s": float(time)}
        for i, (time, done) in enumerate(zip(times, arrived, strict=True))
    ]
    return {"results": results, "setup": {"start_ring": 1, "goal_ring": 5, **setup}}


def test_a_difference_that_is_the_same_in_each_pair_is_seen_through_a_large_spread():
    a = np.random.default_rng(0).uniform(3.0, 9.0, 40)
    done = paired(document(a), document(a - 0.31 + np.tile([-0.2, 0.2], 20))).json()
    low, high = done["time_s"]["interval"]
    assert done["time_s"]["difference"] == pytest.approx(-0.31, abs=1e-3)
    assert 0.5 * (high - low) == pytest.approx(2.0227 * 0.2 * np.sqrt(40 / 39) / np.sqrt(40), abs=1e-3)  # t of 39
    assert done["arrivals"] == {
        "a": 40, "b": 40, "difference": 0.0, "interval": pytest.approx([-0.066, 0.066], abs=2e-3),
        "only_a": 0, "only_b": 0, "p_value": 1.0,
    }  # fmt: skip
    assert done["sentence"].startswith("B is 0.31 s faster, 0.25 to 0.37; no more failures than chance")


def test_runs_that_did_not_arrive_count_as_arrivals_only():
    arrived = np.arange(30) < 20
    done = paired(document(np.full(30, 5.0)), document(np.where(arrived, 5.0, 20.0), arrived)).json()
    assert done["time_s"] == {"pairs": 20, "difference": 0.0, "interval": [0.0, 0.0]}
    assert done["arrivals"]["difference"] == pytest.approx(-1 / 3, abs=1e-4)
    assert done["arrivals"]["interval"][1] < 0.0
    assert done["arrivals"]["p_value"] == pytest.approx(2.0**-9, abs=1e-6)
    assert "fewer runs of B arrived" in done["sentence"]


def test_only_seeds_of_both_are_compared():
    done = paired(document([1.0, 2.0, 3.0]), document([2.5, 3.5, 9.0], first=1)).json()
    assert (done["pairs"], done["unpaired"]) == (2, 2)
    assert done["time_s"]["difference"] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("b", "said"),
    [
        (document([1.0], first=7), "no run with a seed"),
        (document([1.0, 2.0], goal_ring=3), "goal_ring 3, expected 5"),
        ({"results": [{"seed": 1}, {"seed": 1}]}, "each seed once"),
        ({"rounds": []}, "expected the output of `evaluate --json`"),
    ],
)
def test_evaluations_that_cannot_be_paired(b, said):
    with pytest.raises(InputError, match=said):
        paired(document([1.0, 2.0]), b)


def test_the_command_compares_two_files(monkeypatch, capsys, tmp_path):
    from commands import call

    files = [tmp_path / "a.json", tmp_path / "b.json"]
    for file, times in zip(files, ([5.0, 6.0, 7.0], [4.0, 5.1, 6.0]), strict=True):
        file.write_text(json.dumps(document(times)))
    code, out, _ = call(monkeypatch, capsys, "evaluate", "--compare", *files, "--json")
    found = json.loads(out)
    assert (code, found["a"], found["time_s"]["difference"]) == (0, str(files[0]), pytest.approx(-0.9667, abs=1e-3))
    assert call(monkeypatch, capsys, "evaluate", "--compare", *files)[1] == found["sentence"] + "\n"
