"""Section `campaign`: runs a second of `evaluate` with one worker and with two workers.

Both ways do the same runs in turn, a block each, so that other work on the machine slows all of them. The start
of the workers is measured by itself, with one run for each worker, and subtracted from each block.
"""

from __future__ import annotations

import time
from typing import Any

from bench_kit import Section, Table, mazeplan

BLOCK, BLOCKS = 250, 4
WAYS = {
    "one worker": (),
    "two workers": ("--workers", "2"),
}
CLOCKS = ("planner_ms", "tick_ms", "log")  # of a result: what differs from one computer to the next


def runs(way: str, first: int, count: int) -> tuple[float, list[dict[str, Any]]]:
    """Wall time of a campaign on the toy, s, and its results without what the clock says."""
    began = time.perf_counter()
    words = ("--rig", "toy", "--runs", str(count), "--seed", str(first), "--no-deadline")
    document = mazeplan("evaluate", *words, *WAYS[way])
    seconds = time.perf_counter() - began
    return seconds, [{k: v for k, v in run.items() if k not in CLOCKS} for run in document["results"]]


def campaign_section(quick: bool) -> Section:
    """Runs a second, and whether the results are the same."""
    size, count = (8, 2) if quick else (BLOCK, BLOCKS)
    start = {way: min(runs(way, 0, 2)[0] for _ in range(2)) for way in WAYS}
    seconds: dict[str, list[float]] = {way: [] for way in WAYS}
    results: dict[str, list[dict[str, Any]]] = {way: [] for way in WAYS}
    for block in range(count):
        turn = block % len(WAYS)
        for way in [*WAYS][turn:] + [*WAYS][:turn]:
            took, done = runs(way, block * size, size)
            seconds[way].append(took - start[way])
            results[way] += done
    table = Table(("way", "start, s", "runs", "runs a second", "of one worker", "results"))
    one = sum(seconds["one worker"])
    for way, took in seconds.items():
        same = "the same" if results[way] == results["one worker"] else "NOT THE SAME"
        rate = count * (size - 2) / sum(took)
        table.add(way, f"{start[way]:.1f}", len(results[way]), f"{rate:.3f}", f"{one / sum(took):.2f}", same)
    notes = (
        f"`mazeplan evaluate --rig toy --runs {size} --no-deadline --workers K`, {count} blocks in turn.",
        "Start: wall time of a command of two runs.",
    )
    return Section("Campaigns", notes, (table,))
