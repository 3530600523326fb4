"""A log that cannot be written ends the run with a line that names the file and the cause; no leaf is blamed for it,
and the plate is level."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from planar_rig import PATIENT, PlanarRig, known

from mazeplan.btree.blame import blames_a_node
from mazeplan.core.errors import LogError
from mazeplan.core.logs.run_log import RunLogWriter
from mazeplan.core.logs.run_log_reader import read_log
from mazeplan.maze.mapfile import load_map
from mazeplan.run.execution import run_job
from mazeplan.run.specification import Job, Setup

MAZE = load_map("cme")
FULL = "import resource, sys\nresource.setrlimit(resource.RLIMIT_FSIZE, (24_000, 24_000))\n"
NAVIGATE = "from mazeplan.apps.cli import main\nsys.argv = ['mazeplan', *sys.argv[1:]]\nmain()\n"


@pytest.fixture
def full_from(monkeypatch):
    """No chunk gets onto the disk from a message of a topic on, later than 0.3 s."""

    def begin(topic):
        plain = RunLogWriter.write

        def full(stream=None):
            raise OSError(28, "No space left on device")

        def write(self, name, t, document):
            if name == topic and t > 0.3 and self._whole:
                self._safely(full)
            plain(self, name, t, document)

        monkeypatch.setattr(RunLogWriter, "write", write)

    return begin


@pytest.mark.parametrize("topic", ["/event", "/plan", "/tick", "/status"])  # the first two come out of leaves
def test_a_full_disk_is_the_fault_of_the_log(tmp_path, full_from, topic):
    full_from(topic)
    rig, heard, log = PlanarRig(MAZE), [], tmp_path / "run.mcap"
    with pytest.raises(LogError) as caught:
        run_job(
            rig, Setup(MAZE, known(MAZE), settings=PATIENT), Job(3, 5, 0.3), log=log,
            feed=lambda topic, _, document: heard.append((topic, document)),
        )  # fmt: skip
    assert str(caught.value) == f"{log}: cannot be written: No space left on device"
    assert not hasattr(caught.value, "__notes__")
    assert not blames_a_node(caught.value)
    assert rig.levelled
    assert rig.u.tolist() == [[0.0, 0.0]]
    topic, told = heard[-1]  # the page goes on
    assert (topic, told["success"], told["reason"]) == ("/result", False, "log_failed")
    assert (told["failures"][-1]["where"], told["failures"][-1]["words"]) == ("log", str(caught.value))
    read = read_log(log)
    assert (read.complete, read.result) == (False, None)
    assert len(read.ticks["t"]) > 5  # what was written stays


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="needs limits of files")
def test_the_program_ends_with_one_line_and_exit_status_2(tmp_path):
    log = tmp_path / "run.mcap"
    words = ["navigate", "--from", "ring1", "--to", "ring5", "--rig", "ideal", "--log", str(log)]
    env = {name: value for name, value in os.environ.items() if "COVERAGE" not in name}  # its file would be full, too
    done = subprocess.run(
        [sys.executable, "-c", FULL + NAVIGATE, *words], capture_output=True, text=True, timeout=120, env=env
    )
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == f"mazeplan: --log: {log}: cannot be written: File too large"
    assert "Traceback" not in done.stderr
    assert "leaf" not in done.stderr
