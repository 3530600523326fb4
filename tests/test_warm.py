"""Programs that are forks of a warm server: they are as alone as those of `python`."""

from __future__ import annotations

import sys

import pytest
import warm

pytestmark = pytest.mark.slow  # the server starts for a quarter of a minute
ROOM = "import os, sys; print(os.getcwd(), sys.argv, __name__); sys.modules['left'] = os; sys.exit(3)"


def test_a_program_has_its_folder_streams_and_status_and_leaves_nothing(tmp_path):
    done = warm.run(["-c", ROOM], tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (3, f"{tmp_path} ['-c'] __main__\n", "")
    done = warm.run(["-c", "import left"], tmp_path)
    assert done.returncode == 1
    assert "ModuleNotFoundError: No module named 'left'" in done.stderr


def test_a_command_finds_what_is_in_its_folder(tmp_path):
    (tmp_path / "mine.py").write_text("import sys; print(sys.argv[1:], 'mazeplan' in sys.modules)")
    assert warm.run(["mine", "fast"], tmp_path).stdout == "['fast'] True\n"
    assert "mine" not in sys.modules
