"""Section `rig`: navigations on the emulated rig (firmware on a simulated chip, rendered pictures, simulated plate) in
real time, and what the plate does when the program is killed. Needs `make emulator`, and a machine without other work.
"""

from __future__ import annotations

import csv
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from bench_kit import ROOT, Section, Table, counts

from mazeplan.core.records import Array
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.registry import make_rig
from mazeplan.run.execution import navigate

RIG = ROOT / "tools" / "emulated.yaml"
SEEDS, KILLS = 5, 5
LEVEL_US = 2.0  # us; a pulse this near to that of the level plate is level


def rig_file(folder: Path, **world: Any) -> Path:
    """A copy of the emulated rig with other settings of its world."""
    data = yaml.safe_load(RIG.read_text())
    data["world"] |= world
    data["model"] = "toy"
    (folder / "emulated.png").write_bytes(RIG.with_suffix(".png").read_bytes())
    (folder / "mine.yaml").write_text(yaml.safe_dump(data))
    return folder / "mine.yaml"


def traced(path: Path) -> Array:
    """t, pulse_beta_us, pulse_gamma_us, target_beta, target_gamma, beta, gamma, x, y: one row a step."""
    with path.open() as stream:
        rows = list(csv.reader(stream))[1:]
    return np.array([[float(v) for v in row] for row in rows if len(row) == 9])


def killed() -> tuple[float, float] | None:
    """(s from a kill -9 in the midst of a run until the pulses are level for good, tilt in deg of the plate then .25 s
    after the kill); None when the plate was level anyhow."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rig_file(folder, trace=str(folder / "trace.csv"), linger_s=1.5)
        command = [sys.executable, "-m", "mazeplan", "navigate", "--rig", "mine.yaml"]
        root = str(Path(__file__).resolve().parent.parent)
        environment = {**os.environ, "PYTHONPATH": root}
        with subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True, env=environment) as process:
            assert process.stderr is not None
            for line in process.stderr:
                if "in ring 1" in line:
                    break
            time.sleep(0.5)
            process.send_signal(signal.SIGKILL)
            when = time.monotonic()
        time.sleep(2.5)
        rows = traced(folder / "trace.csv")
    level = rows[-1, 1:3]
    off = np.abs(rows[:, 1:3] - level).max(axis=1) > LEVEL_US
    if not off[np.searchsorted(rows[:, 0], when) - 1]:
        return None
    until = float(rows[np.flatnonzero(off)[-1] + 1, 0]) - when
    after = float(np.degrees(np.abs(rows[np.searchsorted(rows[:, 0], when + until + 0.2), 5:7]).max()))
    return until, after


def rig_section(quick: bool) -> Section:
    """A row for each run, and the times after a kill."""
    runs = Table(("seed", "arrived", "s", "failures on the way", "tick ms: p50, p99"))
    for seed in range(2 if quick else SEEDS):
        rig: Any = make_rig(str(RIG), load_map("cme"))
        result = navigate("ring1", "ring5", rig=rig, model="toy", seed=seed)
        failures = counts({str(f.kind): 1 for f in result.failures})
        arrived = "yes" if result.success else result.reason
        tick = f"{result.tick_ms['p50']:.1f}, {result.tick_ms['p99']:.1f}"
        runs.add(seed, arrived, f"{result.time_s:.2f}", failures, tick)
    kills = Table(("kill -9 in a run: trial", "level pulses after ms", "tilt 0.2 s later, deg"))
    for trial in range(1 if quick else KILLS):
        found = killed()
        if found is not None:
            kills.add(trial, f"{1e3 * found[0]:.0f}", f"{found[1]:.2f}")
    notes = (
        "`mazeplan navigate --from ring1 --to ring5 --rig tools/emulated.yaml --seed N`, at 30 Hz by the clock on the",
        "wall.",
    )
    return Section("The rig on a table (emulated)", notes, (runs, kills))
