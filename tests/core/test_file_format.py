"""A file of a newer format is refused in one line: the file, its format, the one that is read here, what to do."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from commands import call
from mcap.writer import Writer

from mazeplan.apps.environment.record import KEY, load_episodes
from mazeplan.apps.report.inputs import read_input
from mazeplan.behavior.registry import REGISTRY
from mazeplan.behavior.treefile import read_tree
from mazeplan.core.errors import InputError
from mazeplan.core.file_format import format_problem
from mazeplan.core.logs.run_log import read_log
from mazeplan.diagnosis.rig.reference_file import load_reference
from mazeplan.learning.modelfile import load_model
from mazeplan.learning.online_folder import read_about
from mazeplan.maze.mapfile import load_map
from mazeplan.maze.memory import load_memory
from mazeplan.rigs.faults.schedule import load_schedule
from mazeplan.rigs.files import read_rig_file
from mazeplan.run.campaign.store import _table
from mazeplan.run.settings import load_settings

KEPT = Path(__file__).resolve().parents[1] / "kept_files" / "0.1.0"
NEWER = "format: 7\nversion: 9.9.0\nin_those_days: yes\n"  # with a key that this version does not know


def yaml_of(path: Path) -> None:
    """Make a YAML file one of format 7."""
    text = path.read_text()
    path.write_text(NEWER + re.sub(r"^format: 1\n", "", text, flags=re.MULTILINE))


def json_of(path: Path) -> None:
    path.write_text(json.dumps({"format": 7, "version": "9.9.0", **json.loads(path.read_text())}))


def arrays_of(path: Path) -> None:
    with np.load(path) as held:
        np.savez(path, **{**held, "format": np.array(7), "version": np.array("9.9.0")})


def store_of(path: Path) -> None:
    table = pq.read_table(path)
    pq.write_table(table.replace_schema_metadata({"mazeplan_format": "7", "mazeplan_version": "9.9.0"}), path)


def episodes_of(path: Path) -> None:
    table = pq.read_table(path)
    header = {**json.loads(table.schema.metadata[KEY]), "format": 7, "version": "9.9.0"}
    pq.write_table(table.replace_schema_metadata({KEY: json.dumps(header)}), path)


def log_of(path: Path) -> None:
    """A log whose further messages are not even JSON."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        header = {"program": "mazeplan", "format": 7, "version": "9.9.0"}
        for topic, data in (("/header", json.dumps(header).encode()), ("/tick", b"\x08\x01")):
            writer.add_message(writer.register_channel(topic, "any", 0), 0, data, 0)
        writer.finish()


def tree_of(path: Path) -> None:
    path.write_text(path.read_text().replace('BTCPP_format="4"', 'BTCPP_format="7"'))


KINDS: dict[str, tuple[str, Callable[[Path], None], Callable[[Path], object]]] = {
    "map": ("map.yaml", yaml_of, load_map),
    "model": ("models/p/model.yaml", yaml_of, load_model),
    "rows": ("online/learning.npz", arrays_of, lambda path: read_about(path.parent)),
    "reference": (
        "models/sp/reference.yaml", yaml_of,
        lambda path: load_reference(path.parent, load_model(path.parent)),
    ),
    "log": ("run.mcap", log_of, read_log),
    "settings": ("settings.yaml", yaml_of, load_settings),
    "rig": ("rig.yaml", yaml_of, read_rig_file),
    "rig on a table": ("hardware.yaml", yaml_of, read_rig_file),
    "faults": ("faults.yaml", yaml_of, load_schedule),
    "memory": ("memory.yaml", yaml_of, lambda path: load_memory(path, ["4-5@180"])),
    "evaluation": ("evaluation.json", json_of, read_input),
    "comparison": ("comparison.json", json_of, read_input),
    "improvement": ("improvement.json", json_of, read_input),
    "diagnosis": ("diagnosis/report.json", json_of, lambda path: read_input(path.parent)),
    "evidence": ("diagnosis/evidence.json", json_of, lambda path: read_input(path.parent)),
    "episodes": ("episodes.parquet", episodes_of, load_episodes),
}  # fmt: skip


@pytest.fixture
def kept(tmp_path):
    return shutil.copytree(KEPT, tmp_path / "kept")


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_of_a_newer_format_is_refused_with_the_version_that_reads_it(kept, kind):
    name, make_newer, read = KINDS[kind]
    read(kept / name)
    make_newer(kept / name)
    with pytest.raises(InputError) as error:
        read(kept / name)
    this = version("mazeplan")
    said = (
        f"format: got 7, expected 1, which mazeplan {this} reads; install a mazeplan 9.9.0 or newer to read this file"
    )
    assert str(error.value).startswith(f"{kept / name}:")
    assert str(error.value).endswith(said)
    assert "\n" not in str(error.value)


def test_kept_runs_of_a_newer_format_are_refused(kept):
    (path,) = (kept / "store").glob("*.parquet")
    assert len(_table(path)) == 2
    store_of(path)
    with pytest.raises(InputError, match=r"mazeplan_format: got 7, expected 1, .* a mazeplan 9\.9\.0 or newer"):
        _table(path)


def test_a_tree_of_a_newer_format_is_refused(kept):
    tree_of(kept / "tree.xml")
    with pytest.raises(InputError, match=r"BTCPP_format: got '7', expected '4', which mazeplan .* newer than 0"):
        read_tree(kept / "tree.xml").build(REGISTRY, None)


@pytest.mark.parametrize("name", ["map.yaml", "settings.yaml", "rig.yaml", "faults.yaml", "evaluation.json"])
def test_a_file_may_name_the_format_that_it_has(kept, name):
    read = next(read for file, _, read in KINDS.values() if file == name)
    path = kept / name
    before = repr(read(path))
    if name.endswith("json"):
        path.write_text(json.dumps({"format": 1, **json.loads(path.read_text())}))
    else:
        path.write_text("format: 1\n" + path.read_text())
    assert repr(read(path)) == before


def test_the_rig_class_of_a_user_gets_its_own_format(tmp_path):
    path = tmp_path / "rig.yaml"
    path.write_text("class: my_rig:Table\nformat: mjpeg\n")
    assert read_rig_file(path) == ("my_rig:Table", {"format": "mjpeg"})


def test_the_command_line_refuses_a_newer_file_in_one_line(kept, monkeypatch, capsys):
    for name, command in (("map.yaml", ("map", "check")), ("run.mcap", ("log", "info"))):
        KINDS[name.partition(".")[0].replace("run", "log")][1](kept / name)
        code, out, err = call(monkeypatch, capsys, *command, kept / name)
        assert (code, out) == (2, "")
        assert len(err.splitlines()) == 1
        assert "install a mazeplan 9.9.0 or newer" in err


@pytest.mark.parametrize("given", [0, -1, 1.5, True, None, "2", "x" * 99, [1]])
def test_what_is_no_newer_number_is_only_wrong(given):
    problem = format_problem(given, 1)
    assert problem is not None
    assert problem.endswith(", expected 1")
    assert len(problem) < 70


@pytest.mark.parametrize("written_by", [None, 3, "", "a\nb", "9" * 41, version("mazeplan")])
def test_without_a_version_that_helps_a_newer_one_is_wanted(written_by):
    assert f"install a mazeplan newer than {version('mazeplan')}" in str(format_problem(2, 1, written_by))
