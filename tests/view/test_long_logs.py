"""Logs of an hour: what is read when one is opened, and that what is shown later is the same."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from planar_rig import PlanarRig
from test_plots import FakeGui

from mazeplan.apps.view.plots import SHOWN_S, ReplayPlots
from mazeplan.apps.view.replay import logged_moments
from mazeplan.apps.view.replay.logged_moments import BLOCK, KEPT, LEAD, WHOLE, turns
from mazeplan.apps.view.replay.recorded import open_recording
from mazeplan.core.errors import LogError
from mazeplan.core.events import FailureReported
from mazeplan.core.logs import chunks
from mazeplan.core.logs.run_log import RunLogWriter
from mazeplan.core.logs.run_log_reader import read_attachment, read_log
from mazeplan.core.records import Command, Observation
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.mapfile import load_map
from mazeplan.run.execution import run_job
from mazeplan.run.specification import Job, Setup

MAZE = load_map("cme")
RATE, TURN_S = 30.0, 8.0


def rolling(path, ticks, begin=0.0) -> str:
    """A log of a ball that goes round and round, with a failure in the middle and its result."""
    with RunLogWriter(path, {"goal_ring": 5}) as log:
        for k in range(ticks):
            t = begin + k / RATE
            angle, gamma = 2.0 * np.pi * t / TURN_S, 0.02 * (1.0 + 0.01 * t) * np.sin(t)
            log.sample(Observation(t, 0.08 * np.cos(angle), 0.08 * np.sin(angle), 0.0, gamma), Command(0.0, 0.0))
            if k == ticks // 2:
                log.event(t, FailureReported("stuck", "Track", "no way"))
        log.result({"success": True, "reason": "arrived", "time_s": begin + ticks / RATE})
    return str(path)


@pytest.fixture(scope="module")
def long(tmp_path_factory):
    """A log that is not read as a whole."""
    return rolling(tmp_path_factory.mktemp("long") / "long.mcap", 2 * WHOLE)


@pytest.fixture
def work(monkeypatch):
    """Counts chunks that are unpacked and messages that are decoded."""
    counted = {"_unpacked": 0, "_document": 0}

    def counting(name):
        do = getattr(chunks, name)

        def counted_too(data):
            counted[name] += 1
            return do(data)

        return counted_too

    for name in counted:
        monkeypatch.setattr(chunks, name, counting(name))
    return counted


@pytest.mark.slow
def test_opening_unpacks_a_long_log_once_and_decodes_what_is_shown_first(long, work, tmp_path):
    recording = open_recording(long)
    assert len(recording.moments) == 2 * WHOLE
    every = work["_unpacked"]
    assert work["_document"] < BLOCK + 50
    once = 2 * WHOLE / (chunks_per_s() * RATE)
    assert every < 1.2 * once
    work.update(dict.fromkeys(work, 0))
    open_recording(rolling(tmp_path / "double.mcap", 4 * WHOLE))
    assert work["_document"] < BLOCK + 50
    assert work["_unpacked"] < 2.2 * once


def chunks_per_s() -> float:
    """Ticks of a chunk are those of a quarter of a second and one."""
    return 8 / RATE


def test_a_short_log_is_decoded_once(work, tmp_path):
    path = rolling(tmp_path / "short.mcap", 300)
    open_recording(path)
    assert work["_document"] <= 300 + 3 * 3  # header, event and result are looked at first


def test_what_is_jumped_to_is_read_for_it_and_what_was_seen_is_kept(long, work):
    recording = open_recording(long)
    work["_document"] = 0
    assert recording.moments[-1].result == recording.result
    assert 0 < work["_document"] <= BLOCK + LEAD + 20
    work["_document"] = 0
    assert recording.at(recording.times[-5]).tick == 2 * WHOLE - 4
    assert recording.at(0.0).tick == 1
    assert work["_document"] == 0
    for block in range(1, KEPT + 1):
        _ = recording.moments[block * BLOCK]
    assert work["_document"] > 0
    work["_document"] = 0
    _ = recording.moments[BLOCK]
    assert work["_document"] == 0
    _ = recording.moments[0]  # that was forgotten
    assert work["_document"] > 0


def test_a_long_log_shows_what_a_short_one_shows(tmp_path, monkeypatch):
    path = tmp_path / "run.mcap"
    run_job(PlanarRig(MAZE), Setup(MAZE, RigModel.nominal(MAZE)), Job(2, 5, 0.3), log=path)
    whole = open_recording(path)
    monkeypatch.setattr(logged_moments, "WHOLE", 0)
    monkeypatch.setattr(logged_moments, "BLOCK", 10)
    monkeypatch.setattr(logged_moments, "LEAD", 15)
    parts = open_recording(path)
    assert whole.moments.whole
    assert not parts.moments.whole
    assert len(parts.moments) == len(whole.moments) > 60
    np.testing.assert_allclose(parts.times, whole.times, atol=1e-8)
    assert (parts.failures, parts.notes, parts.outcome) == (whole.failures, whole.notes, whole.outcome)
    for a, b in zip(whole.moments, parts.moments, strict=True):
        same = ("run", "tick", "t", "task", "ball", "tilt", "openings", "tree", "failure", "events", "result")
        assert [getattr(a, name) for name in same] == [getattr(b, name) for name in same]
        assert (a.plan is None) == (b.plan is None)
        if a.plan is not None and b.plan is not None:
            np.testing.assert_array_equal(a.plan.places, b.plan.places)
        newest = slice(-min(15, len(b.rows)), None)
        np.testing.assert_array_equal(np.isnan(a.rows[newest]), np.isnan(b.rows[newest]))
        apart = np.nan_to_num(a.rows[newest] - b.rows[newest])  # of angles by whole turns
        np.testing.assert_allclose(np.sin(0.5 * apart), 0.0, atol=1e-9)
    for name in ("u_beta", "theta", "planned_theta"):
        np.testing.assert_allclose(parts.column(name), whole.column(name), atol=1e-9)
        np.testing.assert_allclose(parts.column(name, 15, 55), whole.column(name)[15:55], atol=1e-9)


def test_an_angle_goes_on_where_blocks_meet(long):
    theta = open_recording(long).column("theta", BLOCK - 40, 3 * BLOCK + 40)
    assert len(theta) == 2 * BLOCK + 80
    np.testing.assert_allclose(np.diff(theta), 2.0 * np.pi / TURN_S / RATE, atol=1e-6)


def test_whole_turns_are_found_over_gaps():
    theta = np.array([3.1, np.nan, -3.1, -3.0, np.nan, 3.2, 3.3])
    np.testing.assert_allclose(theta - turns(theta), [3.1, np.nan, 3.18, 3.28, np.nan, 3.2, 3.3], atol=0.01)


def test_a_long_log_that_was_cut_is_shown_as_far_as_it_goes(long, tmp_path):
    cut, data = tmp_path / "cut.mcap", Path(long).read_bytes()
    cut.write_bytes(data[: 3 * len(data) // 4])
    recording = open_recording(cut)
    assert WHOLE < len(recording.moments) < 2 * WHOLE
    assert recording.moments[-1].t == pytest.approx(recording.times[-1])
    assert recording.notes[0].startswith("The log was cut off")


def test_a_long_log_that_is_damaged_anywhere_is_refused_at_once(long, tmp_path):
    spoilt, data = tmp_path / "spoilt.mcap", bytearray(Path(long).read_bytes())
    data[len(data) // 2] ^= 16
    spoilt.write_bytes(data)
    with pytest.raises(LogError, match="damaged"):
        open_recording(spoilt)


def test_a_log_that_changes_behind_the_page_is_told_in_one_line(tmp_path):
    path = tmp_path / "run.mcap"
    rolling(path, WHOLE + 900)
    recording = open_recording(path)
    path.write_bytes(path.read_bytes()[:4000])
    with pytest.raises(LogError, match=r"run\.mcap: was changed") as told:
        _ = recording.moments[-1]
    assert "\n" not in str(told.value)
    path.unlink()
    with pytest.raises(LogError, match=r"was changed: .*No such file"):
        _ = recording.moments[-1]


def server() -> Any:
    """Of viser what plots use."""
    return SimpleNamespace(gui=FakeGui())


def test_curves_of_a_long_run_follow_the_time(long, work):
    page = server()
    plots = ReplayPlots(page, [open_recording(long)])
    assert work["_document"] < 3 * BLOCK + 50
    gamma = page.gui.plots[1]
    for t in (2.0, 100.0, 355.0):
        plots.show(t, t)
        time, _, measured, _ = gamma.data
        assert time[0] <= t <= time[-1]
        assert time[-1] - time[0] == pytest.approx(SHOWN_S, abs=0.1)
        low, high = gamma.scales["y"]["range"]
        assert low <= np.nanmin(measured)
        assert np.nanmax(measured) <= high
        assert high - low < 2.0 * (np.nanmax(measured) - np.nanmin(measured))


def test_a_run_beside_a_longer_one_has_no_curve_after_its_end(long, tmp_path):
    other = rolling(tmp_path / "other.mcap", 300, begin=1.0)
    page = server()
    plots = ReplayPlots(page, [open_recording(long), open_recording(other)])
    for t, known in ((5.0, True), (200.0, False)):
        plots.show(t, t)
        _, a, b, _ = page.gui.plots[1].data
        assert np.isfinite(a).any()
        assert np.isfinite(b).any() == known


def test_other_readers_read_a_log_once_too(long, work):
    log = read_log(long)
    assert len(log.ticks["t"]) == 2 * WHOLE
    assert work["_unpacked"] < 1.2 * 2 * WHOLE / (chunks_per_s() * RATE)
    work["_unpacked"] = 0
    assert read_attachment(log.path, "none") is None
    assert work["_unpacked"] == 0
