"""Two faults in one run, drawn at random: the section `pairs` of BENCHMARKS.md.

Usage: python tools/bench_pairs.py [--quick].
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np

from mazeplan.rigs.faults.kinds import KINDS
from mazeplan.rigs.faults.schedule import Entry, FaultTrial
from mazeplan.run.campaign.evaluate import Campaign
from mazeplan.run.campaign.faults import IDLE_S, Outcome, run_trial

SEED = 9000  # of the pairs, and of the first run; none of them was looked at while the program was made
SURVIVABLE = tuple(name for name, kind in KINDS.items() if not kind.because)


def drawn_pairs(count: int, seed: int = SEED) -> list[FaultTrial]:
    """Pairs of faults that a run can survive, each kind as likely as any other, also twice."""
    chosen = np.random.default_rng(seed).integers(len(SURVIVABLE), size=(count, 2))
    pairs = [(SURVIVABLE[a], SURVIVABLE[b]) for a, b in chosen]
    return [
        FaultTrial(f"{number}: {first} + {second}", (Entry(kind=first), Entry(kind=second)))
        for number, (first, second) in enumerate(pairs)
    ]


def ran(trial: FaultTrial, number: int) -> Outcome:
    """A run of a trial, with a seed and so a start of its own."""
    return run_trial(Campaign(runs=1, start=1, rig="toy", seed=SEED + number), trial, 0)


def pairs_section(quick: bool) -> list[str]:
    """Everything, as lines of Markdown."""
    trials = drawn_pairs(20 if quick else 1000)
    began = time.monotonic()
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        outcomes = list(pool.map(ran, trials, range(len(trials)), chunksize=4))
    return lines(trials, outcomes, time.monotonic() - began)


def lines(trials: Sequence[FaultTrial], outcomes: Sequence[Outcome], took_s: float) -> list[str]:
    """The section, of outcomes in the order of their trials."""
    arrived = [outcome.result.time_s for outcome in outcomes if outcome.result.success]
    both = sum(len(outcome.faults) == 2 for outcome in outcomes)
    wrong = [what for outcome in outcomes for what in outcome.wrong]
    stopped = Counter(outcome.result.reason for outcome in outcomes if not outcome.result.success)
    failed = [
        f"| {trial.name.partition(': ')[2]} | {outcome.result.seed} | {outcome.result.reason} | "
        f"{'; '.join(outcome.wrong) or '-'} |"
        for trial, outcome in zip(trials, outcomes, strict=True)
        if not outcome.result.success or outcome.wrong
    ]
    table = ["", "| pair | seed | ended | wrong |", "|---|---|---|---|", *failed] if failed else []
    return [
        "## Two faults in one run (simulated)",
        "",
        f"`tools/bench_pairs.py`: {len(trials)} pairs of the {len(SURVIVABLE)} kinds of fault that can be survived, on "
        f"the toy, drawn with seed {SEED};",
        "moments, lengths and sizes as their kinds draw them. Both faults came before the end in "
        f"{both} runs. It took {took_s / 60.0:.0f} minutes.",
        "",
        f"- arrived: {len(arrived)} of {len(outcomes)}, after {np.mean(arrived):.2f} s on average, "
        f"{np.max(arrived):.2f} s at most",
        f"- ended otherwise, by name: {_counts(stopped)}",
        f"- ended without a name: {sum('ended with' in what for what in wrong)}; commands beyond the limits: "
        f"{sum('command (' in what for what in wrong)}; plates not level 1 s after the end: "
        f"{sum('plate' in what for what in wrong)}; rigs not called for {IDLE_S:.0f} s: "
        f"{sum('no call' in what for what in wrong)}",
        *table,
    ]


def _counts(counts: Counter[str]) -> str:
    return ", ".join(f"{what} {count}" for what, count in counts.most_common()) or "none"


if __name__ == "__main__":
    print("\n".join(pairs_section("--quick" in sys.argv)))
