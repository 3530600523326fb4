"""The rig on a table: the section `rig` of BENCHMARKS.md. Needs `make emulator`, and a machine that does nothing else.

Tilt calibration over drawn diodes; on the emulated rig (the real firmware in a simulated chip, rendered pictures,
MuJoCo) navigations, latencies against the true ones, round trips, and what the plate does when the program is killed.
"""

from __future__ import annotations

import csv
import math
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

from mazeplan.core.records import Array, NavigationResult
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.emulation.rig import EmulatedRig
from mazeplan.rigs.emulation.truth import Diode
from mazeplan.rigs.hardware import check as hardware_check
from mazeplan.rigs.hardware.latency import dead_time, picture_delay
from mazeplan.rigs.hardware.tiltcalibration import Reading, fit_tilt
from mazeplan.rigs.registry import PACKAGED, make_rig
from mazeplan.run.navigate import navigate

MAZE = load_map("cme")
SEEDS, DIODES, KILLS = 5, 200, 5
DELAYS_MS = (30.0, 50.0, 90.0)
LEVEL_US = 2.0
TILTS = np.linspace(-5.75, 5.75, 7)


def tilt_errors(seed: int) -> tuple[float, float, int, int]:
    """(worst and rms error in deg within 5 degrees, slips that were named, others that were) for one drawn diode, 49
    readings with .04 deg of noise, rounded to .1 deg, two of them with a wrong sign."""
    rng = np.random.default_rng(seed)
    diode, readings = Diode.drawn(rng), []
    for i, (beta, gamma) in enumerate((b, g) for b in TILTS for g in TILTS):
        first, second = diode.volts(math.radians(beta), math.radians(gamma))
        v = (first + rng.normal(0.0, 2e-3), second + rng.normal(0.0, 2e-3))
        said = np.round(np.array([beta, gamma]) + rng.normal(0.0, 0.04, 2), 1)
        readings.append(Reading(v, float(said[0]), float(said[1]), i))
    wrong = {int(i) for i in rng.choice(np.flatnonzero([abs(r.beta_deg) > 0.5 for r in readings]), 2, replace=False)}
    readings = [Reading(r.v, -r.beta_deg, r.gamma_deg, r.line) if r.line in wrong else r for r in readings]
    fit = fit_tilt(readings)
    angles = np.radians(np.linspace(-5.0, 5.0, 11))
    tilts = [(b, g) for b in angles for g in angles]
    off = np.degrees([np.array(fit.sensor.tilt(*diode.volts(*tilt))) - tilt for tilt in tilts])
    named = {(o.line, o.axis) for o in fit.outliers}
    slips = {(i, "beta") for i in wrong}
    return float(np.abs(off).max()), float(np.sqrt(np.mean(off**2))), len(named & slips), len(named - slips)


def tilt_rows(quick: bool) -> list[str]:
    count = 20 if quick else DIODES
    worst, rms, named, others = (np.array(column) for column in zip(*map(tilt_errors, range(count)), strict=True))
    return [
        "### Tilt calibration",
        "",
        f"{count} drawn diodes, each with 49 readings between -5.75 and 5.75 degrees, .04 degrees of noise, rounded to "
        ".1; two of them",
        "have a wrong sign. Errors against the true tilt, at 121 tilts within 5 degrees.",
        "",
        "| rms deg: median, worst | largest deg: median, 95 %, worst | diodes with more than .1 deg anywhere "
        "| slips named | others named |",
        "|---|---|---|---|---|",
        f"| {np.median(rms):.3f}, {rms.max():.3f} | {np.median(worst):.3f}, {np.percentile(worst, 95):.3f}, "
        f"{worst.max():.3f} | {np.sum(worst > 0.1)} of {count} | {named.sum()} of {2 * count} | {others.sum()} |",
        "",
    ]


# -- on the emulated rig ---------------------------------------------------------------------------------------------


def rig_file(folder: Path, **world: Any) -> Path:
    """The packaged emulated rig with another world."""
    data = yaml.safe_load((PACKAGED / "emulated.yaml").read_text())
    data["world"] |= world
    (folder / "emulated.png").write_bytes((PACKAGED / "emulated.png").read_bytes())
    (folder / "mine.yaml").write_text(yaml.safe_dump(data))
    return folder / "mine.yaml"


def traced(path: Path) -> Array:
    """t, pulse_beta_us, pulse_gamma_us, target_beta, target_gamma, beta, gamma, x, y: one row a step."""
    with path.open() as stream:
        rows = list(csv.reader(stream))[1:]
    return np.array([[float(v) for v in row] for row in rows if len(row) == 9])


def run(seed: int) -> tuple[NavigationResult, list[float]]:
    """One navigation, and its round trips, s."""
    rig = make_rig("emulated", MAZE)
    assert isinstance(rig, EmulatedRig)
    parts = rig.parts  # kept: the trips are read when the run is over
    result = navigate("ring1", "ring5", rig=rig, model="toy", seed=seed)
    return result, list(parts.trips)


def run_rows(quick: bool) -> list[str]:
    rows = [
        "### Runs",
        "",
        "`mazeplan navigate --from ring1 --to ring5 --rig emulated --seed N`; round trip: from a command to the report",
        "that confirms it.",
        "",
        "| seed | arrived | s | failures on the way | round trip ms: p50, p99, worst | tick ms: p50, p99 |",
        "|---|---|---|---|---|---|",
    ]
    trips: list[float] = []
    for seed in range(2 if quick else SEEDS):
        result, own = run(seed)
        trips += own
        ms = 1e3 * np.percentile(own, [50, 99, 100])
        failures = ", ".join(str(f.kind) for f in result.failures) or "none"
        tick = result.tick_ms or {"p50": math.nan, "p99": math.nan}
        rows.append(
            f"| {seed} | {'yes' if result.success else result.reason} | {result.time_s:.2f} | {failures} | "
            f"{ms[0]:.1f}, {ms[1]:.1f}, {ms[2]:.1f} | {tick['p50']:.1f}, {tick['p99']:.1f} |"
        )
        print(rows[-1], file=sys.stderr)
    ms = 1e3 * np.percentile(trips, [50, 99, 100])
    return [*rows, "", f"All round trips: p50 {ms[0]:.1f}, p99 {ms[1]:.1f}, worst {ms[2]:.1f} ms ({len(trips)}).", ""]


def latencies(delay_ms: float) -> tuple[float, float, float, float]:
    """(measured, true) delay of the camera and of commands, ms."""
    kept: dict[str, Any] = {}

    def keep_dead(*given: Array) -> Any:
        kept["sent"], kept["u"] = given[:2]
        return dead_time(*given)

    with tempfile.TemporaryDirectory() as folder:
        trace = Path(folder) / "trace.csv"
        rig = make_rig(str(rig_file(Path(folder), camera_delay_ms=delay_ms, trace=str(trace))), MAZE)
        assert isinstance(rig, EmulatedRig)
        hardware_check.dead_time, hardware_check.picture_delay = keep_dead, picture_delay
        try:
            found = hardware_check.measure(rig)
            assert rig.table is not None
            shown = np.array(rig.table.shown)
        finally:
            rig.close()
            hardware_check.dead_time = dead_time
        rows = traced(trace)
    true = 1e3 * float(np.median(shown[:, 2] - shown[:, 0]))
    return 1e3 * found.camera.seconds, true, 1e3 * found.command.seconds, 1e3 * reached(kept["sent"], kept["u"], rows)


def reached(sent: Array, u: Array, rows: Array) -> float:
    """By how much the servos' targets are later than the commands, s: the shift with the least squared difference."""
    grid = np.arange(sent[30], sent[-2], 1e-3)
    target = rows[np.searchsorted(rows[:, 0], grid, side="right") - 1, 3:5]
    shifts = np.arange(0.0, 0.06, 5e-4)
    costs = [np.sum((u[np.searchsorted(sent, grid - d, side="right") - 1] - target) ** 2) for d in shifts]
    return float(shifts[int(np.argmin(costs))])


def latency_rows(quick: bool) -> list[str]:
    rows = [
        "### Latency",
        "",
        "What `mazeplan rig check` measures with one swing of 10 s, against what the emulated table knows: from the",
        "shutter to the picture's arrival, and from a command to the servo's pulse.",
        "",
        "| tilt to pixels ms: measured, true | command to tilt ms: measured, true |",
        "|---|---|",
    ]
    for delay in DELAYS_MS[:1] if quick else DELAYS_MS:
        camera, true_camera, command, true_command = latencies(delay)
        rows.append(f"| {camera:.1f}, {true_camera:.1f} | {command:.1f}, {true_command:.1f} |")
        print(rows[-1], file=sys.stderr)
    return [*rows, ""]


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


def kill_rows(quick: bool) -> list[str]:
    trials = [trial for trial in (killed() for _ in range(1 if quick else KILLS)) if trial is not None]
    told = ", ".join(f"{1e3 * until:.0f}" for until, _ in trials)
    worst = max((tilt for _, tilt in trials), default=math.nan)
    return [
        "### kill -9 in the midst of a run",
        "",
        f"The servos' pulses are level for good after {told} ms ({len(trials)} trials); .2 s later the plate is level",
        f"to {worst:.2f} degrees.",
        "",
    ]


def rig_section(quick: bool) -> list[str]:
    """The section."""
    return [
        "## The rig on a table (emulated)",
        "",
        "Firmware in a simulated chip, a pseudo terminal, rendered pictures, the detector, MuJoCo's plate and ball,",
        "all at 30 Hz of the clock on the wall. The calibrations in use were made as those of a real rig are",
        "(tools/emulated_rig.py).",
        "",
        *run_rows(quick),
        *latency_rows(quick),
        *kill_rows(quick),
        *tilt_rows(quick),
    ]
