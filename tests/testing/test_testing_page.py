"""docs/testing-trees.md: its files are written into a folder, and its commands run there, as they stand."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from pages import blocks

import mazeplan.apps.testing

ROOT = Path(__file__).resolve().parent.parent.parent
PAGE = (ROOT / "docs" / "testing-trees.md").read_text(encoding="utf-8")
FILES = {block.file: block.text for block in blocks("docs/testing-trees.md") if block.file}
COMMANDS = re.findall(r"^\$ (.*)$", PAGE, re.MULTILINE)


@pytest.fixture
def desk(tmp_path, monkeypatch):
    for name, text in FILES.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(command: str, desk: Path) -> subprocess.CompletedProcess[str]:
    words = [sys.executable, "-m", *shlex.split(command)]
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    return subprocess.run(
        words,
        cwd=desk,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        env={**os.environ, "PYTHONPATH": path},
    )


def test_the_page_has_all_files_of_its_example():
    assert set(FILES) == {"my_leaves.py", "calm.xml", "test_calm.py"}
    assert COMMANDS == ["pytest -q test_calm.py"]  # which test_pages runs


@pytest.mark.slow
def test_the_example_notices_a_tree_and_a_leaf_that_are_broken(desk):
    (desk / "calm.xml").write_text(FILES["calm.xml"].replace('kinds="stuck"', 'kinds="no_route"'), encoding="utf-8")
    (desk / "my_leaves.py").write_text(FILES["my_leaves.py"].replace("speed <", "speed >"), encoding="utf-8")
    done = run("pytest -q test_calm.py", desk)
    assert done.returncode == 1
    failed = set(re.findall(r"^FAILED test_calm.py::(\w+)", done.stdout, re.MULTILINE))
    assert {"test_a_bad_day", "test_the_leaf_waits_for_a_slow_ball"} <= failed


def test_every_public_name_is_on_the_page_and_has_a_docstring():
    for name in mazeplan.apps.testing.__all__:
        assert getattr(mazeplan.apps.testing, name).__doc__, name
    missing = [name for name in mazeplan.apps.testing.__all__ if not re.search(rf"`[^`]*\b{name}\b", PAGE)]
    assert missing == ["Player", "Record", "Script"]  # what the functions on the page return
