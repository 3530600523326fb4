"""Memory over many runs: the section `memory` of BENCHMARKS.md. Linux only, as it reads /proc.

Each row is measured in a process of its own: `python tools/bench_memory.py ROW RUNS|SECONDS` prints one JSON object."""

from __future__ import annotations

import json
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from multiprocessing import freeze_support
from pathlib import Path
from threading import Thread
from time import monotonic

from mazeplan.apps.view.door import Door, listen
from mazeplan.apps.view.link import PageLink
from mazeplan.apps.view.livetab import Offer
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.paced import PacedRig
from mazeplan.run.campaign.evaluate import Campaign, evaluate
from mazeplan.run.navigate import navigate

ALLOWED_MB = 15.0  # of growth after the tenth run: what the allocator and caches move to and fro
FIRST = 10  # runs until memory is to be flat
ROWS = {
    "page": ("runs by the clock on the wall with an open page, which is a process of its own", 1800, 40),
    "navigate": ("calls of `mazeplan.navigate` in one process", 100, 12),
    "evaluate": ("runs of `evaluate` in one process", 1000, 12),
    "workers": ("runs of `evaluate --workers 2`, all processes", 1000, 12),
}  # what it is; the runs, of `page` the seconds, and how many in a quick try


def resident_mb(pid: int | str = "self") -> float:
    """Memory that a process has in the machine, with that of its children; what they share counts once for each."""
    status = Path(f"/proc/{pid}/status").read_text().splitlines()
    own = sum(int(line.split()[1]) / 1024 for line in status if line.startswith("VmRSS"))
    children = [child for task in Path(f"/proc/{pid}/task").glob("*/children") for child in task.read_text().split()]
    for child in children:
        try:
            own += resident_mb(child)
        except OSError:  # it has ended
            continue
    return own


def by_calls(runs: int) -> list[float]:
    """From ring to ring on the toy, in turn."""
    grown = []
    for seed in range(runs):
        navigate(1 + seed % 4, 5, rig="toy", seed=seed)
        grown.append(resident_mb())
    return grown


def by_campaign(runs: int, workers: int) -> list[float]:
    """A campaign on the toy; looked at after each run."""
    grown = list[float]()
    evaluate(Campaign(runs=runs), workers=workers, progress=lambda finished: grown.append(resident_mb()))
    return grown


def by_page(seconds: int) -> list[float]:
    """Run after run in real time while a client reads the page."""
    from page_client import Viewer

    grown = list[float]()

    def run_on() -> None:
        ends, seed = monotonic() + seconds, 0
        while monotonic() < ends:
            navigate(1, 5, rig="toy", seed=seed, around=PacedRig, feed=page.take)
            viewer.moved.clear()  # which counts, and is no part of the page
            grown.append(resident_mb())
            seed += 1

    listening = listen("127.0.0.1", 0)
    port = listening.getsockname()[1]
    with PageLink(Offer(load_map("cme"), "toy"), Door.at("127.0.0.1", port), listening, lambda order: None) as page:
        listening.close()
        viewer = Viewer(port)
        if not page.opened.wait(60.0):
            raise SystemExit("the page did not open")
        runs = Thread(target=run_on)
        runs.start()
        runs.join()
        viewer.close()
    return grown


def measured(row: str, much: int) -> list[float]:
    """Memory after each run, MB."""
    if row == "page":
        return by_page(much)
    return by_calls(much) if row == "navigate" else by_campaign(much, 2 if row == "workers" else 1)


def memory_section(quick: bool) -> list[str]:
    """A table: memory after the tenth run, in the middle and at the end, and the most after the tenth."""
    rows = [
        "## Memory over many runs (simulated)",
        "",
        f"Resident memory in MB, on the toy, seeds from 0. Flat: after run {FIRST} it never grows by more than "
        f"{ALLOWED_MB:g} MB.",
        "",
        "| what | runs | after run 10 | halfway | at the end | most growth after run 10 | flat |",
        "|---|---|---|---|---|---|---|",
    ]
    with ThreadPoolExecutor(2) as pool:  # memory, not time, is measured
        amounts = [few if quick else much for _, much, few in ROWS.values()]
        for (what, *_), grown in zip(ROWS.values(), pool.map(in_own_process, ROWS, amounts), strict=True):
            most = max(grown[FIRST:], default=grown[-1]) - grown[FIRST - 1]
            rows.append(
                f"| {what} | {len(grown)} | {grown[FIRST - 1]:.0f} | {grown[len(grown) // 2]:.0f} | {grown[-1]:.0f} | "
                f"{most:.1f} | {'yes' if most <= ALLOWED_MB else 'no'} |"
            )
            print(rows[-1], file=sys.stderr)
    return rows


def in_own_process(row: str, much: int) -> list[float]:
    """`measured` in a process of its own."""
    command = [sys.executable, __file__, row, str(much)]
    return json.loads(subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout.splitlines()[-1])


if __name__ == "__main__":
    freeze_support()
    print(json.dumps(measured(sys.argv[1], int(sys.argv[2]))))
