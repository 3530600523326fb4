"""A run whose samples are broken now and then goes on; one whose samples stay broken ends, with a level plate."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from planar_rig import PATIENT, PlanarRig, known

from mazeplan.core.errors import RigError
from mazeplan.core.logs.run_log_reader import read_log
from mazeplan.maze.mapfile import load_map
from mazeplan.run.execution import run_job
from mazeplan.run.replay import replay
from mazeplan.run.specification import Job, Setup

MAZE = load_map("cme")
SETUP = Setup(MAZE, known(MAZE), rig_name="planar", settings=PATIENT)


class Garbled(PlanarRig):
    """`change(k, sample, last)` is what arrives of sample k."""

    def __init__(self, change):
        super().__init__(MAZE)
        self.change, self.k, self.last = change, 0, None

    def observe(self):
        sample = super().observe()
        arrives = self.change(self.k, sample, self.last)
        self.k, self.last = self.k + 1, sample
        return arrives


def go(change, **more):
    rig = Garbled(change)
    return run_job(rig, SETUP, Job(1, 5, 0.3), **more), rig


def now_and_then(k):
    return k % 9 in (4, 5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "what"),
    [
        (lambda k, sample, last: replace(sample, beta=math.nan) if now_and_then(k) else sample, "tilt"),
        (lambda k, sample, last: replace(sample, gamma=0.5 * (-1) ** k) if now_and_then(k) else sample, "tilt"),
        (lambda k, sample, last: replace(sample, x=math.nan, y=math.nan) if now_and_then(k) else sample, "position"),
        (lambda k, sample, last: replace(sample, x=85.0, y=3.0) if now_and_then(k) else sample, "far"),  # mm
        (lambda k, sample, last: replace(sample, t=math.nan) if now_and_then(k) else sample, "clock"),
        (lambda k, sample, last: last if now_and_then(k) else sample, "clock"),
    ],
)
def test_a_few_broken_samples_are_got_over_told_and_replayed_alike(change, what, tmp_path, monkeypatch):
    log = tmp_path / "run.mcap"
    result, rig = go(change, log=log)
    assert result.success
    assert {doubt.what for doubt in result.doubts} == {what}
    assert {"t": result.doubts[0].t, "what": what} == result.json()["doubts"][0]
    assert len(rig.commands) == rig.k  # each sample is answered, also one that says nothing
    if what != "clock":
        told = [event.detail["what"] for event in read_log(log).events if event.kind == "doubt"]
        assert told == [what] * len(result.doubts)
    outcome = replay(log, model=known(MAZE))
    assert outcome.identical, outcome.difference


def test_a_sample_that_is_not_newer_changes_nothing():
    plain, first = go(lambda k, sample, last: sample)
    waits: list = []

    class Twice(PlanarRig):
        def observe(self):
            if waits:
                return waits.pop()
            waits.append(super().observe())
            return waits[0]

    rig = Twice(MAZE)
    result = run_job(rig, SETUP, Job(1, 5, 0.3))
    assert (result.time_s, result.rings) == (plain.time_s, plain.rings)
    assert rig.commands[::2] == first.commands
    assert rig.commands[1::2] == rig.commands[::2][: len(rig.commands[1::2])]  # the same command once more


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda k, sample, last: replace(sample, gamma=math.nan) if k > 20 else sample, "tilt sensor"),
        (lambda k, sample, last: replace(sample, t=20 / 30) if k > 20 else sample, "clock does not go on"),
        (lambda k, sample, last: replace(sample, t=math.nan), "clock does not go on"),
    ],
)
def test_what_stays_broken_is_a_rig_that_failed_within_half_a_second(change, said, tmp_path):
    log = tmp_path / "run.mcap"
    rig = Garbled(change)
    with pytest.raises(RigError, match=said):
        run_job(rig, SETUP, Job(1, 5, 0.3), log=log)
    assert rig.levelled
    assert rig.k <= 21 + 15
    kept = read_log(log)
    assert kept.complete
    assert kept.result["reason"] == "rig_failed"
    assert kept.result["failures"][-1]["kind"] == "rig_failed"
