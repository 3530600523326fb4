"""Files that this version of mazeplan did not write."""

from __future__ import annotations

import json

import pytest
from mcap.writer import Writer

from mazeplan.core.errors import LogError
from mazeplan.core.logs.run_log_reader import read_log


def foreign(path, *, header: object = None, chunked: bool = False, tick: object = None, tree: object = None) -> None:
    with path.open("wb") as stream:
        writer = Writer(stream, use_chunking=chunked)
        writer.start()
        for topic, document in (("/header", header), ("/tick", tick), ("/tree", tree)):
            if document is not None:
                channel = writer.register_channel(topic, "json", 0)
                writer.add_message(channel, 0, json.dumps(document).encode(), 0)
        writer.finish()


OURS = {"program": "mazeplan", "format": 1}
TREE = {"t": 0.0, "paths": ["a"], "kinds": ["InRing"], "names": ["a"], "parents": [-1]}


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ({}, "without the header of a run, expected a run log of mazeplan"),
        ({"header": {**OURS, "format": 99}}, "header.format: got 99, expected 1"),
        ({"header": OURS, "tick": {"t": 10**400}}, "of the wrong kind"),
        ({"header": OURS, "tree": {**TREE, "conditions": 7}}, "of the wrong kind"),
    ],
)
def test_a_foreign_file_is_one_line_that_names_what_was_expected(tmp_path, content, told):
    path = tmp_path / "foreign.mcap"
    foreign(path, **content)
    with pytest.raises(LogError) as caught:
        read_log(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_whole_file_of_another_program_is_not_damaged(tmp_path):
    path = tmp_path / "robot.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        writer.add_message(writer.register_channel("/odom", "cdr", 0), 0, b"\x00\x01\x00\x00", 0)
        writer.finish()
    with pytest.raises(LogError, match="without the header of a run, expected a run log"):
        read_log(path)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"", "got an empty file, expected a run log of mazeplan (MCAP)"),
        (b"t,theta\n0,1\n", "got text, expected a run log of mazeplan (MCAP)"),
        (b"\x89MCAP0\r\n" + b"\xff" * 64, "damaged after 0 messages"),
        (b"\x89MCAP0\r\n", "without the header of a run"),
    ],
)
def test_another_file_is_refused(tmp_path, content, told):
    path = tmp_path / "other"
    path.write_bytes(content)
    with pytest.raises(LogError) as caught:
        read_log(path)
    assert told in str(caught.value)


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    for path, told in (
        (tmp_path / "none.mcap", "no such file, expected a run log"),
        (tmp_path, "got a folder, expected a run log"),
    ):
        with pytest.raises(LogError, match=told) as caught:
            read_log(path)
        assert str(caught.value).startswith(f"{path}: ")


@pytest.mark.parametrize("chunked", [False, True])
def test_logs_of_older_versions_without_chunks_are_read(tmp_path, chunked):
    path = tmp_path / "old.mcap"
    foreign(path, header=OURS, chunked=chunked, tick={"t": 0.5, "x": 0.01})
    log = read_log(path)
    assert log.complete
    assert log.ticks["t"].tolist() == [0.5]
