"""Runs that are kept: as they end, once, apart from those of other campaigns, and as they were."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from mazeplan.core.errors import InputError
from mazeplan.core.records import Doubt, Failure, FailureKind, GoalGiven, NavigationResult, RingPassage, Start
from mazeplan.run.campaign.one_run import Campaign, Ran
from mazeplan.run.campaign.store import open_stores, runs_table
from mazeplan.run.commands.evaluate import results_of

LIGHT = Campaign(runs=4, rig="mazeplan.apps.testing.lightrig:LightRig", start=4, seed=7, deadline=False)
SPREAD = {"p50": 0.1, "p99": 1.0 / 3.0, "max": 7.25}
FAILURE = Failure(FailureKind.STUCK, "Track", 0.1 + 0.2, "in ring 4", "shake", 1e-17, None)


def run(seed: int = 7, success: bool = True) -> NavigationResult:
    rings = (RingPassage(4, 1.0 / 3.0, "4-5@90"), RingPassage(5, 0.2, None))
    return NavigationResult(
        success, "arrived" if success else "stuck", 2.0 / 3.0, seed, "light", rings, (FAILURE,), 2, SPREAD, None,
        SPREAD, (GoalGiven(5, 0.0),), (Doubt("ball", 0.4),), Start(4, math.pi / 16),
    )  # fmt: skip


def same(result: NavigationResult) -> NavigationResult:
    """All but what the clock on the wall says."""
    return replace(result, planner_ms={}, tick_ms={})


def test_a_result_comes_back_to_the_last_bit():
    for result in (run(), replace(run(), start=None, failures=(), tick_ms={})):
        assert NavigationResult.from_json(json.loads(json.dumps(result.json()))) == result


def test_a_row_is_pleasant_to_read(tmp_path):
    with open_stores(tmp_path, [LIGHT]) as (store,):
        store.keep(1, Ran(run(8), None, 0.5, 0.125, "here:1"))
        store.keep(0, Ran(run(7, success=False), None, 0.25, 0.125, "here:2"))
        assert len(runs_table(tmp_path)) == 2  # while it is under way, too
    assert {path.name for path in tmp_path.glob("[!.]*")} == {f"campaign-{store.name}.jsonl", "runs.parquet"}
    table = pd.read_parquet(tmp_path / "runs.parquet")
    assert list(table["index"]) == [0, 1]
    assert list(table["seed"]) == [7, 8]
    assert table["success"].dtype == bool
    assert list(table["success"]) == [False, True]
    assert list(table["wall_s"]) == [0.25, 0.5]
    assert list(table["cpu_s"]) == [0.125, 0.125]
    one = table.iloc[0]
    assert (one["campaign"], one["rig"], one["map"], one["start_ring"], one["goal_ring"], one["time_limit_s"]) == (
        store.name, LIGHT.rig, "cme", 4, 5, 20.0,
    )  # fmt: skip
    assert (one["time_s"], one["start_theta"], one["reason"], one["replans"]) == (2.0 / 3.0, math.pi / 16, "stuck", 2)
    assert list(one["failures"]) == ["stuck"]
    assert list(one["recoveries"]) == ["shake"]
    assert list(one["rings"]) == [4, 5]
    np.testing.assert_array_equal(one["ring_s"], [1.0 / 3.0, 0.2])
    assert list(one["openings"]) == ["4-5@90", None]
    assert (one["planner_ms_p99"], one["tick_ms_max"]) == (1.0 / 3.0, 7.25)
    assert str(table["ended"].dtype) == "datetime64[ms, UTC]"
    assert json.loads(one["settings"])["leaves"]["travel"]["deadline_ms"] == 1e6
    assert json.loads(one["setup"])["seed"] == 7


@pytest.mark.slow
def test_the_same_campaign_goes_on_and_computes_nothing_twice(tmp_path):
    alone = results_of(LIGHT)
    begun = []
    with open_stores(tmp_path, [replace(LIGHT, runs=2)]) as (store,):
        results_of(replace(LIGHT, runs=2), store=store, progress=begun.append)
    with open_stores(tmp_path, [LIGHT]) as (store,):
        assert set(store.runs) == {0, 1}
        gone_on = results_of(LIGHT, store=store, progress=begun.append)
    assert begun == [1, 2, 3, 4]  # the third was the first that the second command did
    assert [same(result) for result in gone_on] == [same(result) for result in alone]
    with open_stores(tmp_path, [LIGHT]) as (store,):
        assert results_of(LIGHT, store=store, progress=begun.append) == gone_on
    assert len(begun) == 4
    assert list(runs_table(tmp_path)["index"]) == [0, 1, 2, 3]


def test_other_campaigns_stay_apart(tmp_path):
    other = replace(LIGHT, seed=8, start=3)
    with open_stores(tmp_path, [other]) as (store,):
        store.keep(0, Ran(run(8), None, 0.5, 0.125, "here:1"))
    with open_stores(tmp_path, [LIGHT]) as (store,):
        assert store.runs == {}
        store.keep(0, Ran(run(7), None, 0.5, 0.125, "here:1"))
    table = runs_table(tmp_path)
    assert table.groupby("campaign").size().tolist() == [1, 1]
    with open_stores(tmp_path, [other]) as (store,):
        assert [ran.result.seed for ran in store.runs.values()] == [8]


def test_a_line_that_a_killed_command_left_incomplete_is_made_again(tmp_path):
    with open_stores(tmp_path, [LIGHT]) as (store,):
        store.keep(0, Ran(run(7), None, 0.5, 0.125, "here:1"))
        store.keep(1, Ran(run(8), None, 0.5, 0.125, "here:1"))
    store.path.write_bytes(store.path.read_bytes()[:-9])
    assert list(runs_table(tmp_path)["index"]) == [0]
    with open_stores(tmp_path, [LIGHT]) as (store,):
        assert set(store.runs) == {0}
        store.keep(1, Ran(run(8), None, 0.5, 0.125, "here:1"))
    assert list(runs_table(tmp_path)["index"]) == [0, 1]


def test_folders_that_cannot_be_a_store_are_refused(tmp_path):
    (tmp_path / "file").touch()
    for wrong in (tmp_path, tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(InputError, match="--store"), open_stores(wrong, [LIGHT]):
            pass
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
