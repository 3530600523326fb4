"""Every command in the README runs as it stands there, and does what it says."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = [block.splitlines() for block in re.findall(r"```console\n(.*?)```", README, re.DOTALL)]
YAML = re.findall(r"```yaml\n(.*?)```", README, re.DOTALL)
PYTHON = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
COMMANDS = [[line.removeprefix("$ ") for line in block if line.startswith("$ ")] for block in BLOCKS]


def run(command: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    words = shlex.split(command)
    if words[0] == "mazeplan":
        words = [sys.executable, "-m", "mazeplan", *words[1:]]
    return subprocess.run(words, cwd=cwd, capture_output=True, text=True, timeout=120, check=False)


@pytest.fixture
def desk(tmp_path):
    (tmp_path / "runs").mkdir()
    for folder in ("maps", "behaviors"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    (tmp_path / "runs" / "faults.yaml").write_text(YAML[0], encoding="utf-8")
    (tmp_path / "my_leaves.py").write_text(PYTHON[1], encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize("block", COMMANDS, ids=lambda block: block[0].split()[1])
def test_commands_of_one_block_run_in_order(block, desk):
    assert block
    for command in block:
        done = run(command, desk)
        assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
        for word in shlex.split(command):
            if word.startswith("runs/") and "-o" in command:
                assert (desk / word).exists(), f"{command} did not write {word}"


def test_python_example(desk):
    done = subprocess.run([sys.executable, "-c", PYTHON[0]], cwd=desk, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("True ")


def test_rig_example_has_what_a_rig_needs():
    from mazeplan.maze.mapfile import load_map
    from mazeplan.rigs.interface import Rig

    names: dict = {}
    exec(PYTHON[2], names)
    assert isinstance(names["MyRig"](load_map("cme"), {}), Rig)


def test_the_error_shown_is_the_error_got(desk):
    shown = re.search(r"`runs/mine\.yaml:\d+: (openings\[\d+\]\.angle_deg: [^`]*)`", README)
    assert shown
    text = (ROOT / "maps" / "cme.yaml").read_text(encoding="utf-8")
    lines = text.splitlines()
    index = int(re.search(r"openings\[(\d+)\]", shown.group(1)).group(1))
    rows = [i for i, line in enumerate(lines) if "angle_deg:" in line and not line.lstrip().startswith("#")]
    lines[rows[index]] = re.sub(r"angle_deg: *[\d.]+", "angle_deg: 400", lines[rows[index]])
    (desk / "runs" / "mine.yaml").write_text("\n".join(lines), encoding="utf-8")
    done = run("mazeplan map check runs/mine.yaml", desk)
    assert done.returncode == 2
    assert shown.group(0).strip("`") in done.stderr + done.stdout


def test_json_is_one_document_with_the_names_of_the_contract(desk):
    done = run("mazeplan navigate --from ring4 --to ring5 --rig ideal --json", desk)
    document = json.loads(done.stdout)
    wanted = {"success", "reason", "time_s", "seed", "rig", "rings", "failures", "replans", "planner_ms", "log"}
    assert wanted <= set(document)
    assert set(document["rings"][0]) == {"ring", "time_s", "opening"}
    assert {"p50", "p99", "max"} <= set(document["planner_ms"])
    assert document["success"] is True
    assert done.returncode == 0
