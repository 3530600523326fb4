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
