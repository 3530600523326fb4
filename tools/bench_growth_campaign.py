"""Cost of a campaign's end by its runs, for the section `growth`: read the store, sum up, write the report.

Short runs fill the first thousand rows of a store. The others are copies of them with other numbers and seeds, as
100,000 runs would take hours. The command that is measured finds all of its runs in the store.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

FIRST = 1000  # runs that are truly made
WORDS = ("evaluate", "--from", "ring5", "--to", "ring5", "--rig", "ideal", "--time-limit", "1", "--no-deadline")
MEASURE = """
import resource, subprocess, sys
done = subprocess.run(sys.argv[1:], capture_output=True)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
sys.exit(done.returncode)
"""


@cache
def measured(runs: int) -> tuple[float, float]:
    """(ms, MB): wall time and most memory of `evaluate --store --report` whose runs are all in the store."""
    with TemporaryDirectory(prefix="mazeplan-growth-") as folder:
        return _measured(runs, Path(folder))


def _measured(runs: int, folder: Path) -> tuple[float, float]:
    store, report = folder / "store", folder / "report.html"
    made = min(runs, FIRST)
    evaluate = (sys.executable, "-m", "mazeplan", *WORDS, "--store", str(store))
    subprocess.run([*evaluate, "--runs", str(made)], check=True, capture_output=True)
    (path,) = store.glob("*.jsonl")
    if runs > made:
        _grow(path, runs)
    command = [*evaluate, "--runs", str(runs), "--report", str(report)]
    began = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", MEASURE, *command], check=True, capture_output=True, text=True)
    ms = 1e3 * (time.perf_counter() - began)
    assert report.exists()
    return ms, float(done.stdout) * (1.0 if sys.platform == "darwin" else 1024.0) / 1e6


def _grow(path: Path, runs: int) -> None:
    """Copy the rows of a store until there are so many."""
    head, *rows = [json.loads(line) for line in path.read_text().splitlines()]
    with path.open("w") as file:
        file.write(json.dumps(head) + "\n")
        for number in range(runs):
            row = rows[number % len(rows)]
            row = {**row, "index": number, "result": {**row["result"], "seed": number}}
            file.write(json.dumps(row) + "\n")
