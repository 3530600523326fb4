"""Many runs: start angles, seeds, summary, and the same results for any number of workers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mazeplan.core.records import Failure, FailureKind, NavigationResult, RingPassage
from mazeplan.run.campaign.one_run import Campaign, start_angle
from mazeplan.run.commands.evaluate import results_of, summary


def outcome(success=True, time_s=3.0, failures=(), planner=1.0):
    spread = {"p50": planner, "p99": 2.0 * planner, "max": 3.0 * planner}
    reason = "arrived" if success else "out_of_time"
    return NavigationResult(
        success, reason, time_s, 0, "r", (RingPassage(1, time_s, None),), tuple(failures), 0, spread, None, spread
    )


def test_first_sixteen_starts_are_those_of_the_published_evaluation():
    first = sorted(start_angle(k) for k in range(16))
    assert first == pytest.approx([math.pi * k / 8 + math.pi / 16 for k in range(16)])
    assert start_angle(16) is None


@pytest.mark.parametrize("runs", range(1, 17))
def test_starts_of_any_number_of_runs_go_round_the_circle(runs):
    starts = sorted(start_angle(k) for k in range(runs))
    gaps = np.diff([*starts, starts[0] + math.tau])
    assert max(gaps) <= 2.0 * min(gaps) + 1e-9
    if runs in (1, 2, 4, 8, 16):
        assert gaps == pytest.approx([math.tau / runs] * runs)


@pytest.mark.slow
def test_results_do_not_depend_on_the_number_of_workers(tmp_path):
    patient = tmp_path / "patient.yaml"
    patient.write_text("travel: {deadline_ms: 1e6}\n")  # or plans would depend on how busy the machine is
    campaign = Campaign(runs=3, rig="toy", start=3, seed=7, settings=str(patient))
    finished = []

    def same(result):  # all but what the clock on the wall says
        return result.success, result.time_s, result.rings, result.failures, result.seed, result.replans

    alone = results_of(campaign, workers=1, progress=finished.append)
    assert finished == [1, 2, 3]
    assert [same(r) for r in results_of(campaign, workers=2)] == [same(r) for r in alone]
    assert [r.seed for r in alone] == [7, 8, 9]
    assert all(r.success for r in alone)


def test_summary_counts_and_times_only_those_that_arrived():
    stuck = Failure(FailureKind.STUCK, "Track", 1.0)
    runs = [outcome(time_s=2.0), outcome(time_s=4.0, failures=[stuck], planner=5.0), outcome(False, 20.0, [stuck])]
    document = summary(runs)
    assert (document["runs"], document["success"]) == (3, 2)
    assert document["time_s"] == {"mean": 3.0, "best": 2.0, "p50": 3.0, "p95": 3.9, "worst": 4.0}
    assert document["failures"] == {"stuck": 2}
    assert document["planner_ms"] == {"p50": 1.0, "p99": 10.0, "max": 15.0}
    assert len(document["results"]) == 3
