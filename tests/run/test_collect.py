"""Collecting: segments, safety, and tours that drive the ball from ring to ring."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from planar_rig import PATIENT, PlanarRig, known

from mazeplan.core.errors import LogError, RigError
from mazeplan.core.logs.run_log_reader import read_log
from mazeplan.core.logs.table import read_table
from mazeplan.maze.mapfile import load_map
from mazeplan.run import collect
from mazeplan.run.collect import (
    AWAY_S,
    EXCITE,
    STRETCH_S,
    Collection,
    openings_to_avoid,
    run_collection,
    run_tour,
)
from mazeplan.run.specification import Setup

MAZE = load_map("cme")
SETUP = Setup(MAZE, known(MAZE), rig_name="planar", settings=PATIENT)
RINGS = (1, 2, 3, 4, 5)


def test_each_placing_is_a_segment_and_time_goes_on(tmp_path):
    rig, log = PlanarRig(MAZE), tmp_path / "log.mcap"
    rows = run_collection(rig, MAZE, Collection(50.0, (1, 3), seed=2), log)
    table = read_table(log)
    assert rows == len(table) == 1500
    assert list(np.unique(table.segment)) == [0, 1, 2]
    assert np.all(np.diff(table["t"]) > 0.0)
    starts = np.flatnonzero(np.diff(table.segment, prepend=-1.0))
    assert [MAZE.ring_at(r) for r in table["r"][starts]] == [1, 3, 1]
    assert table["t"][starts[1]] == pytest.approx(STRETCH_S)
    assert rig.levelled
    assert rig.closed
    assert np.allclose(table["u_beta"], np.array(rig.commands)[:, 0])


def test_in_one_ring_the_ball_is_placed_once(tmp_path):
    log = tmp_path / "log.mcap"
    run_collection(PlanarRig(MAZE), MAZE, Collection(1.5 * STRETCH_S, (2,), seed=2), log)
    assert set(read_table(log).segment) == {0.0}


def test_a_sample_that_is_not_newer_is_answered_but_not_logged(tmp_path):
    class Twice(PlanarRig):
        def observe(self):
            sample = super().observe()
            k = len(self.commands)
            return replace(sample, t={10: sample.t - 1 / 30, 20: math.nan, 30: sample.t - 0.2}.get(k, sample.t))

    rig, log = Twice(MAZE), tmp_path / "log.mcap"
    rows = run_collection(rig, MAZE, Collection(2.0, (1,), seed=2), log)
    table = read_table(log)
    assert rows == len(table) == 60 - 3
    assert len(rig.commands) == 60
    assert np.all(np.diff(table["t"]) > 0.0)


def test_an_interrupted_collection_levels_closes_and_keeps_what_it_has(tmp_path):
    def fail(rig):
        if rig.t > 1.0:
            raise KeyboardInterrupt

    rig, log = PlanarRig(MAZE, mishap=fail), tmp_path / "log.mcap"
    with pytest.raises(KeyboardInterrupt):
        run_collection(rig, MAZE, Collection(50.0, (1,)), log)
    assert rig.levelled
    assert rig.closed
    assert 25 < len(read_table(log)) < 40


class NeverReady(PlanarRig):
    """A rig that cannot level its plate before its first reset."""

    def level(self):
        raise RigError("not ready")


def test_an_error_of_the_record_is_not_replaced_by_one_of_the_level_plate(tmp_path):
    rig, file = NeverReady(MAZE), tmp_path / "file"
    file.touch()
    with pytest.raises(LogError, match="cannot be written"):
        run_collection(rig, MAZE, Collection(5.0, (1,)), file / "log.mcap")
    assert rig.closed
    with pytest.raises(RigError, match="not ready"):
        run_collection(NeverReady(MAZE), MAZE, Collection(2.0, (1,)), tmp_path / "log.mcap")


class CountingRig(PlanarRig):
    resets = 0

    def reset(self, **more):
        self.resets += 1
        super().reset(**more)


def toured(path, seconds):
    """Rig, what the tour counted, log and table of a tour through all rings."""
    rig = CountingRig(MAZE)
    done = run_tour(rig, SETUP, Collection(seconds, RINGS, seed=3), path)
    return rig, done, read_log(path), read_table(path)


@pytest.fixture(scope="module")
def tour(tmp_path_factory):
    return toured(tmp_path_factory.mktemp("tour") / "log.mcap", 240.0)


@pytest.fixture(scope="module")
def short_tour(tmp_path_factory):
    """Too short for the rings to have their shares."""
    return toured(tmp_path_factory.mktemp("short") / "log.mcap", 120.0)


def stretches(log):
    """(kind, wanted ring, from, to) of each drive and each excitation."""
    found = [(e.t, e.kind, e.detail["ring"]) for e in log.events if e.kind in ("drive", "excite")]
    ends = [t for t, _, _ in found[1:]] + [math.inf]
    return [(kind, ring, t, end) for (t, kind, ring), end in zip(found, ends, strict=True)]


@pytest.mark.slow
def test_a_tour_places_the_ball_once_and_logs_all_in_one_segment(tour):
    rig, done, log, table = tour
    assert rig.resets == 1
    assert rig.levelled
    assert rig.closed
    assert log.complete
    assert done.rows == len(table) == 7200
    assert np.all(np.diff(table["t"]) > 0.0)
    assert set(table.segment) == {0.0}
    assert "segment" in table
    assert np.array_equal(np.stack([table["u_beta"], table["u_gamma"]], axis=1), np.array(rig.commands))


@pytest.mark.slow
def test_a_tour_gives_each_ring_its_share(tour):
    _, done, _, table = tour
    channels = [done.ring_s[ring] for ring in RINGS[:-1]]
    assert max(channels) < 2.0 * min(channels)
    assert 0.25 * min(channels) < done.ring_s[5] < min(channels)
    assert sum(done.ring_s.values()) == pytest.approx(240.0)
    measured = np.array([MAZE.ring_at(r) for r in table["r"]])
    for ring, time in done.ring_s.items():
        assert time == pytest.approx(np.mean(measured == ring) * 240.0, abs=3.0)
    assert done.changes == pytest.approx(np.count_nonzero(np.diff(measured)), abs=6)
    assert sum(done.passed.values()) == done.changes
    assert done.failed == 0


@pytest.mark.slow
def test_a_tour_drives_by_the_tree_and_excites_by_sines(short_tour):
    _, done, log, table = short_tour
    leaf, t = log.ticks["leaf"], log.ticks["t"]
    kinds = stretches(log)
    assert sum(kind == "drive" for kind, *_ in kinds) == done.drives >= 5
    for kind, wanted, begin, end in kinds:
        rows = (t > begin + 1e-9) & (t < end + 1e-9)
        if kind == "drive":
            assert EXCITE not in leaf[rows]
            assert {"Track", "PassOpening", "Settle"} & set(leaf[rows])
            if end < t[-1]:
                assert MAZE.ring_at(float(table["r"][rows][-1])) == wanted
        else:
            assert set(leaf[rows]) <= {EXCITE}  # of a last one there may be no row
            inside = np.array([MAZE.ring_at(r) == wanted for r in table["r"][rows]])
            away = np.count_nonzero(rows) - np.flatnonzero(inside).max(initial=0)
            assert away <= round((AWAY_S + 0.2) * 30)
            assert end - begin < STRETCH_S + 0.1 or not math.isfinite(end)
    assert any(end - begin < 15.0 for kind, _, begin, end in kinds if kind == "excite")  # some ended early


@pytest.mark.slow
def test_drives_that_fail_are_counted_and_the_sines_go_on(tmp_path, monkeypatch):
    floor = MAZE.ring(1).inner_radius + MAZE.ball.radius - 1e-3

    def fence(rig):  # no way out of ring 1
        r = math.hypot(rig.z[0], rig.z[1])
        if r < floor:
            rig.z[:2] *= floor / r
            rig.z[2:4] = 0.0

    rig = PlanarRig(MAZE, mishap=fence)
    for name, seconds in (("STRETCH_S", 4.0), ("AWAY_S", 1.0), ("DRIVE_S", 3.0)):
        monkeypatch.setattr(collect, name, seconds)
    done = run_tour(rig, SETUP, Collection(30.0, (1, 2), seed=1), tmp_path / "log.mcap")
    log = read_log(tmp_path / "log.mcap")
    assert done.rows == 900
    assert done.failed >= 4
    assert done.failed >= done.drives - 1
    assert (done.changes, done.ring_s[2]) == (0, 0.0)
    gave_up = [e for e in log.events if e.kind == "drive_failed"]
    assert len(gave_up) == done.failed
    assert all(e.detail["ring"] == 2 for e in gave_up)
    lengths = [end - begin for kind, _, begin, end in stretches(log) if kind == "drive" and math.isfinite(end)]
    assert max(lengths) < 3.1
    assert np.mean(log.ticks["leaf"] == EXCITE) > 0.2
    closed = [e.detail["closed"] for e in log.events if e.kind == "drive"]
    assert closed[0] == closed[1] == []  # right after a failure all may be tried
    assert rig.closed


def test_openings_passed_often_or_that_refused_the_ball_are_left_alone():
    names = [opening.name for opening in MAZE.openings_between(1, 2)]
    passed = {opening.name: 0 for opening in MAZE.openings}
    assert openings_to_avoid(MAZE, passed, set(), 1) == ()
    passed[names[0]], passed[names[1]] = 2, 1
    assert openings_to_avoid(MAZE, passed, set(), 1) == (names[0],)
    assert openings_to_avoid(MAZE, passed, set(), 2) == ()
    assert set(openings_to_avoid(MAZE, passed, {names[2]}, 1)) == {names[0], names[2]}
    assert set(openings_to_avoid(MAZE, passed, {names[2], names[3]}, 1)) == {
        names[2],
        names[3],
    }  # the others are even now
    assert openings_to_avoid(MAZE, passed, set(names), 1) == ()
    passed["4-5@180"] = 50  # the only one of its wall
    assert openings_to_avoid(MAZE, passed, set(), 1) == (names[0],)
