"""A file of a newer format is refused in one line: the file, its format, the one that is read here, what to do."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from mcap.writer import Writer

from mazeplan.apps.report.inputs import read_input
from mazeplan.behavior.registry import REGISTRY
from mazeplan.behavior.trees import read_tree
from mazeplan.core.errors import InputError
from mazeplan.core.logs.run_log_reader import read_log
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.faults.schedule import load_schedule
from mazeplan.rigs.files import read_rig_file
from mazeplan.run.settings import PACKAGED, load_settings

ROOT = Path(__file__).resolve().parents[2]


def yaml_of(path: Path) -> None:
    """Make a YAML file one of format 7, with a key that this version does not know."""
    text = re.sub(r"^format: 1\n", "", path.read_text(), flags=re.MULTILINE)
    path.write_text("format: 7\nversion: 9.9.0\nin_those_days: yes\n" + text)


def json_of(path: Path) -> None:
    path.write_text(json.dumps({"format": 7, "version": "9.9.0", **json.loads(path.read_text())}))


def log_of(path: Path) -> None:
    """A log whose further messages are not even JSON."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        header = {"program": "mazeplan", "format": 7, "version": "9.9.0"}
        for topic, data in (("/header", json.dumps(header).encode()), ("/tick", b"\x08\x01")):
            writer.add_message(writer.register_channel(topic, "any", 0), 0, data, 0)
        writer.finish()


RESULTS = {"runs": 0, "success": 0, "time_s": {}, "failures": {}, "planner_ms": {}, "results": []}
KINDS: dict[str, tuple[str, Callable[[Path], None], Callable[[Path], object]]] = {
    "map": ((ROOT / "maps" / "cme.yaml").read_text(), yaml_of, load_map),
    "settings": (PACKAGED.read_text(), yaml_of, load_settings),
    "rig": ("base: toy\n", yaml_of, read_rig_file),
    "rig on a table": ("rig: hardware\n", yaml_of, read_rig_file),
    "faults": ("faults:\n  - {kind: frames_lost, from_s: 1.0, to_s: 1.2}\n", yaml_of, load_schedule),
    "evaluation": (json.dumps(RESULTS), json_of, read_input),
    "log": ("", log_of, read_log),
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_of_a_newer_format_is_refused(kind, tmp_path):
    text, make_newer, read = KINDS[kind]
    path = tmp_path / f"file.{'json' if make_newer is json_of else 'mcap' if make_newer is log_of else 'yaml'}"
    path.write_text(text)
    make_newer(path)
    with pytest.raises(InputError, match=r"format: got 7, expected 1, .* install a mazeplan 9\.9\.0 or newer") as error:
        read(path)
    assert str(error.value).startswith(f"{path}:")
    assert "\n" not in str(error.value)


def test_a_tree_of_a_newer_format_is_refused(tmp_path):
    text = (ROOT / "behaviors" / "navigate.xml").read_text()
    path = tmp_path / "tree.xml"
    path.write_text(text.replace('BTCPP_format="4"', 'BTCPP_format="7"'))
    with pytest.raises(InputError, match=r"got BTCPP_format '7', expected .*4"):
        read_tree(path).build(REGISTRY, None)


def test_the_rig_class_of_a_user_gets_its_own_format(tmp_path):
    path = tmp_path / "rig.yaml"
    path.write_text("class: my_rig:Table\nformat: mjpeg\n")
    assert read_rig_file(path) == ("my_rig:Table", {"format": "mjpeg"})
