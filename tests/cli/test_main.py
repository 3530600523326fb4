"""The program around the commands: exit statuses, streams, one-line errors, help, cache of compiled code."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

import mazeplan.apps.cli
from mazeplan.apps.cli import TolerantStream, keep_compiled, with_option
from mazeplan.core.errors import InputError, MapError, ModelError

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


def test_a_tolerant_stream_drops_what_it_cannot_write():
    class Full:
        encoding = "utf-8"

        def write(self, text=""):
            raise OSError(28, "No space left on device")

        flush = write

    stream = TolerantStream(Full())
    assert stream.write("abc") == 3
    stream.flush()
    assert stream.encoding == "utf-8"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["navigate", "--from", "ring9"], "--from: ring: got 'ring9'"),
        (["navigate", "--to=ring9"], "--to: ring: got 'ring9'"),
        (["navigate", "--start-angle", "nan"], "--start-angle: got 'nan'"),
        (["navigate", "--settings", "nowhere"], "--settings: nowhere: "),
        (["navigate", "--rig", "zz"], "--rig: got rig 'zz'"),
        (["navigate", "--rig", "no.such.module:Rig"], "rig 'no.such.module:Rig'"),
        (["navigate", "--rig", "os:getcwd"], "'os:getcwd' is no rig"),
        (["navigate", "--via", "ring3-ring2"], "--via: got 'ring3-ring2'"),
        (["navigate", "--model", "zz"], "--model: zz: "),
        (["navigate", "--map", "zz"], "--map: zz: "),
        (["navigate", "--map", "cmee"], "did you mean cme?"),
        (["navigate", "--behavior", "zz"], "--behavior: zz: "),
        (["navigate", "--seed", "-1"], "--seed: "),
        (["navigate", "--time-limit", "nan"], "--time-limit: got 'nan'"),
        (["navigate", "--log", "/proc/none/x.mcap"], "--log: /proc/none/x.mcap"),
        (["navigate", "--colour"], "--colour"),
        (["evaluate", "--faults", "camera_dead"], "--faults: got 'camera_dead'"),
        (["collect", "--ring", "9", "-o", "c.mcap"], "--ring: got '9'"),
        (["learn", "a.csv", "-o", "m", "--kind", "magic"], "--kind: 'magic' is not one of"),
        (["navigat"], "'navigate'"),
        (["log", "summary"], "info, export, replay"),
        (["learn"], "mazeplan learn runs/toy.mcap -o runs/model"),
    ],
)
def test_an_error_names_the_option_and_its_value(refused, words, message):
    assert message in refused(*words)


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        ("learn", "nosuch.mcap", "-o", "out"),
        ("compare", "nosuch.mcap"),
        ("policy", "train", "--rig", "nosuch", "-o", "out"),
        ("policy", "train", "--model", "nosuch", "-o", "out"),
    ],
)
def test_a_name_that_is_not_there_is_told_before_torch_loads(tmp_path, words):
    check = (
        "import sys; sys.argv[0] = 'mazeplan'; from mazeplan.apps.cli import main\n"
        "try: main()\nfinally: print('torch' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", check, *words], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert (done.returncode, done.stdout) == (2, "False\n"), done.stderr
    assert "nosuch" in done.stderr


def test_a_place_in_a_file_needs_no_option():
    assert with_option(InputError("bad", file="a.yaml", line=3), ["navigate", "--map", "a.yaml"]) == "a.yaml:3: bad"
    assert with_option(InputError("bad", file="a.yaml"), ["map", "check", "a.yaml"]) == "a.yaml: bad"


def test_of_options_with_the_same_value_the_likely_one_is_named():
    for error, option in ((ModelError, "--model"), (MapError, "--map")):
        words = ["diagnose", "c.mcap", "--map", "m", "--test", "m", "--model", "m"]
        assert with_option(error("bad", file="m"), words) == f"{option}: m: bad"


def test_help_and_version(call):
    code, out, err = call()
    assert code == 2
    assert "evaluate" in out + err
    code, out, _ = call("--help")
    assert code == 0
    assert "navigate" in out
    assert call("--version") == (0, f"mazeplan {version('mazeplan')}\n", "")


INTERRUPTED = """
import sys

class Interrupted:
    def find_spec(self, name, path=None, target=None):
        if name == "typer":
            raise KeyboardInterrupt

sys.meta_path.insert(0, Interrupted())
from mazeplan.__main__ import main
main()
"""


def test_ctrl_c_while_the_program_loads_is_one_line():
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "mazeplan: interrupted\n")


@pytest.mark.parametrize("writable", ["package", "cache", "nothing", "given"])
def test_compiled_code_is_kept_in_the_usual_places_else_in_a_temporary_folder(monkeypatch, capsys, writable):
    package = Path(mazeplan.apps.cli.__file__).parent
    access = {"package": lambda place: Path(place) == package, "cache": lambda place: Path(place) != package}
    monkeypatch.setattr(os, "access", lambda place, mode: access.get(writable, lambda place: False)(place))
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/mine")
    if writable != "given":
        monkeypatch.delenv("NUMBA_CACHE_DIR")
    keep_compiled()
    found = os.environ.get("NUMBA_CACHE_DIR")
    if writable == "nothing":
        assert Path(str(found)).is_dir()
        assert "NUMBA_CACHE_DIR" in capsys.readouterr().err
        Path(str(found)).rmdir()
    else:
        assert found == ("/mine" if writable == "given" else None)
