from __future__ import annotations

import json
import signal
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from mcap.data_stream import ReadDataStream
from mcap.reader import make_reader
from mcap.records import Chunk, Message
from mcap.stream_reader import breakup_chunk

from mazeplan.core.errors import LogError
from mazeplan.core.events import RingEntered, TimedEvent
from mazeplan.core.logs import run_log as runlog
from mazeplan.core.logs.run_log import RunLogWriter
from mazeplan.core.logs.run_log_reader import read_log
from mazeplan.core.records import Command, Observation, Plan, State, StopReason, TreeOutline

DT = 1.0 / 30.0
HEADER = {"rig": "toy", "map": "rings: []\n", "seed": 7}
STATE = State(0.1, 0.08, 0.01, 0.02, -0.03, 0.004, 0.05, -0.006, 0.07, ring=2)


def observation(k: int) -> Observation:
    return Observation(k * DT, 0.08 + 1e-4 * k, -1e-3 * k, 0.01, -0.02)


def plan(**changes) -> Plan:
    states = np.arange(18.0).reshape(3, 6) / 7.0
    controls = np.array([[0.01, -0.02], [0.03, 0.04]])
    whole = Plan(states, controls, np.zeros((2, 2, 6)), 13.1326, StopReason.CONVERGED, 9, 2.5, 0.2)
    return replace(whole, **changes)


def write_run(path, ticks: int = 5) -> None:
    with RunLogWriter(path, HEADER) as log:
        log.tree(0.0, TreeOutline(("root", "root/Track"), ("Sequence", "Track"), ("root", "Track"), (-1, 0)))
        log.statuses(0.0, "RR")
        log.openings(0.0, {"1-2@45": (1.0, 0.5)}, 120.0)
        log.event(0.0, RingEntered(1))
        for k in range(ticks):
            log.tick(observation(k), Command(0.01 * k, -0.01), STATE, leaf="Track", opening=None, tick_ms=0.5)
        log.plan(plan())
        log.result({"success": True, "time_s": 2.5})


def test_what_was_written_is_read_back(tmp_path):
    path = tmp_path / "new" / "folder" / "run.mcap"
    write_run(path)
    log = read_log(path)
    assert log.complete
    assert {key: log.header[key] for key in HEADER} == HEADER
    assert log.header["program"] == "mazeplan"
    assert log.ticks["t"].tolist() == [k * DT for k in range(5)]
    assert log.ticks["x"].tolist() == [observation(k).x for k in range(5)]
    assert log.ticks["u_beta"].tolist() == [0.01 * k for k in range(5)]
    assert log.ticks["leaf"].tolist() == ["Track"] * 5
    assert log.ticks["ring"].tolist() == [2.0] * 5
    for name in runlog.ESTIMATE:
        assert log.ticks[f"estimate_{name}"][0] == getattr(STATE, name)
    assert log.events == (TimedEvent(0.0, RingEntered(1)),)
    assert [(tree.outline.names, tree.statuses) for tree in log.trees] == [(("root", "Track"), ((0.0, "RR"),))]
    assert log.result == {"success": True, "time_s": 2.5}


def test_a_plan_keeps_its_trajectory_and_why_it_stopped(tmp_path):
    path = tmp_path / "run.mcap"
    write_run(path)
    (got,) = read_log(path).plans
    assert got.states == pytest.approx(plan().states, abs=1e-6)
    assert got.controls == pytest.approx(plan().controls, abs=1e-6)
    expected = {"t0": 0.2, "cost": 13.1326, "reason": "converged", "iterations": 9, "ms": 2.5}
    assert {key: getattr(got, key) for key in expected} == expected


def test_what_is_not_known_is_nan(tmp_path):
    path = tmp_path / "run.mcap"
    with RunLogWriter(path, {}) as log:
        log.sample(Observation(0.0, None, None, 0.01, float("nan")), Command(0.0, 0.0))
        log.sample(replace(observation(1), t=np.float64(DT)), Command(0.0, 0.0), segment=np.int64(3), leaf="Pass")
        log.plan(plan(states=np.full((3, 6), np.nan), cost=float("inf"), reason=StopReason.NOT_FINITE))
    got = read_log(path)
    assert np.isnan(got.ticks["x"]).tolist() == [True, False]
    assert np.isnan(got.ticks["gamma"]).tolist() == [True, False]
    assert got.ticks["segment"][1] == 3.0
    assert got.ticks["leaf"].tolist() == ["", "Pass"]
    assert got.plans[0].states.shape == (0, 6)
    assert np.isnan(got.plans[0].cost)
    assert got.result is None


def test_a_log_without_ticks_has_the_columns_that_every_log_has(tmp_path):
    path = tmp_path / "run.mcap"
    with RunLogWriter(path, {}):
        pass
    lengths = {name: len(column) for name, column in read_log(path).ticks.items()}
    assert lengths == dict.fromkeys(("t", "x", "y", "beta", "gamma", "u_beta", "u_gamma"), 0)


def test_log_time_is_rig_time_and_any_mcap_reader_can_read_it(tmp_path):
    path = tmp_path / "run.mcap"
    write_run(path, ticks=3)
    with path.open("rb") as stream:
        messages = list(make_reader(stream).iter_messages(topics=["/tick"], log_time_order=False))
    assert [message.log_time for _, _, message in messages] == [0, 33333333, 66666667]
    schema, channel, message = messages[1]
    assert schema is not None
    assert (channel.message_encoding, schema.encoding) == ("json", "jsonschema")
    assert json.loads(message.data)["t"] == DT


def test_messages_keep_to_their_schemas(tmp_path):
    path = tmp_path / "run.mcap"
    write_run(path)
    kinds = {"number": (int, float), "integer": int, "string": str, "boolean": bool, "array": list, "object": dict}
    seen = set()
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            fields = json.loads(schema.data)["properties"]
            seen.add(channel.topic)
            for name, value in json.loads(message.data).items():
                assert isinstance(value, kinds[fields[name]["type"]]), (channel.topic, name)
    assert seen == set(runlog.SCHEMAS)


CHILD = """
import sys
from mazeplan.core.logs.run_log import RunLogWriter
from mazeplan.core.records import Command, Observation, State
log = RunLogWriter(sys.argv[1], {"map": "x" * 20000})
state = State(0.0, 0.08, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, ring=1)
for k in range(200):
    log.tick(Observation(k / 30, 0.08, 0.0, 0.0, 0.0), Command(0.0, 0.0), state, leaf="Track")
    print(k, flush=True)
    if k == 120:
        sys.stdin.read()  # never ends: the parent kills here
"""


def test_after_kill_9_all_but_the_last_half_second_is_there(tmp_path):
    path = tmp_path / "killed.mcap"
    child = subprocess.Popen(
        [sys.executable, "-c", CHILD, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert child.stdout is not None
    for line in child.stdout:
        if int(line) == 120:
            break
    child.send_signal(signal.SIGKILL)
    child.communicate()
    assert child.returncode == -signal.SIGKILL
    log = read_log(path)
    assert not log.complete
    assert log.result is None
    assert 3.5 < log.ticks["t"][-1] <= 4.0
    assert np.diff(log.ticks["t"]) == pytest.approx(DT)


def chunks_of(path) -> list[tuple[int, int, int]]:
    """(first byte, byte behind it, ticks) of each chunk of a whole log."""
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
        assert summary is not None
        (tick,) = [channel.id for channel in summary.channels.values() if channel.topic == "/tick"]
        found = []
        for index in summary.chunk_indexes:
            stream.seek(index.chunk_start_offset + 9)  # behind operation code and length
            inside = breakup_chunk(Chunk.read(ReadDataStream(stream)))
            ticks = sum(isinstance(record, Message) and record.channel_id == tick for record in inside)
            found.append((index.chunk_start_offset, index.chunk_start_offset + index.chunk_length, ticks))
    return found


@pytest.mark.slow
def test_a_file_cut_at_any_byte_gives_all_whole_chunks(tmp_path):
    path = tmp_path / "run.mcap"
    write_run(path, ticks=30)
    whole, chunks = path.read_bytes(), chunks_of(path)
    assert sum(ticks for _, _, ticks in chunks) == 30
    assert max(ticks for _, _, ticks in chunks) <= 9
    told = chunks[0][1]  # where the header is over
    for cut in range(8, told, 97):
        path.write_bytes(whole[:cut])
        with pytest.raises(LogError, match="without the header"):
            read_log(path)
    for cut in range(told, len(whole) - 1, 13):
        path.write_bytes(whole[:cut])
        log = read_log(path)
        assert not log.complete
        assert len(log.ticks["t"]) == sum(ticks for _, end, ticks in chunks if cut >= end)


def test_zeros_at_the_end_after_a_power_cut_are_no_damage(tmp_path):
    path = tmp_path / "run.mcap"
    log = RunLogWriter(path, {})
    for k in range(20):
        log.sample(observation(k), Command(0.0, 0.0))
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes() + bytes(4096))
    log.close()
    got = read_log(cut)
    assert len(got.ticks["t"]) == 18  # two chunks of 9
    assert not got.complete


def test_a_changed_byte_is_never_read_as_a_measurement(tmp_path):
    path = tmp_path / "run.mcap"
    write_run(path, ticks=20)
    whole, chunks = path.read_bytes(), chunks_of(path)
    rng = np.random.default_rng(1)
    for at in rng.integers(chunks[1][0], chunks[-1][1], 150):
        changed = bytearray(whole)
        changed[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(changed)
        with pytest.raises(LogError, match="damaged") as caught:
            read_log(path)
        assert "\n" not in str(caught.value)


def test_a_changed_byte_in_a_log_that_was_cut_is_found_too(tmp_path):
    path = tmp_path / "run.mcap"
    write_run(path, ticks=20)
    whole, (first, end, _) = path.read_bytes(), chunks_of(path)[1]
    changed = bytearray(whole[: end + 5])
    changed[(first + end) // 2] ^= 4
    path.write_bytes(changed)
    with pytest.raises(LogError, match="damaged"):
        read_log(path)


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    for path in (blocked / "run.mcap", tmp_path, tmp_path / "a\0b"):
        with pytest.raises(LogError, match="cannot be written"):
            RunLogWriter(path, {})


def test_a_full_disk_is_told_once_and_the_run_goes_on(tmp_path, monkeypatch):
    def full():
        raise OSError(28, "No space left on device")

    with RunLogWriter(tmp_path / "run.mcap", {}) as log:
        log.sample(observation(0), Command(0.0, 0.0))
        with monkeypatch.context() as patch:
            patch.setattr(log, "_flush", full)
            with pytest.raises(LogError, match="No space left"):
                log.sample(observation(8), Command(0.0, 0.0))  # ends a chunk
        log.sample(observation(9), Command(0.0, 0.0))
    assert not read_log(log.path).complete


def test_an_interrupt_inside_a_chunk_leaves_a_readable_file(tmp_path, monkeypatch):
    def interrupt(*arguments):
        raise KeyboardInterrupt

    with RunLogWriter(tmp_path / "run.mcap", {}) as log:
        for k in range(9):
            log.sample(observation(k), Command(0.0, 0.0))
        with monkeypatch.context() as patch:
            patch.setattr("mcap.records.RecordBuilder.finish_record", interrupt)
            log.sample(observation(9), Command(0.0, 0.0))
            with pytest.raises(KeyboardInterrupt):
                log.sample(observation(17), Command(0.0, 0.0))  # ends a chunk
        log.result({"reason": "interrupted"})
    got = read_log(log.path)
    assert len(got.ticks["t"]) == 9
    assert not got.complete


def test_a_log_that_another_run_writes_is_refused_and_stays_whole(tmp_path):
    path = tmp_path / "a.mcap"
    with RunLogWriter(path, {"rig": "toy"}) as first:
        with pytest.raises(LogError):
            RunLogWriter(path, {"rig": "rough"})
        first.result({"success": True})
    assert read_log(path).header["rig"] == "toy"
    with RunLogWriter(path, {"rig": "rough"}):
        pass
    assert read_log(path).header["rig"] == "rough"
