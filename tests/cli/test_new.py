"""`new rig`: a working rig from the start, and no file overwritten without being asked."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from functools import partial

import pytest
from pages import ROOT

PYTEST = ("pytest", "-q", "-p", "no:cacheprovider")
RUFF = ("--isolated", "--line-length", "120")


@pytest.fixture
def new(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield partial(call, "new", "rig")
    for name in ("my_table", "other_table"):
        sys.modules.pop(name, None)


def module(*words, cwd):
    """Run a Python module in a folder."""
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    words = [sys.executable, "-m", *map(str, words)]
    return subprocess.run(words, cwd=cwd, capture_output=True, text=True, check=False, env=env)


@pytest.mark.slow
def test_the_written_rig_passes_its_test_and_arrives(new, call, tmp_path, monkeypatch):
    code, out, _ = new("my_table")
    assert (code, out) == (0, "cd my_table && python -m pytest && mazeplan navigate --rig my_table.yaml\n")
    home = tmp_path / "my_table"
    files = {str(path.relative_to(home)) for path in home.rglob("*") if path.is_file()}
    assert files == {"my_table.py", "my_table.yaml", "tests/test_my_table.py", "pyproject.toml", "README.md"}
    project = tomllib.loads((home / "pyproject.toml").read_text())["project"]
    assert project["name"]
    assert project["name"] == "my-table"
    check, layout = ("ruff", "check", *RUFF, "--select", "E,F,I,B,UP", "."), ("ruff", "format", *RUFF, "--check", ".")
    for words in (check, layout, PYTEST):
        done = module(*words, cwd=home)
        assert done.returncode == 0, done.stdout + done.stderr
    file = home / "my_table.yaml"
    good = file.read_text()
    file.write_text(good.replace("beta_sign: 1", "beta_sign: -1"))  # the test drives the rig of this file
    assert "sign of beta: " in module(*PYTEST, "-k", "is_a_rig", cwd=home).stdout
    file.write_text(good)
    monkeypatch.chdir(home)
    code, out, err = call("navigate", "--from", "ring4", "--rig", "my_table.yaml", "--json")
    assert code == 0, err
    assert '"rig": "my_table"' in out


def test_settings_of_the_new_rig_are_checked_with_their_line(new, refused, tmp_path, monkeypatch):
    new("other_table", "-o", "here")
    monkeypatch.chdir(tmp_path / "here")
    file = tmp_path / "here" / "other_table.yaml"
    text = file.read_text()
    for old, changed, said in (
        ("beta_sign: 1", "beta_sign: 2", "other_table.yaml:5: beta_sign: got 2, expected 1 or -1"),
        ("machine: stand-in", "machine: robot", "other_table.yaml:3: machine: got 'robot', expected one of stand-in"),
        ("rate_hz", "rate", "other_table.yaml:4: rate: unknown key, expected one of machine, rate_hz"),
    ):
        file.write_text(text.replace(old, changed))
        assert said in refused("navigate", "--rig", "other_table.yaml")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("../up", "expected a Python identifier"), ("", "expected a Python identifier"),
        ("toy", "which is a packaged rig"), ("json", "which is a module of "), ("numpy", "which is a module of "),
        ("tests", "which is the folder of its tests"),
    ],
)  # fmt: skip
def test_bad_names(new, refused, tmp_path, name, said):
    error = refused("new", "rig", name, "-o", "here")
    assert f"NAME: got {name!r}" in error
    assert said in error
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_the_rig_can_be_driven_from_any_folder(new, tmp_path):
    new("far_table")  # the folder has the name of the module: Python would take it without the file's own folder
    away = tmp_path / "away"
    (away / "bla").mkdir(parents=True)
    words = ("mazeplan", "evaluate", "--from", "ring4", "--runs", "2", "--workers", "2", "--rig")
    for folder, file in ((tmp_path, "far_table/far_table.yaml"), (away, "../far_table/far_table.yaml")):
        done = module(*words, file, cwd=folder)
        assert done.returncode == 0, done.stderr
        assert "arrived       2 of 2" in done.stdout
    (away / "odd.yaml").write_text("class: bla:Rig\n")
    done = module("mazeplan", "rig", "check", "odd.yaml", cwd=away)
    assert done.returncode == 2
    taken = f"module 'bla', for which the folder {away / 'bla'} is taken, has no"
    assert f"odd.yaml:1: rig 'bla:Rig': {taken}" in done.stderr


@pytest.mark.parametrize(
    ("kind", "name", "packaged"),
    [
        ("map", (), "maps/cme.yaml"), ("map", ("detour",), "maps/detour.yaml"),
        ("tree", (), "behaviors/navigate.xml"), ("tree", ("waypoints",), "behaviors/waypoints.xml"),
    ],
)  # fmt: skip
def test_a_copy_of_a_packaged_map_or_tree_may_be_changed(call, tmp_path, kind, name, packaged):
    file = tmp_path / f"mine.{packaged.rpartition('.')[2]}"
    code, out, err = call("new", kind, *name, "-o", file)
    assert (code, out) == (0, ""), err
    assert file.read_bytes() == (ROOT / packaged).read_bytes()


@pytest.mark.parametrize(("kind", "ending", "known"), [("map", "yaml", "detour"), ("tree", "xml", "waypoints")])
def test_only_packaged_maps_and_trees_can_be_copied(refused, tmp_path, kind, ending, known):
    line = refused("new", kind, "../nothing", "-o", tmp_path / f"mine.{ending}")
    assert line.startswith("mazeplan: NAME: got '../nothing', expected one of ")
    assert known in line
    assert not (tmp_path / f"mine.{ending}").exists()
