"""Run logs as other people's tools see them: through the official reader of MCAP and its index."""

from __future__ import annotations

import json
import math
import signal
import subprocess
import sys
from contextlib import suppress
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader

from mazeplan.core.events import FailureReported, RecoveryChosen
from mazeplan.core.logs.run_log import CHUNK_S, SCHEMAS, RunLogWriter, encode, read_log
from mazeplan.core.logs.run_log_reader import read_messages
from mazeplan.core.logs.viewer_topics import EVERY, VIEWER_SCHEMAS, ViewerTopics, scene
from mazeplan.core.records import Command, Observation, Plan, StopReason
from mazeplan.maze.mapfile import load_map
from mazeplan.run.specification import log_shape

MAZE = load_map("cme")
DT = 1.0 / 30.0
BETA, GAMMA = 0.05, -0.08


@pytest.fixture
def log(tmp_path):
    """Three seconds; the ball is not seen in ticks 40 to 49."""
    path = tmp_path / "run.mcap"
    with RunLogWriter(path, {"rig": "toy"}, log_shape(MAZE)) as writer:
        for k in range(90):
            t, seen = k * DT, not 40 <= k < 50
            place = (0.08 * math.cos(t), 0.08 * math.sin(t)) if seen else (None, None)
            writer.sample(Observation(t, *place, BETA, GAMMA), Command(0.0, 0.0))
            if k == 45:
                writer.event(t, FailureReported("ball_lost", "Track", "not seen"))
                writer.event(t, RecoveryChosen("Wait"))
            if k % 3 == 0:
                states = np.column_stack([t + 0.1 * np.arange(60.0), np.zeros((60, 5))])
                gains = np.zeros((59, 2, 6))
                writer.plan(Plan(states, np.zeros((59, 2)), gains, 1.0, StopReason.CONVERGED, 1, 2.0, t))
        writer.result({"success": False, "reason": "ball_lost"})
    return path


def read(path, topic):
    with path.open("rb") as stream:
        return [(m.log_time, json.loads(m.data)) for _, _, m in make_reader(stream).iter_messages(topics=[topic])]


def stamp(document):
    return document["timestamp"]["sec"] * 10**9 + document["timestamp"]["nsec"]


def test_the_index_leads_to_every_message(log):
    with log.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        counts = {c.topic: summary.statistics.channel_message_counts.get(i, 0) for i, c in summary.channels.items()}
        assert {s.name for s in summary.schemas.values()} == {
            *(f"mazeplan.{topic[1:]}" for topic in SCHEMAS), *(name for name, _ in VIEWER_SCHEMAS.values()),
        }  # fmt: skip
        assert len(summary.chunk_indexes) == summary.statistics.chunk_count >= 3.0 / 0.3
        for chunk in summary.chunk_indexes:  # a chunk ends with the first message that is CHUNK_S later
            assert chunk.message_end_time - chunk.message_start_time <= (CHUNK_S + DT) * 1e9
            assert chunk.message_index_length > 0
        assert counts["/tick"] == 90
        assert sum(counts.values()) == summary.statistics.message_count
    for topic, count in counts.items():
        assert len(read(log, topic)) == count
    with log.open("rb") as stream:
        between = make_reader(stream).iter_messages(topics=["/tick"], starting_at=10**9, ending_before=2 * 10**9)
        assert [json.loads(m.data)["t"] for _, _, m in between] == [k * DT for k in range(30, 60)]


def test_own_topics_are_the_same_with_and_without_a_drawing(tmp_path, log):
    _, messages, complete = read_messages(log)
    other = tmp_path / "other.mcap"
    with RunLogWriter(other, {"rig": "toy"}) as writer:
        for topic, document in messages[1:]:
            writer.write(topic, float(document.get("t", document.get("t0", 3.0))), document)
    assert complete
    assert {topic for topic, _ in messages} <= set(SCHEMAS)
    assert read_messages(other)[1][1:] == messages[1:]
    assert not [e for _, d in read(other, "/foxglove/scene") for e in d["entities"] if e["id"] != "plan"]


def test_the_plate_tilts_as_measured(log):
    tilts = [(t, d) for t, d in read(log, "/foxglove/tf") if d["child_frame_id"] == "plate"]
    assert len(tilts) == 90 / EVERY
    for t, document in tilts:
        assert stamp(document) == t
        assert document["parent_frame_id"] == "world"
    x, y, z, w = (tilts[0][1]["rotation"][name] for name in "xyzw")
    turned = np.array([  # of the quaternion
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    cb, sb, cg, sg = math.cos(BETA), math.sin(BETA), math.cos(GAMMA), math.sin(GAMMA)
    pitch = np.array([[cb, 0.0, sb], [0.0, 1.0, 0.0], [-sb, 0.0, cb]])  # positive beta lowers the +x side
    roll = np.array([[1.0, 0.0, 0.0], [0.0, cg, -sg], [0.0, sg, cg]])  # positive gamma lifts the +y side
    assert turned == pytest.approx(pitch @ roll, abs=1e-6)


def test_the_ball_is_where_it_was_seen(log):
    poses, ticks = read(log, "/foxglove/ball"), dict(read(log, "/tick"))
    frames = [(t, d) for t, d in read(log, "/foxglove/tf") if d["child_frame_id"] == "ball"]
    assert len(poses) == len(frames) == 80 / EVERY
    for (t, pose), (also, frame) in zip(poses, frames, strict=True):
        place = pose["pose"]["position"]
        assert t == also == stamp(pose)
        assert (place["x"], place["y"]) == pytest.approx((ticks[t]["x"], ticks[t]["y"]), abs=1e-6)
        assert place["z"] == pytest.approx(MAZE.ball.radius)
        assert frame["translation"] == place
        assert pose["frame_id"] == frame["parent_frame_id"] == "plate"


def test_the_scene_has_maze_and_ball_once_and_the_newest_plans(log):
    scenes = read(log, "/foxglove/scene")
    entities = [entity for _, document in scenes for entity in document["entities"]]
    names = [entity["id"] for entity in entities]
    assert (names.count("maze"), names.count("ball")) == (1, 1)
    assert names[:2] == ["maze", "ball"]
    assert 8 <= names.count("plan") <= 12  # one for each chunk
    maze, ball, *plans = entities
    rim = MAZE.walls[0].outer_radius
    radii = [math.hypot(p["x"], p["y"]) for line in maze["lines"] for p in line["points"]]
    assert max(radii) == pytest.approx(rim, abs=1e-4)
    assert min(radii) >= MAZE.rings[-1].outer_radius - 1e-4
    assert ball["spheres"][0]["size"]["x"] == pytest.approx(2.0 * MAZE.ball.radius)
    assert ball["frame_id"] == "ball"
    for plan in plans:
        points = plan["lines"][0]["points"]
        assert 20 <= len(points) <= 40
        assert {round(math.hypot(p["x"], p["y"]), 3) for p in points} == {0.08}
    assert len(encode(json.loads(scene(log_shape(MAZE))))) < 64 * 1024


def test_the_log_panel_gets_events_with_levels(log):
    said = [(d["level"], d["name"], d["message"]) for _, d in read(log, "/foxglove/log")]
    assert said == [
        (3, "failure", "failure: kind ball_lost, where Track, detail not seen"),
        (2, "recovery", "recovery: recovery Wait"),
        (4, "result", "ended: ball_lost"),
    ]


def fits(value, schema):
    """Whether a value has the kinds and no other fields than a schema says."""
    if schema["type"] == "object":
        return isinstance(value, dict) and all(fits(v, schema["properties"][name]) for name, v in value.items())
    if schema["type"] == "array":
        return isinstance(value, list) and all(fits(v, schema["items"]) for v in value)
    kind = {"number": (int, float), "integer": int, "string": str, "boolean": bool}[schema["type"]]
    return isinstance(value, kind)


def test_viewer_messages_keep_to_their_schemas(log):
    for topic, (_, schema) in VIEWER_SCHEMAS.items():
        documents = read(log, topic)
        assert documents
        for _, document in documents:
            assert fits(document, schema), topic
            assert topic == "/foxglove/scene" or set(document) == set(schema["properties"])


def test_what_cannot_be_drawn_is_left_out_and_kept_in_the_log(tmp_path):
    path = tmp_path / "run.mcap"
    with RunLogWriter(path, {}) as writer:
        writer.sample(Observation(0.0, float("nan"), 0.1, float("nan"), 0.0), Command(0.0, 0.0))
        writer.write("/event", 0.1, {"t": 0.1, "kind": "odd"})
    assert [topic for topic, _ in read_messages(path)[1]] == ["/header", "/tick", "/event"]
    assert not read(path, "/foxglove/tf")
    assert not list(ViewerTopics(None).of([("/status", 0, {})]))


def test_the_header_says_when_the_run_began(log):
    began = datetime.fromisoformat(read_log(log).header["started"])
    assert began.utcoffset() == timedelta(0)
    assert abs(datetime.now(UTC) - began) < timedelta(minutes=10)


CHILD = """
import sys
from mazeplan.core.logs.run_log import RunLogWriter
from mazeplan.core.records import Command, Observation
log = RunLogWriter(sys.argv[1], {})
for k in range(int(sys.argv[2]) + 1):
    log.sample(Observation(k / 30, 0.08, 0.0, 0.0, 0.0), Command(0.0, 0.0))
print("there", flush=True)
sys.stdin.read()  # never ends: the parent kills here
"""


@pytest.mark.parametrize("last", [61, 62, 70])
def test_the_official_reader_reads_what_is_left_after_kill_9(tmp_path, last):
    path = tmp_path / "killed.mcap"
    command = [sys.executable, "-c", CHILD, str(path), str(last)]
    child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    child.stdout.readline()
    child.send_signal(signal.SIGKILL)
    child.communicate()
    assert child.returncode == -signal.SIGKILL
    ours = read_log(path)
    assert not ours.complete
    assert last / 30 - ours.ticks["t"][-1] < CHUNK_S + DT
    theirs = []
    with path.open("rb") as stream, suppress(EndOfFile):
        records = StreamReader(stream, validate_crcs=True).records
        theirs.extend(json.loads(r.data)["t"] for r in records if isinstance(r, Message) and b'"u_beta"' in r.data)
    assert theirs == ours.ticks["t"].tolist()
