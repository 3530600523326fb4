"""Roll-outs of plans in batches: the section `batch` of BENCHMARKS.md.

By the compiled step on one core and on two; each figure is the best of three, 40 steps a roll-out.
"""

from __future__ import annotations

import math
import os
import sys
import time
from dataclasses import replace

import numpy as np

from mazeplan.core.records import Array
from mazeplan.learning.batch import Plans, RingBatch
from mazeplan.learning.features import inputs
from mazeplan.learning.gaussian_process import GaussianProcess
from mazeplan.learning.modelfile import load_model
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.formulas.arrays import RingKinematics

RING, STEPS, TIMES = 2, 40, 3
SIZES, FEW = (256, 2048, 16384), (256,)
SPREAD = np.array([math.pi, 4.0, 0.08, 0.5, 0.08, 0.5])  # of starts: rad, rad/s
ROWS = 4000  # of a process as `learn` makes it where nothing else is asked for
THREADS = (1, 2)


def models() -> dict[str, RingBatch]:
    """What is rolled out, by name."""
    radius = load_map("cme").track_radius(RING)
    effects, learned = (RingBatch.of_model(load_model(name), RING, radius) for name in ("ideal", "toy"))
    assert isinstance(learned.process, GaussianProcess)
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


def timed(batch: RingBatch, starts: Array, plans: Plans) -> float:
    """Roll-outs a second."""
    batch.roll_out(starts[:8], Plans(plans.commands[:8]))  # compiles
    best = math.inf
    for _ in range(TIMES):
        began = time.perf_counter()
        batch.roll_out(starts, plans)
        best = min(best, time.perf_counter() - began)
    return len(starts) / best


def batch_section(quick: bool) -> list[str]:
    sizes = FEW if quick else SIZES
    cores, rows = len(os.sched_getaffinity(0)), []
    for name, model in models().items():
        model = replace(model, limit=load_map("cme").tilt_limit)
        for size in sizes:
            starts, plans = drawn(size)
            rates = [timed(replace(model, threads=n), starts, plans) if n <= cores else None for n in THREADS]
            cells = ["not on this machine" if rate is None else f"{rate:,.0f}" for rate in rates]
            rows.append(f"| {name} | {size} | {' | '.join(cells)} |")
            print(rows[-1], file=sys.stderr)
    heads = [f"{n} core" + "s" * (n > 1) for n in THREADS]
    return [
        "## Plans rolled out in batches",
        "",
        f"Roll-outs a second of random plans of {STEPS} steps in ring {RING}, best of {TIMES}.",
        "",
        f"| model | batch | {' | '.join(heads)} |",
        "|---" * (2 + len(heads)) + "|",
        *rows,
    ]
