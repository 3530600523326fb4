"""Networks beside Gaussian processes: errors, calibration, time and memory of training, and navigation on a model with
networks. Used by tools/bench.py."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from bench_models import ROOT, Mazeplan, collect_toy, data_folder

KINDS = ("pi", "np", "sp", "nn", "spnn")
TRAINING = """
import json, resource, sys, time
from dataclasses import replace
from mazeplan.core.logs.table import read_table
from mazeplan.learning.comparison import by_ring, prepare
from mazeplan.learning.fitting import NETWORKS, FitOptions, fit_kind
from mazeplan.learning.ring_scores import THOROUGH, CompareOptions
from mazeplan.learning.samples import SampleOptions
from mazeplan.learning.split import uniform_downsample
from mazeplan.maze.mapfile import load_map
kind, maze, options = sys.argv[2], load_map("cme"), CompareOptions()
data = prepare(by_ring([read_table(sys.argv[1])], maze, options, SampleOptions(ring=2))[2], None, options)
fit = FitOptions(inputs="local", heavy_tails=True, training=replace(THOROUGH, family="exponential"))
rows = data.train_rows
rows = rows if kind in NETWORKS else rows[uniform_downsample(len(rows), fit.most)]
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
began = time.process_time()
fit_kind(kind, data.train, rows, fit)
took = time.process_time() - began
print(json.dumps([len(rows), took, (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 2**10]))
"""


def neural_section(mazeplan: Mazeplan, quick: bool) -> list[str]:
    """Errors of roll-outs and calibration by kind, cost of the training, and runs on a model with networks."""
    log, command = collect_toy(quick)
    rows = [
        "## Networks and Gaussian processes",
        "",
        f"`mazeplan compare LOG --kinds {','.join(KINDS)}`, on the measured tables and on the log of",
        f"`{command}` (simulated).",
        "Test blocks as in the sections on models. The size of the networks (10 of 2 x 16 units) was chosen by the",
        "blocks that its members leave out, on ring 3 of the measured tables, after a look at its test blocks. Beside",
        "each error of the angle: the share of measured angles in the",
        "90 % band of the roll-outs.",
        "",
    ]
    folder = data_folder()
    if folder is not None:
        names = [str(folder / f"ring{n}.csv") for n in (1, 2, 3, 4)]
        rows += [*_errors("measured", mazeplan("compare", *names, "--kinds", ",".join(KINDS))), ""]
    rows += [*_errors("toy", mazeplan("compare", str(log), "--kinds", ",".join(KINDS))), ""]
    return [*rows, *_training(log), "", *_runs(mazeplan, log, quick)]


def _errors(what: str, got: dict[str, Any]) -> list[str]:
    """A table of one comparison: after 40 samples, and nRMSE of theta_dd on test rows."""
    head = " | ".join(KINDS)
    rows = [f"| {what}: theta error after 40 samples, rad (share in the band) | {head} |", "|---" * 6 + "|"]
    for ring, s in got.items():
        sure = s.get("confidence", {})
        cells = [f"{s['rollout'][k]['40']:.3f} ({100 * sure[k]['coverage40']:.0f} %)" for k in KINDS]
        rows.append(f"| {ring}: {s['windows']} windows, {s['windows_chosen']} | {' | '.join(cells)} |")
    rows += ["", f"| {what}: nRMSE of theta_dd, test | {head} |", "|---" * 6 + "|"]
    for ring, s in got.items():
        cells = [f"{s['nrmse_test'][k]:.3f}" for k in KINDS]
        rows.append(f"| {ring} | {' | '.join(cells)} |")
    return rows


def _training(log: Path) -> list[str]:
    """Rows, processor time and memory of one ring, each kind in a program of its own."""
    rows = ["| training, ring 2 of the toy | rows | processor time s | memory added MiB |", "|---|---|---|---|"]
    for kind in KINDS:
        done = subprocess.run(
            [sys.executable, "-c", TRAINING, str(log), kind], capture_output=True, text=True, check=True, cwd=ROOT
        )
        n, seconds, mib = json.loads(done.stdout)
        rows.append(f"| {kind} | {n} | {seconds:.1f} | {mib:.0f} |")
    return rows


def _runs(mazeplan: Mazeplan, log: Path, quick: bool) -> list[str]:
    """Navigation with the packaged model (sp) and with networks learned from the log."""
    model, few = ROOT / "build" / "toy_networks", "4" if quick else "32"
    mazeplan("learn", str(log), "-o", str(model), "--kind", "spnn", "--force")
    rows = ["| toy, simulated | arrived | mean s | plan p50 / p99 ms |", "|---|---|---|---|"]
    for name, given in (("packaged (sp)", "toy"), ("spnn, learned from this log", str(model))):
        got = mazeplan("evaluate", "--rig", "toy", "--model", given, "--runs", few)
        mean, ms = got["time_s"]["mean"], got["planner_ms"]
        cells = f"{'-' if mean is None else f'{mean:.2f}'} | {ms['p50']:.2f} / {ms['p99']:.2f}"
        rows.append(f"| {name} | {got['success']}/{got['runs']} | {cells} |")
    return rows
