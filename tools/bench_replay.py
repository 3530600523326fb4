"""Recorded navigations that decide again: the section `replay` of BENCHMARKS.md.

Each run is recorded by this process and replayed by another one, with the command that a user would give.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

from mazeplan.run.navigate import navigate
from mazeplan.run.settings import load_settings

HURRY_MS = 2.0  # deadline of a plan, so that the clock on the wall ends many searches
# what, rig, runs, runs with --quick, deadline (ms; None: of the settings)
CAMPAIGNS = (
    ("toy", "toy", 20, 2, None),
    (f"toy, plans within {HURRY_MS:g} ms", "toy", 10, 1, HURRY_MS),
    ("ideal", "ideal", 10, 1, None),
    ("rough", "rough", 10, 1, None),
)


@dataclass
class Count:
    """Of the runs of one rig."""

    runs: int = 0
    arrived: int = 0
    failures: int = 0
    ticks: int = 0
    plans: int = 0
    cut_off: int = 0
    identical: int = 0
    differences: list[str] = field(default_factory=list)

    def row(self, what: str) -> str:
        """A line of the table."""
        numbers = self.runs, self.arrived, self.failures, self.ticks, self.plans, self.cut_off, self.identical
        return f"| {what} | {' | '.join(map(str, numbers))} |"

    def add(self, other: Count) -> None:
        """Both together."""
        for name, value in vars(other).items():
            setattr(self, name, getattr(self, name) + value)


def replayed(log: Path) -> dict:
    """What `mazeplan log replay --json` says of a log, in a process of its own."""
    command = [sys.executable, "-m", "mazeplan", "log", "replay", str(log), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if not done.stdout.strip():
        raise SystemExit(f"mazeplan log replay {log}: exit {done.returncode}\n{done.stderr}")
    return json.loads(done.stdout)


def campaign(rig: str, seeds: range, deadline_ms: float | None, folder: Path) -> Count:
    """Record a run of each seed, inwards for even ones and outwards for odd ones, and replay it."""
    count, settings = Count(), load_settings()
    if deadline_ms is not None:
        settings = settings.with_values({"travel": {"deadline_ms": deadline_ms}})
    for seed in seeds:
        start, goal = ((1, 5), (5, 1))[seed % 2]
        log = folder / f"{rig}{seed}.mcap"
        result = navigate(start, goal, rig=rig, seed=seed, settings=settings, log=log)
        again = replayed(log)
        one = Count(
            1, int(result.success), len(result.failures), again["ticks"], again["plans"], again["cut_off"],
            int(again["identical"]),
        )  # fmt: skip
        if not again["identical"]:
            first = again["difference"]
            one.differences.append(f"{rig}, seed {seed}: at t = {first['t']:.3f} s, {first['what']} {first['fields']}")
        count.add(one)
        print(f"{rig} seed {seed}: {result.reason}, identical: {again['identical']}", file=sys.stderr)
    return count


def replay_section(quick: bool) -> list[str]:
    rows, whole, first = [], Count(), 0
    with tempfile.TemporaryDirectory() as folder:
        for what, rig, many, few, deadline_ms in CAMPAIGNS:
            runs = few if quick else many
            count = campaign(rig, range(first, first + runs), deadline_ms, Path(folder))
            rows.append(count.row(what))
            whole.add(count)
            first += runs
    return [
        "## Replay of recorded runs (simulated)",
        "",
        f"{whole.runs} runs of `mazeplan navigate --log`, seeds from 0, from ring 1 to 5 and from 5 to 1 in turn, each",
        "replayed by `mazeplan log replay` in another process: identical if every tick has the same status, leaf,",
        "command and opening, with the same plans and events.",
        "",
        "| rig | runs | arrived | failures on the way | ticks | plans | searches ended by the deadline | identical |",
        "|---|---|---|---|---|---|---|---|",
        *rows,
        whole.row("all"),
        *(f"- {text}" for text in whole.differences),
    ]
