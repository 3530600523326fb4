"""Section `realtime`: ticks by the clock on the wall on a machine that does other work."""

from __future__ import annotations

import gc
import math
import multiprocessing
import os
import tempfile
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from unittest import mock

import numpy as np
from bench_kit import Section, arrivals
from bench_kit import Table as Figures

from mazeplan.core.records import NavigationResult, Observation
from mazeplan.rigs.interface import Rig, RigWrapper
from mazeplan.rigs.paced import PacedRig
from mazeplan.run.execution import navigate

SHARE, LATE_S = 0.05, 0.05  # of the pictures, so much later than the others
PERIOD_MS = 1e3 / 30.0
SEED = 700
CORES = len(os.sched_getaffinity(0))
WAYS = ("quiet", "busy", "busy, collector as Python has it")


class Table(RigWrapper):
    """A simulated rig whose world goes on while the program computes: a command that comes one sample late or more
    begins to act that much later, and the samples between are lost. Some pictures are late. ticks: ms from each sample
    to its command."""

    realtime = False

    def __init__(self, rig: Rig, ticks: list[float]) -> None:
        super().__init__(PacedRig(rig))
        self._ticks, self._sampled = ticks, math.nan
        self._past = deque[Observation](maxlen=1 + math.ceil(LATE_S * rig.rate_hz))

    def reset(self, *, ring: int, theta: float, rng: np.random.Generator) -> None:
        """As the rig inside."""
        self._rng = np.random.default_rng(rng.integers(2**32))
        self._past.clear()
        self._sampled = math.nan
        super().reset(ring=ring, theta=theta, rng=rng)

    def observe(self) -> Observation:
        """The next sample, when it is due; its picture may be an old one."""
        sample = super().observe()
        self._past.append(sample)
        if self._rng.random() < SHARE:
            old = min(self._past, key=lambda past: abs(past.t - (sample.t - LATE_S)))
            sample = replace(sample, x=old.x, y=old.y)
        self._sampled = perf_counter()
        return sample

    def command(self, u_beta: float, u_gamma: float) -> None:
        """As the rig inside, when the world has come as far as the clock."""
        if math.isfinite(self._sampled):
            took_ms, self._sampled = 1e3 * (perf_counter() - self._sampled), math.nan
            self._ticks.append(took_ms)
            for _ in range(int(took_ms / PERIOD_MS)):
                self._past.append(super().observe())
        super().command(u_beta, u_gamma)


def _compute() -> None:
    while True:
        pass


@contextmanager
def _load(way: str) -> Iterator[None]:
    """The other work of the machine."""
    others = [] if way == WAYS[0] else [multiprocessing.Process(target=_compute, daemon=True) for _ in range(CORES)]
    with ExitStack() as stack:
        if way == WAYS[2]:
            stack.enter_context(mock.patch.object(gc, "freeze"))
        for other in others:
            other.start()
            stack.callback(other.kill)
        yield


def runs_of(way: str, runs: int) -> tuple[list[NavigationResult], np.ndarray]:
    """Runs on the toy with their logs, and all ticks, ms."""
    ticks: list[float] = []
    results = []
    navigate(1, 5, rig="toy", seed=SEED)  # compiles
    with tempfile.TemporaryDirectory() as folder, _load(way):
        for k in range(runs):
            log = Path(folder) / f"{k}.mcap"
            results.append(navigate(1, 5, rig="toy", seed=SEED + k, log=log, around=lambda rig: Table(rig, ticks)))
    return results, np.array(ticks)


def realtime_section(quick: bool) -> Section:
    """A row for each way."""
    runs = 3 if quick else 100
    table = Figures(("machine", "arrived", "mean s", "ticks", "p50 ms", "p99 ms", "longest ms", "beyond 33 ms"))
    for way in WAYS:
        results, ticks = runs_of(way, runs)
        arrived, times, _ = arrivals(results)
        beyond, percentiles = int((ticks > PERIOD_MS).sum()), np.percentile(ticks, [50, 99, 100])
        ms, late = (f"{x:.1f}" for x in percentiles), f"{beyond} ({100.0 * beyond / len(ticks):.2f} %)"
        table.add(way, arrived, f"{np.mean(times or [math.nan]):.2f}", len(ticks), *ms, late)
    notes = (
        f"Rig `toy` at 30 Hz by the clock on the wall, {runs} runs a row with their logs, seeds from {SEED}.",
        "The world goes on while the program computes: a late command acts late, and samples between are lost.",
        f"Every twentieth picture is {1e3 * LATE_S:.0f} ms older than the others.",
        f"Busy: {CORES} processes compute without end on {CORES} cores, at the same priority.",
        "The last row is without `gc.freeze`, which keeps old objects away from Python's garbage collector.",
    )
    return Section("Real time on a busy machine (simulated rig)", notes, (table,))
