"""Today's program beside an older one, in turn, on the same machine: plans of the solver, and navigation.

Usage: python tools/bench_against.py COMMIT [--rounds N] [--runs N]. The commit is checked out in a folder of its own,
and both are measured with this program's rigs and problems, one after the other, as often as there are rounds.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
RIGS = ("ideal", "toy", "rough")
SOLVER = """
import json, sys
sys.path[:0] = [sys.argv[1], sys.argv[1] + "/tools"]
import bench_solver as bench
maze, model = bench.load_map("cme"), bench.load_model("toy")
cold, warm = bench.Times(), bench.Times()
for ring in bench.RINGS:
    planner = bench.planner_of(maze, model, ring)
    for total, part in zip((cold, warm), bench.measure(planner, bench.cases(100, ring), ring)):
        total.join(part)
print(json.dumps([cold.ms, warm.ms]))
"""


def environment(root: Path) -> dict[str, str]:
    """Of a process that runs the program of a checkout."""
    return {**os.environ, "PYTHONPATH": str(root), "OMP_NUM_THREADS": "1"}


def solved(root: Path) -> tuple[float, float]:
    """Median ms of cold and of warm plans."""
    command = [sys.executable, "-c", SOLVER, str(root)]
    done = subprocess.run(command, env=environment(root), cwd=root, capture_output=True, text=True, check=True)
    cold, warm = json.loads(done.stdout.splitlines()[-1])
    return float(np.median(cold)), float(np.median(warm))


def driven(root: Path, rig: str, runs: int) -> tuple[int, float]:
    """How many of some runs arrived, and their mean time, s."""
    command = [sys.executable, "-m", "mazeplan", "evaluate", "--rig", rig, "--runs", str(runs), "--json"]
    done = subprocess.run(command, env=environment(root), cwd=root, capture_output=True, text=True, check=False)
    told = json.loads(done.stdout)
    return int(told["success"]), float(told["time_s"]["mean"])


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("commit", help="of the older program")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--runs", type=int, default=32, help="of navigation on each rig; 0: none")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        old = Path(folder) / "old"
        subprocess.run(["git", "-C", str(ROOT), "worktree", "add", "--detach", str(old), options.commit], check=True)
        try:
            print("| round | cold plan, ms: old, now | ratio | warm plan, ms: old, now | ratio |")
            print("|---|---|---|---|---|")
            for number in range(1, options.rounds + 1):
                (cold, warm), (cold_now, warm_now) = solved(old), solved(ROOT)
                print(f"| {number} | {cold:.3f}, {cold_now:.3f} | {cold_now / cold:.3f} | {warm:.3f}, {warm_now:.3f} "
                      f"| {warm_now / warm:.3f} |", flush=True)  # fmt: skip
            for rig in RIGS if options.runs else ():
                told = [driven(root, rig, options.runs) for root in (old, ROOT)]
                words = [f"{n} of {options.runs} arrived, mean {mean:.2f} s" for n, mean in told]
                print(f"{rig}: old {words[0]}; now {words[1]}", flush=True)
        finally:
            subprocess.run(["git", "-C", str(ROOT), "worktree", "remove", "--force", str(old)], check=True)


if __name__ == "__main__":
    main()
