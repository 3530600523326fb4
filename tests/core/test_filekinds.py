"""Every reader refuses a wrong file in one line: file, what was got, what it should be."""

from __future__ import annotations

import pytest

from mazeplan.apps.report.inputs import read_document, read_input
from mazeplan.behavior.trees import read_tree
from mazeplan.core.errors import InputError
from mazeplan.core.file_kinds import LOG, got, refused
from mazeplan.core.logs.run_log_reader import read_log
from mazeplan.core.logs.table import read_table
from mazeplan.diagnosis.engine.emps import read_drive
from mazeplan.learning.modelfile import load_model
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.faults.schedule import load_schedule
from mazeplan.rigs.hardware.tiltcalibration import read_readings
from mazeplan.rigs.registry import rig_file
from mazeplan.run.settings import load_settings

CONTENT = {
    "nothing": (b" \n\t\n", "an empty file"),
    "picture": (b"\x89PNG\r\n\x1a\n" + bytes(40), "a binary file, or text that is not UTF-8"),
    "log": (b"\x89MCAP0\r\n", LOG),
    "xml": (b'<?xml version="1.0"?>\n<root/>', "XML"),
    "json": (b'{"a": 1}', "JSON"),
    "table": (b"t,theta\n0,1\n", "text"),
    "cut": (b"a" * 4095 + "\u00f6".encode() + b"b" * 9, "text"),  # in the midst of a character
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("kinds")
    for name, (content, _) in CONTENT.items():
        (place / name).write_bytes(content)
    return place


def test_a_file_is_known_by_its_content(folder):
    assert {name: got(folder / name) for name in CONTENT} == {name: what for name, (_, what) in CONTENT.items()}
    assert [got(folder), got("/dev/null")] == ["a folder", "a device or pipe"]
    assert got("a\0b")
    assert refused(folder / "none", "a map") == "no such file, expected a map"


def test_json_with_a_byte_order_mark_is_read(tmp_path):
    path = tmp_path / "evaluation.json"
    path.write_text('{"results": []}', encoding="utf-8-sig")
    assert read_document(path) == {"results": []}


READERS = {
    "map": load_map,
    "settings": load_settings,
    "faults": load_schedule,
    "model": load_model,
    "log": read_log,
    "record": read_table,
    "drive": read_drive,
    "tree": read_tree,
    "report": read_input,
    "readings": read_readings,
}


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("wrong", ["nothing", "picture"])
def test_every_reader_refuses_a_wrong_file_in_one_line(folder, reader, wrong):
    with pytest.raises(InputError) as error:
        READERS[reader](folder / wrong)
    text = str(error.value)
    assert text.startswith(f"{folder / wrong}:")
    assert "expected" in text
    assert "\n" not in text


def test_a_folder_is_no_rig(tmp_path):
    with pytest.raises(InputError):
        rig_file(str(tmp_path))
