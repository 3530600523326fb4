"""Recorded runs: what a log gives to look at, and the time that goes through it."""

from __future__ import annotations

import numpy as np
import pytest
from planar_rig import PlanarRig

from mazeplan.apps.view.replay import Playback, head_html, open_recording
from mazeplan.apps.view.story import maze_of
from mazeplan.core.errors import LogError
from mazeplan.core.events import FailureReported, RecoveryChosen, RingEntered
from mazeplan.core.logs.run_log import RunLogWriter
from mazeplan.core.logs.run_log_reader import read_log
from mazeplan.core.records import Command, Observation
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.mapfile import load_map
from mazeplan.run.execution import run_job
from mazeplan.run.specification import Job, Setup

MAZE = load_map("cme")
LEVEL = Command(0.0, 0.0)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A log with its tree."""
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    run_job(PlanarRig(MAZE), Setup(MAZE, RigModel.nominal(MAZE)), Job(4, 5, 0.3), log=path)
    return path


def sampled(path, times, **header) -> None:
    """A log of samples at these times, as an older version might have left it."""
    with RunLogWriter(path, header) as log:
        for t in times:
            log.sample(Observation(t, 0.08, 0.01 * t, 0.0, 0.0), LEVEL)


def test_a_log_gives_a_moment_for_each_tick(run):
    log, recording = read_log(run), open_recording(run)
    assert (recording.name, maze_of(recording.moments[0].header), recording.complete) == ("run.mcap", MAZE, True)
    np.testing.assert_allclose(recording.times, log.ticks["t"])
    for k in (0, 7, len(log.ticks["t"]) - 1):
        moment = recording.moments[recording.tick_at(log.ticks["t"][k])]
        assert (moment.t, moment.tick) == (log.ticks["t"][k], k + 1)
        assert moment.tilt == (log.ticks["beta"][k], log.ticks["gamma"][k])
        statuses = [nodes for t, nodes in log.trees[-1].statuses if t <= moment.t + 1e-9]
        assert moment.tree.statuses == statuses[-1]
    last = len(recording.moments) - 1
    times = (-1.0, log.ticks["t"][3] + 0.01, 1e9)
    assert [recording.tick_at(t) for t in times] == [0, 3, last]


def test_a_log_that_was_cut_is_shown_as_far_as_it_goes(run, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(run.read_bytes()[: run.stat().st_size * 2 // 3])
    recording = open_recording(cut)
    assert 5 < len(recording.times) < len(open_recording(run).times)
    assert "cut off" in head_html(recording, 0.0)


def test_failures_are_marked(tmp_path):
    path = tmp_path / "bad.mcap"
    with RunLogWriter(path, {}) as log:
        log.sample(Observation(0.0, 0.08, 0.0, 0.0, 0.0), LEVEL)
        log.event(0.5, FailureReported("stuck", "Track", "no way in 1 s"))
        log.event(0.5, RecoveryChosen("shake"))
        log.event(0.9, FailureReported("ball_lost"))
        log.event(1.0, RingEntered(2))
        log.sample(Observation(1.2, None, None, 0.0, 0.0), LEVEL)
        log.result({"success": False, "reason": "time_limit", "time_s": 1.2})
    assert open_recording(path).failures[-1] == 0.9


def test_a_log_without_ticks_has_nothing_to_show(tmp_path):
    path = tmp_path / "empty.mcap"
    sampled(path, [])
    with pytest.raises(LogError, match="holds no tick"):
        open_recording(path)


# -- time -----------------------------------------------------------------------------------------------------------


def test_time_goes_on_with_its_speed_and_stops_at_the_end():
    player = Playback(0.0, 0.5)
    player.advance(1.0)
    assert player.t == 0.0
    player.toggle()
    player.advance(0.15)
    player.speed = 0.5
    player.advance(0.2)
    assert player.t == pytest.approx(0.25)
    player.advance(10.0)
    assert (player.t, player.playing) == (0.5, False)
    player.toggle()
    assert (player.t, player.playing) == (0.0, True)
    for wanted, got in ((0.33, 0.33), (-5.0, 0.0), (99.0, 0.5)):
        player.seek(wanted)
        assert (player.t, player.playing) == (got, False)
