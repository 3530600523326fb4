"""Section `navigation`: other seeds, directions, maps and rings, and the start of the program."""

from __future__ import annotations

import subprocess
import sys
import time

from bench_kit import ROOT, Section, Table, counts, mazeplan


def navigation_section(quick: bool) -> Section:
    """Arrivals of `evaluate` on the toy and on a second map, and wall times of whole commands."""
    runs = ("--runs", "4" if quick else "16")
    table = Table(("what", "command", "arrived", "mean s", "best", "p50", "p95", "worst", "failures on the way"))
    for what, *words in (
        ("other noise", "--rig", "toy", *runs, "--seed", "1000"),
        ("outwards", "--rig", "toy", "--from", "ring5", "--to", "ring1", *runs),
        ("second map", "--rig", "toy", "--map", "lopsided", *runs),
        ("second map, outwards", "--rig", "toy", "--map", "lopsided", "--from", "ring3", "--to", "ring1", *runs),
    ):
        got = mazeplan("evaluate", *words)
        times = [got["time_s"][key] for key in ("mean", "best", "p50", "p95", "worst")]
        cells = ["-" if seconds is None else f"{seconds:.2f}" for seconds in times]
        arrived = f"{got['success']}/{got['runs']}"
        table.add(what, f"`mazeplan evaluate {' '.join(words)}`", arrived, *cells, counts(got["failures"]))
    start = Table(("command", "median of 5, s"), caption="Start of the program")
    for words in (["--help"], ["map", "check", "cme"], ["navigate", "--rig", "ideal", "--start-angle", "11.25"]):
        took = sorted(seconds(*words) for _ in range(5))
        start.add(f"`mazeplan {' '.join(words)}`", f"{took[2]:.2f}")
    notes = (
        "On hardware (published): 7 of 10 runs arrived; mean 7.71 s, best 6.2 s, worst 10.13 s.",
        "The settings were searched by tools/tune.py on packaged and drawn rigs with other seeds.",
        "These seeds, rings and maps had no part in the search.",
    )
    return Section("Navigation (simulated)", notes, (table, start))


def seconds(*words: str) -> float:
    """Wall time of a command."""
    began = time.perf_counter()
    subprocess.run([sys.executable, "-m", "mazeplan", *words], capture_output=True, check=True, cwd=ROOT)
    return time.perf_counter() - began
