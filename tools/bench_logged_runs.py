"""What `mazeplan diagnose` says of logs of navigation: simulated rigs with one change each, and healthy ones.

Usage: python tools/bench_logged_runs.py [--quick]. Used by tools/bench.py.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import mazeplan
from mazeplan.core.logs.table import join, read_table
from mazeplan.diagnosis.rig.reference_file import known_reference
from mazeplan.diagnosis.rig.result import RigVerdict
from mazeplan.diagnosis.rig.verdict import verdict_on
from mazeplan.learning.modelfile import load_model
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.sim.surprise import KINDS
from mazeplan.run.settings import load_settings

RUNS, FIRST, HEALTHY = 20, 2000, 10  # runs of each rig, seed of the first, healthy rigs
ALIKE = {"constant_force": "tilt_offset"}  # also right: a steady draught looks like a table that leans
PATIENT = load_settings().with_values({"travel": {"deadline_ms": 1e6}})  # the same runs on any machine


def verdict(rig: str, runs: int, first: int) -> RigVerdict:
    """The verdict on runs with seeds from `first` on, against the packaged model of the toy."""
    maze, model = load_map("cme"), load_model("toy")
    with tempfile.TemporaryDirectory() as folder:
        logs = [Path(folder) / f"{i}.mcap" for i in range(runs)]
        for i, log in enumerate(logs):
            seed = first + i
            mazeplan.navigate(1, rig=rig, model="toy", seed=seed, start_angle_deg=25 * i, log=log, settings=PATIENT)
        table = join([read_table(log) for log in logs])
    return verdict_on(table, maze, known_reference("toy", model, maze))


def _row(kind: str, effect: str, done: RigVerdict) -> tuple[str, str]:
    """A line of the table, and the outcome."""
    names = [e["name"] for e in done.effects]
    right = {effect, ALIKE.get(effect)}
    outcome = "silent" if done.verdict == "nothing_missing" else "unknown" if not names else "wrong"
    if set(names) & right:
        surplus = done.unknown is not None or not set(names) <= right
        outcome = "right, and more" if surplus else "right"
    seconds = len(done.body.pictures) * done.body.pictures.dt
    told = names if done.unknown is None else [*names, done.unknown.document()["description"]]
    cells = (kind, effect or "nothing", f"{seconds:.0f}", "; ".join(told) or "nothing is missing", outcome)
    line = f"| {' | '.join(cells)} |"
    print(line, file=sys.stderr, flush=True)
    return line, outcome


def logged_runs_section(quick: bool) -> list[str]:
    """Everything, as lines of Markdown."""
    kinds = ["table", "lens"] if quick else list(KINDS)
    changed = [_row(kind, KINDS[kind].effect, verdict(f"surprise@{kind}", RUNS, FIRST)) for kind in kinds]
    healthy = [_row("-", "", verdict("toy", RUNS, FIRST + RUNS * i)) for i in range(1 if quick else HEALTHY)]
    outcomes = [outcome for _, outcome in changed]
    counts = ", ".join(f"{outcomes.count(o)} {o}" for o in dict.fromkeys(outcomes))
    return [
        "## Diagnosis of logs of navigation (simulated)",
        "",
        f"`mazeplan diagnose RUN.mcap ... --model toy`, with {RUNS} runs (seeds from {FIRST} on) of the rig",
        "`surprise@KIND`, and of the healthy toy. Runs are short. Commands are faster than the servos, so that only",
        "large changes of the servos show. Earlier trials of the same rigs, with other seeds, showed what had to be",
        "mended, and gave the limits for servos.",
        "",
        "| kind | effect | record s | told | outcome |",
        "|---" * 5 + "|",
        *(line for line, _ in changed),
        *(line for line, outcome in healthy if outcome != "silent"),
        "",
        f"- changed rigs: {counts}",
        f"- healthy rigs: {sum(outcome == 'silent' for _, outcome in healthy)} of {len(healthy)} silent",
    ]


if __name__ == "__main__":
    print("\n".join(logged_runs_section("--quick" in sys.argv)))
