"""Roll-outs of plans in batches: the section `batch` of BENCHMARKS.md.

By the compiled step on one core and on two, by torch on the processor with one thread and two, and on a graphics card
where there is one; each figure is the best of three, 40 steps a roll-out.
"""

from __future__ import annotations

import math
import os
import sys
import time
from dataclasses import replace

import numpy as np

from mazeplan.maze.mapfile import load_map
from mazeplan.models.batch import Plans, RingBatch
from mazeplan.models.features import inputs
from mazeplan.models.gaussian_process import GaussianProcess
from mazeplan.models.modelfile import load_model
from mazeplan.physics.arrays import RingKinematics
from mazeplan.records import Array

RING, STEPS, TIMES = 2, 40, 3
SIZES, FEW = (256, 2048, 16384), (256,)
SPREAD = np.array([math.pi, 4.0, 0.08, 0.5, 0.08, 0.5])  # of starts: rad, rad/s
ROWS = 4000  # of a process as `learn` makes it where nothing else is asked for
WAYS = (("compiled", 1), ("compiled", 2), ("cpu", 1), ("cpu", 2), ("cuda", 1))
NAMES = {"compiled": "Numba", "cpu": "torch", "cuda": "torch, CUDA"}


def models() -> dict[str, RingBatch]:
    """What is rolled out, by name."""
    radius = load_map("cme").track_radius(RING)
    effects, learned = (
        RingBatch.of_model(load_model(name), RING, radius, device="compiled") for name in ("ideal", "toy")
    )
    assert learned.process is not None
    rows = len(learned.process)
    return {
        "effects alone (`ideal`)": effects,
        f"process of {rows} rows (`toy`)": learned,
        f"process of {ROWS} rows": replace(learned, process=wider(learned.process)),
    }


def wider(process: GaussianProcess) -> GaussianProcess:
    """The same process on ROWS rows, drawn at random, with the values that it has there."""
    theta, theta_dot, beta, beta_dot, gamma, gamma_dot = (
        SPREAD * np.random.default_rng(2).uniform(-1.0, 1.0, (ROWS, 6))
    ).T
    zero = np.zeros(ROWS)
    x = inputs(RingKinematics(0.07, theta, theta_dot, beta, beta_dot, zero, gamma, gamma_dot, zero))
    hyper = replace(process.hyper, weight_sigma=np.zeros(0))
    return GaussianProcess.condition(hyper, x, np.zeros((ROWS, 0)), process.mean(x))


def drawn(count: int) -> tuple[Array, Plans]:
    """Starts and commands, at random."""
    rng = np.random.default_rng(0)
    commands = np.cumsum(rng.normal(0.0, 0.02, (count, STEPS, 2)), axis=1)
    return SPREAD * rng.uniform(-1.0, 1.0, (count, 6)), Plans(commands)


def there(device: str, threads: int) -> bool:
    """Whether this machine has it."""
    if device == "compiled":
        return threads <= len(os.sched_getaffinity(0))
    import torch

    return torch.cuda.is_available() if device == "cuda" else threads <= len(os.sched_getaffinity(0))


def timed(batch: RingBatch, starts: Array, plans: Plans) -> tuple[float, Array]:
    """Roll-outs a second, and the states."""
    batch.roll_out(starts[:8], Plans(plans.commands[:8]))  # compiled, and the card awake
    best, out = math.inf, starts
    for _ in range(TIMES):
        began = time.perf_counter()
        out = batch.roll_out(starts, plans)
        best = min(best, time.perf_counter() - began)
    return len(starts) / best, out


def batch_section(quick: bool) -> list[str]:
    import torch

    sizes = FEW if quick else SIZES
    before, rows, worst = torch.get_num_threads(), [], 0.0
    for name, model in models().items():
        model = replace(model, limit=load_map("cme").tilt_limit)
        for size in sizes:
            starts, plans = drawn(size)
            cells, exact = [], starts
            for device, threads in WAYS:
                if not there(device, threads):
                    cells.append("not on this machine")
                    continue
                torch.set_num_threads(threads)
                rate, out = timed(replace(model, device=device, threads=threads), starts, plans)
                cells.append(f"{rate:,.0f}")
                exact = out if (device, threads) == WAYS[0] else exact
                worst = max(worst, float(np.abs(out - exact).max()))
            rows.append(f"| {name} | {size} | {' | '.join(cells)} |")
            print(rows[-1], file=sys.stderr)
    torch.set_num_threads(before)
    heads = [f"{NAMES[device]}{'' if device == 'cuda' else f', {n} core' + 's' * (n > 1)}" for device, n in WAYS]
    return [
        "## Plans rolled out in batches",
        "",
        f"Roll-outs a second of random plans of {STEPS} steps in ring {RING}, best of {TIMES}. Numba leaves out rows",
        "of a process that cannot matter at an angle; torch sums up all of them.",
        "",
        f"| model | batch | {' | '.join(heads)} |",
        "|---" * (2 + len(heads)) + "|",
        *rows,
        "",
        f"Largest difference of any state from that of Numba on one core, in all of these: {worst:.1e} rad or rad/s.",
    ]
