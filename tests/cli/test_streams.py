"""Streams that are closed or full: the job is done as ever, or one line says why not."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import commands
import pytest

from mazeplan.cli import Heedless, named
from mazeplan.errors import InputError


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


FULL = pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
SHORT = ["navigate", "--rig", "ideal", "--from", "ring4"]


@FULL
@pytest.mark.parametrize(("words", "status"), [(SHORT, 0), (["navigate", "--from", "ring9"], 2)])
def test_a_full_stderr_does_not_change_the_exit_status(words, status):
    assert run([*words, "2> /dev/full"]).returncode == status


@FULL
def test_a_result_that_cannot_be_written_is_told_and_no_success():
    done = run(["map", "route", "--json", "> /dev/full"])
    assert done.returncode == 1
    assert done.stderr.endswith("mazeplan: cannot write: No space left on device\n")
    assert "Traceback" not in done.stderr


def test_a_reader_who_left_is_told_of_in_one_line():
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [sys.executable, "-m", "mazeplan", "doctor"], stdout=write, stderr=subprocess.PIPE, text=True, check=False
    )
    os.close(write)
    assert (done.returncode, done.stderr) == (1, "mazeplan: cannot write: Broken pipe\n")


def test_what_stderr_does_not_take_is_dropped():
    class Full:
        encoding = "utf-8"

        def write(self, text):
            raise OSError(28, "No space left on device")

        def flush(self):
            raise OSError(28, "No space left on device")

    stream = Heedless(Full())
    assert stream.write("abc") == 3
    stream.flush()
    assert stream.encoding == "utf-8"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["navigate", "--from", "ring9"], "--from: ring: got 'ring9', expected ring1 to ring5"),
        (["navigate", "--to=ring9"], "--to: ring: got 'ring9', expected ring1 to ring5"),
        (["navigate", "--start-angle", "nan"], "--start-angle: got nan, expected a finite number of degrees"),
        (["navigate", "--settings", "nowhere"], "--settings: nowhere: no such file, expected settings (YAML)"),
        (["navigate", "--rig", "zz"], "--rig: got rig 'zz', expected one of "),
        (["navigate", "--model", "zz"], "--model: zz: no such model; expected a folder with model.yaml"),
        (["navigate", "--map", "zz"], "--map: zz: no such file, and not a packaged map"),
        (["navigate", "--behavior", "zz"], "--behavior: zz: no such file, expected an XML file"),
        (["navigate", "--close", "1-9"], "--close: closed opening: got '1-9', expected one of 1-2@45"),
        (["navigate", "--seed", "-1"], "--seed: got '-1', expected a number >= 0\n"),
        (["navigate", "--seed", "1.5"], "--seed: got '1.5', expected a whole number\n"),
        (["navigate", "--time-limit=soon"], "--time-limit: got 'soon', expected a number\n"),
        (["evaluate", "--to", "ring9"], "--to: ring: got 'ring9'"),
        (["map", "route", "--from", "ring9"], "--from: ring: got 'ring9'"),
        (["collect", "--ring", "9", "-o", "c.mcap"], "--ring: ring: got '9'"),
    ],
)
def test_what_is_wrong_with_an_option_names_it(monkeypatch, capsys, words, told):
    code, out, err = commands.call(monkeypatch, capsys, *words)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err.startswith(f"mazeplan: {told}")


def test_a_place_in_a_file_is_no_matter_of_the_option():
    assert named(InputError("bad", file="a.yaml", line=3), ["navigate", "--map", "a.yaml"]) == "a.yaml:3: bad"
    assert named(InputError("bad", file="a.yaml"), ["map", "check", "a.yaml"]) == "a.yaml: bad"
