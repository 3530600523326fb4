"""What a file is, in words, and that every reader refuses a wrong one in one line: file, what was got, what it should
be."""

from __future__ import annotations

import numpy as np
import pytest

from mazeplan.apps.report.inputs import read_document, read_input
from mazeplan.behavior.trees import read_tree
from mazeplan.core.errors import InputError
from mazeplan.core.file_kinds import got, refused
from mazeplan.core.logs.run_log import read_log
from mazeplan.core.logs.table import read_table
from mazeplan.diagnosis.engine.emps import read_drive
from mazeplan.learning.modelfile import load_model
from mazeplan.maze.mapfile import dump_map, load_map
from mazeplan.maze.memory import load_memory
from mazeplan.rigs.faults.schedule import load_schedule
from mazeplan.rigs.hardware.tiltcalibration import read_readings
from mazeplan.rigs.registry import rig_file
from mazeplan.run.settings import load_settings

PNG = b"\x89PNG\r\n\x1a\n" + bytes(40)
CONTENT = {
    "nothing": (b"", "an empty file"),
    "blank": (b" \n\t\n", "a file with nothing but blanks"),
    "picture": (PNG, "a PNG picture"),
    "bytes": (bytes(range(256)), "a binary file"),
    "latin": ("Größe: 3\n".encode("latin-1"), "text that is not UTF-8"),
    "wide": ("a: 1\n".encode("utf-16"), "UTF-16 text, not UTF-8"),
    "log": (b"\x89MCAP0\r\n", "a log (MCAP)"),
    "xml": (b'<?xml version="1.0"?>\n<root/>', "XML"),
    "html": (b"<!doctype html><p>", "HTML"),
    "json": (b'{"a": 1}', "JSON"),
    "map": (dump_map(load_map("cme")).encode(), "YAML"),
    "commented": (b"# a map, x, y\n\nname: a\n", "YAML"),
    "table": (b"t,theta\n0,1\n", "a table (CSV)"),
    "prose": (b"It was a dark night.\n", "text"),
    "cut": (b"a" * 4095 + "ö".encode() + b"b" * 9, "text"),  # in the midst of a character
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("kinds")
    for name, (content, _) in CONTENT.items():
        (place / name).write_bytes(content)
    (place / "model").mkdir()
    (place / "model/model.yaml").write_text("kind: p\n")
    return place


def test_a_file_is_known_by_its_content(folder):
    assert {name: got(folder / name) for name in CONTENT} == {name: what for name, (_, what) in CONTENT.items()}


def test_what_is_no_file(folder):
    assert got(folder) == "a folder"
    assert got(folder / "model") == "the folder of a model"
    assert got("/dev/null") == "a device or pipe"
    assert got("a\0b").startswith("a file that may not be read (")
    assert refused(folder / "none", "a map") == "no such file, expected a map"
    assert refused(folder / "picture", "a map") == "got a PNG picture, expected a map"


def test_a_file_that_may_not_be_read(monkeypatch):
    def denied(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("builtins.open", denied)
    assert refused(__file__, "a map") == "got a file that may not be read (Permission denied), expected a map"


def test_json_with_a_byte_order_mark_is_read(tmp_path):
    path = tmp_path / "evaluation.json"
    path.write_text('{"results": []}', encoding="utf-8-sig")
    assert read_document(path) == {"results": []}


READERS = {
    "map": (load_map, "expected a map (YAML)"),
    "settings": (load_settings, "expected settings (YAML)"),
    "faults": (load_schedule, "expected a schedule of faults (YAML)"),
    "memory": (lambda path: load_memory(path, ["1-2@45"]), "expected a file of `navigate --memory` (YAML)"),
    "model": (load_model, "expected a folder with model.yaml"),
    "log": (read_log, "expected a run log of mazeplan (MCAP)"),
    "record": (read_table, "expected a run log (.mcap) or a table (CSV)"),
    "drive": (read_drive, "expected a .mat file"),
    "tree": (read_tree, "(XML, <root BTCPP_format"),
    "report": (read_input, "expected a run log, or the JSON of evaluate"),
    "readings": (read_readings, "expected a table (CSV) with v0, v1"),
}


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("wrong", ["nothing", "picture", "xml"])
def test_every_reader_says_what_it_got_and_what_it_wants(folder, reader, wrong):
    read, wanted = READERS[reader]
    if (reader, wrong) == ("tree", "xml"):
        wrong = "map"
    with pytest.raises(InputError) as error:
        read(folder / wrong)
    text = str(error.value)
    assert text.startswith(f"{folder / wrong}:")
    assert f"got {CONTENT[wrong][1]}, " in text
    assert wanted in text
    assert "\n" not in text


def test_a_folder_is_no_rig(tmp_path):
    with pytest.raises(InputError, match=r"got rig '.*', a folder, expected one of hardware"):
        rig_file(str(tmp_path))


def test_a_document_of_another_kind_is_no_map(tmp_path):
    path = tmp_path / "a.json"
    path.write_text('{"verdict": "x", "effects": []}')
    with pytest.raises(InputError, match=r"a.json:1: got the keys 'verdict', 'effects' ..., expected a map: keys such"):
        load_map(path)


def test_a_picture_is_no_video(folder):
    from mazeplan.rigs.camera.source import pictures

    with pytest.raises(InputError, match=r"table: got a table \(CSV\), expected a video that OpenCV can read"):
        list(pictures(str(folder / "table"), 1))
    name = folder / "broken.png"
    name.write_bytes(np.arange(9, dtype=np.uint8).tobytes())
    with pytest.raises(InputError, match=r"broken.png: got a binary file, expected a picture that OpenCV can read"):
        list(pictures(str(name), 1))
