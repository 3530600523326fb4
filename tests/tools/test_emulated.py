"""Firmware, serial line, pixels and physics in one chain, in real time: run by themselves, as nothing may starve them.

What must be true is judged here, not milliseconds; figures are in BENCHMARKS.md (tools/bench.py --only rig).
"""

from __future__ import annotations

import contextlib
import csv
import itertools
import json
import os
import signal
import subprocess
import sys
import time
from collections import deque
from pathlib import Path

import numpy as np
import pytest
import yaml
from commands import call
from emulated_chip import EMULATED, NEEDED
from emulator.chip import built
from emulator.rig import EmulatedRig

from mazeplan.core.errors import RigError
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.hardware import check as hardware_check
from mazeplan.rigs.registry import make_rig
from mazeplan.run.navigate import navigate

pytestmark = pytest.mark.realtime
MAZE = load_map("cme")


@pytest.fixture(autouse=True)
def _built():
    try:
        built()
    except RigError as missing:
        if NEEDED:
            raise
        pytest.skip(str(missing))


def rig_file(folder: Path, **world) -> Path:
    """The packaged emulated rig with another world."""
    data = yaml.safe_load(EMULATED.read_text())
    data["world"] |= world
    (folder / "emulated.png").write_bytes(EMULATED.with_suffix(".png").read_bytes())
    (folder / "mine.yaml").write_text(yaml.safe_dump(data))
    return folder / "mine.yaml"


def trace(folder: Path) -> np.ndarray:
    """t, pulse_beta_us, pulse_gamma_us, target_beta, target_gamma, beta, gamma, x, y: one row a step."""
    with (folder / "trace.csv").open() as stream:
        rows = list(csv.reader(stream))[1:]
    return np.array([[float(v) for v in row] for row in rows if len(row) == 9])


def test_the_ball_is_driven_through_the_whole_chain(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    arguments = ["navigate", "--rig", str(EMULATED), "--from", "ring4", "--to", "ring5", "--json", "--log", "run.mcap"]
    code, out, err = call(monkeypatch, capsys, *arguments)
    result = json.loads(out)
    assert (code, result["success"]) == (0, True), err
    assert result["rig"] == "emulated"
    code, out, _ = call(monkeypatch, capsys, "log", "replay", "run.mcap")
    assert code == 0, out


@pytest.mark.parametrize("seed", range(5))
def test_it_arrives_from_ring_1(seed):
    """At the second time where this machine was kept from giving pictures at the first: BENCHMARKS.md counts those."""
    for last in (False, True):
        rig = make_rig(str(EMULATED), MAZE)
        try:
            result = navigate("ring1", "ring5", rig=rig, model="toy", seed=seed)
        except RigError:
            if last:
                raise
            continue
        finally:
            rig.close()
        if result.success:
            break
    assert result.success, (result.reason, result.failures)
    assert [leg.ring for leg in result.rings][-1] == 5


def test_the_walk_through_the_parts(monkeypatch):
    for name, seconds in (("LOOK_S", 0.2), ("SETTLE_S", 0.6)):
        monkeypatch.setattr(hardware_check, name, seconds)
    rig = make_rig(str(EMULATED), MAZE)
    assert isinstance(rig, EmulatedRig)
    asked = []
    try:
        going = hardware_check.HardwareCheck(rig, lambda question: asked.append(question) or True)
        results = list(going.steps())
    finally:
        rig.close()
    names = [
        "port",
        "firmware",
        "beta servo",
        "gamma servo",
        "calibrations",
        "tilt sensor",
        "camera",
        "markers",
        "ball",
    ]
    assert [r.name for r in results] == names
    assert [r for r in results if not r.passed and r.name != "camera"] == []  # which needs a quiet machine
    assert len(asked) == 2


def test_a_program_that_is_killed_leaves_a_level_plate(tmp_path):
    rig_file(tmp_path, trace=str(tmp_path / "trace.csv"), linger_s=1.5)
    with subprocess.Popen(
        [sys.executable, "-m", "mazeplan", "navigate", "--rig", "mine.yaml"], cwd=tmp_path, stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}, text=True,
    ) as process:  # fmt: skip
        assert process.stderr is not None
        for line in process.stderr:
            if "in ring 1" in line:
                break
        time.sleep(0.6)
        process.send_signal(signal.SIGKILL)
        killed = time.monotonic()
    time.sleep(2.5)
    rows = trace(tmp_path)
    tilted = np.degrees(np.abs(rows[:, 5:7]).max(axis=1))
    assert tilted[(rows[:, 0] > killed - 0.5) & (rows[:, 0] < killed)].max() > 0.5  # it was driving
    assert tilted[rows[:, 0] > killed + 0.8].size > 0
    assert tilted[rows[:, 0] > killed + 0.8].max() < 0.3


def group(rig) -> dict[str, int]:
    """Processes of a rig's table by what they are: world, emulator."""
    found = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            text = stat.read_text()
            name, fields = text[text.index("(") + 1 : text.rindex(")")], text[text.rindex(")") + 2 :].split()
            if int(fields[2]) == rig and fields[0] != "Z":
                found["emulator" if name.startswith("emulator") else "world"] = int(stat.parent.name)
    return found


def test_a_table_that_is_frozen_or_killed_ends_soon_and_leaves_nothing():
    """Each of its two processes, by each signal; what is left are neither processes nor files."""
    for who, how in itertools.product(("world", "emulator"), (signal.SIGSTOP, signal.SIGKILL)):
        rig = make_rig(str(EMULATED), MAZE)
        assert isinstance(rig, EmulatedRig)
        for _ in range(5):
            rig.observe()
        assert rig.table is not None
        leader, folder = rig.table.process_id, Path(rig.table.port).parent
        processes = group(leader)
        assert set(processes) == {"world", "emulator"}
        assert folder.exists()
        os.kill(processes[who], how)
        began = time.monotonic()
        with pytest.raises(RigError) as caught:
            deque(iter(rig.observe, None), maxlen=0)
        with contextlib.suppress(RigError):
            rig.level()
        rig.close()
        assert time.monotonic() - began < 8.0, (who, how)
        if how is signal.SIGKILL:
            said = {"world": "the emulated table ended by SIGKILL", "emulator": "the emulated board ended by SIGKILL"}
            assert str(caught.value) == said[who]
        else:
            assert str(caught.value).startswith("the emulated table hangs, or this machine is too slow for it: ")
        time.sleep(0.2)
        assert group(leader) == {}, (who, how)
        assert not folder.exists(), (who, how)
