"""Navigation logs as the only data: what `mazeplan diagnose LOG...` finds in them on the toy with one hidden change.

Usage: python tools/bench_closed_loop.py [--quick] [KIND ...]. Used by tools/bench.py.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import mazeplan
from mazeplan.rigs.sim.surprise import KINDS

HEALTHY = "healthy"
ASKED = ("table", "camera", "friction", "gain", HEALTHY)
RUNS = 40


def logs_of(kind: str, folder: Path, runs: int) -> list[Path]:
    """Logs of navigations from ring 1 to the centre, seeds 0, 1, ..."""
    rig, paths = "toy" if kind == HEALTHY else f"surprise@{kind}", []
    for seed in range(runs):
        paths.append(folder / f"{seed:02d}.mcap")
        mazeplan.navigate(1, rig=rig, model="toy", seed=seed, log=paths[-1])
    return paths


def row(kind: str, runs: int) -> tuple[bool, str]:
    """Whether the verdict is right, and the line of the table."""
    asked = "-" if kind == HEALTHY else KINDS[kind].effect
    with tempfile.TemporaryDirectory() as folder:
        paths = [str(path) for path in logs_of(kind, Path(folder), runs)]
        command = [sys.executable, "-m", "mazeplan", "diagnose", *paths, "--model", "toy", "--json"]
        ran = subprocess.run(command, check=True, capture_output=True, text=True)
    document = json.loads(ran.stdout)
    found = {e["name"]: e for e in document["effects"]}
    right = document["verdict"] == "nothing_missing" if kind == HEALTHY else list(found) == [asked]
    numbers = "; ".join(f"{name} ({_numbers(e['parameters'])})" for name, e in found.items())
    cells = [kind, asked, numbers or document["verdict"].replace("_", " "), "yes" if right else "no"]
    return right, f"| {' | '.join(cells)} |"


def _numbers(parameters: dict[str, dict[str, float]]) -> str:
    return ", ".join(f"{key} {p['value']:.4g} ± {p['stderr'] or 0.0:.1g}" for key, p in parameters.items())


def closed_loop_section(quick: bool, kinds: list[str] | None = None) -> list[str]:
    """Everything, as lines of Markdown."""
    chosen, runs = kinds or list(ASKED), 10 if quick else RUNS
    rows = []
    with ProcessPoolExecutor(2) as pool:
        for done in pool.map(row, chosen, [runs] * len(chosen)):
            rows.append(done)
            print(done[1], file=sys.stderr, flush=True)
    return [
        "## Navigation logs as the only data (simulated)",
        "",
        f"`mazeplan diagnose LOG... --model toy` on the logs of {runs} navigations, seeds 0 to {runs - 1}, of the toy "
        "with one hidden change.",
        "",
        "| kind | effect | found | right, and nothing else |", "|---|---|---|---|", *(line for _, line in rows),
        "",
        f"Right: {sum(right for right, _ in rows)} of {len(rows)}.",
    ]  # fmt: skip


if __name__ == "__main__":
    names = [argument for argument in sys.argv[1:] if not argument.startswith("-")]
    print("\n".join(closed_loop_section("--quick" in sys.argv, names or None)))
