"""The program around the commands: exit statuses, streams, one-line errors, help, cache of compiled code."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib.metadata import version

import pytest

FULL = pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
SHORT = ["navigate", "--rig", "ideal", "--from", "ring4"]


def run(words, **streams):
    command = " ".join([sys.executable, "-m", "mazeplan", *words])
    return subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=False, **streams)


@pytest.mark.slow
def test_a_closed_stderr_changes_nothing(tmp_path):
    log = tmp_path / "run.mcap"
    done = run([*SHORT, "--to", "ring5", "--log", str(log), "--json", "2>&-"])
    assert done.returncode == 0
    assert json.loads(done.stdout)["success"]
    assert log.exists()
    done = run(["navigate", "--from", "ring9", "--json", "2>&-"])
    assert (done.returncode, done.stdout) == (2, "")


@pytest.mark.slow
@FULL
@pytest.mark.parametrize(("words", "status"), [(SHORT, 0), (["navigate", "--from", "ring9"], 2)])
def test_a_full_stderr_does_not_change_the_exit_status(words, status):
    assert run([*words, "2> /dev/full"]).returncode == status


@pytest.mark.slow
@FULL
@pytest.mark.parametrize("words", [["doctor"], ["map", "route", "--json"]])
def test_a_stdout_that_cannot_be_written_is_one_line_and_status_1(words):
    done = run([*words, "> /dev/full"])
    assert (done.returncode, done.stderr) == (1, "mazeplan: cannot write: No space left on device\n")


@pytest.mark.parametrize("words", ["doctor", "behavior list", "behavior list --json"])
def test_a_reader_that_left_is_silence_and_status_1(words):
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-m", "mazeplan", *words.split()]
    done = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True, check=False)
    os.close(write)
    assert (done.returncode, done.stderr) == (1, "")


def test_help_and_version(call):
    code, out, err = call()
    assert code == 2
    assert "evaluate" in out + err
    code, out, _ = call("--help")
    assert code == 0
    assert "navigate" in out
    assert call("--version") == (0, f"mazeplan {version('mazeplan')}\n", "")
