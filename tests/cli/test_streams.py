"""Streams that are closed or full: the job is done as ever, or one line says why not."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest


def run(words, **streams):
    command = " ".join([sys.executable, "-m", "mazeplan", *words])
    return subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=False, **streams)


def test_a_closed_stderr_changes_nothing(tmp_path):
    log = tmp_path / "run.mcap"
    done = run(["navigate", "--rig", "ideal", "--from", "ring4", "--to", "ring5", "--log", str(log), "--json", "2>&-"])
    assert done.returncode == 0
    assert json.loads(done.stdout)["success"]
    assert log.exists()


def test_an_error_does_not_go_to_stdout_where_stderr_is_closed():
    done = run(["navigate", "--from", "ring9", "--json", "2>&-"])
    assert (done.returncode, done.stdout) == (2, "")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_a_full_disk_is_one_line():
    done = run(["doctor", "> /dev/full"])
    assert done.returncode == 1
    assert done.stderr == "mazeplan: cannot write: No space left on device\n"
