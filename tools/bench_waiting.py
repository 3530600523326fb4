"""Section `waiting`: how long people wait for the commands of the tour, as a new process each.

The limit of a command is its time in a process that has done the same just before: with everything imported, compiled
and read. With MAZEPLAN_BEFORE=FOLDER, an earlier checkout takes turns with this one.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from bench_kit import ROOT, Section, Table

TIMES = 3  # each command of each checkout; the shortest counts
COMMANDS = {  # {n}: a number for outputs, different each time
    "start of the program": "--help",
    "navigate": "navigate --from ring1 --to ring5 --rig toy --seed 3 --log run{n}.mcap",
    "map show --log": "map show cme --log run.mcap -o run{n}.png",
    "log info": "log info run.mcap",
    "log replay": "log replay run.mcap",
    "report of a run": "report run.mcap -o run{n}.html",
    "collect, 120 s": "collect --rig toy --rings --seconds 120 --seed 1 -o collected{n}.mcap",
    "learn of 120 s": "learn collected.mcap -o model{n} --kind pi",
    "score": "score model collected.mcap",
    "evaluate, 8 runs": "evaluate --rig toy --model model --runs 8",
    "diagnose": "diagnose collected.mcap --model model -o diagnosis{n}",
    "improve": "improve --rig leaning.yaml --seconds 60 --runs 4 -o improved{n}",
}
FIRST = ("navigate", "collect, 120 s", "learn of 120 s")  # their outputs without a number are inputs of the others
LEANING = "model: ideal\nrolling_friction_m: 2.0e-5\nwall_grip: 0.3\ntable_x_deg: 1.5\n"
AGAIN = """
import contextlib, io, json, sys, time
from mazeplan.__main__ import main
for words in json.loads(sys.argv[1]):
    sys.argv = ["mazeplan", *words]
    began = time.perf_counter()
    with contextlib.redirect_stdout(io.TextIOWrapper(io.BytesIO())), contextlib.suppress(SystemExit):
        main()
print(time.perf_counter() - began)
"""


RUN = """
import json, os, sys, time
began = time.perf_counter()
child = os.spawnv(os.P_NOWAIT, sys.executable, [sys.executable, *sys.argv[2:]])
_, status, usage = os.wait4(child, 0)
with open(sys.argv[1], "w") as file:
    json.dump((time.perf_counter() - began, usage.ru_maxrss / 1024.0), file)
sys.exit(os.waitstatus_to_exitcode(status))
"""  # a small process: the peak of a program counts the memory of the one that starts it


def waited(checkout: Path, folder: Path, words: str) -> tuple[float, float]:
    """Wall time of a command, s, and peak memory of its largest process, MB. Ends the program if the command fails."""
    usage = folder / "usage.json"
    _python(checkout, folder, "-c", RUN, str(usage), "-m", "mazeplan", *words.split())
    seconds, peak = json.loads(usage.read_text())
    return seconds, peak


def _python(checkout: Path, folder: Path, *words: str) -> str:
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    done = subprocess.run(
        [sys.executable, *words], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode not in (0, 1):
        raise SystemExit(f"{' '.join(words)}: exit {done.returncode}\n{done.stderr}")
    return done.stdout


def limit(checkout: Path, folder: Path, words: str) -> float:
    """Wall time of a command in a process that has just done it, s."""
    pair = [words.format(n=f"again{i}").split() for i in range(2)]
    return float(_python(checkout, folder, "-c", AGAIN, json.dumps(pair)).split()[-1])


def waiting_section(quick: bool) -> Section:
    """Wall times of the commands of the tour, beside their limits and an earlier checkout."""
    before, times = os.environ.get("MAZEPLAN_BEFORE"), 1 if quick else TIMES
    checkouts = [*([Path(before).resolve()] if before else []), ROOT]
    table = Table(("command", "earlier, s", "s", "limit, s", "over the limit", "peak MB"))
    totals = dict.fromkeys(checkouts, 0.0)
    with tempfile.TemporaryDirectory() as place:
        folders = {checkout: Path(place) / str(i) for i, checkout in enumerate(checkouts)}
        for checkout, folder in folders.items():
            folder.mkdir()
            (folder / "leaning.yaml").write_text(LEANING, encoding="utf-8")
            for name in FIRST:
                waited(checkout, folder, COMMANDS[name].format(n=""))
        for name, words in COMMANDS.items():
            took, peak = dict.fromkeys(checkouts, math.inf), 0.0
            for n in range(times):
                for checkout, folder in folders.items():
                    seconds, peak = waited(checkout, folder, words.format(n=n))  # of this checkout at last
                    took[checkout] = min(took[checkout], seconds)
            for checkout, seconds in took.items():
                totals[checkout] += seconds
            least = limit(ROOT, folders[ROOT], words)
            earlier = f"{took[checkouts[0]]:.2f}" if before else "-"
            table.add(name, earlier, f"{took[ROOT]:.2f}", f"{least:.2f}", f"{took[ROOT] / least:.1f}", f"{peak:.0f}")
    earlier = f"{totals[checkouts[0]]:.2f}" if before else "-"
    table.add("all", earlier, f"{totals[ROOT]:.2f}", "", "", "")
    notes = (
        f"Shortest of {times} new processes, after a first run that compiles. Limit: the second time in one process.",
        f"Earlier: {_version(Path(before))}, in turns with this one." if before else "Earlier: not measured.",
    )
    return Section("Waiting for the commands of the tour (simulated)", notes, (table,))


def _version(checkout: Path) -> str:
    """The commit of a checkout."""
    words = ["git", "-C", str(checkout), "log", "-1", "--format=%h, %as"]
    return subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip()
