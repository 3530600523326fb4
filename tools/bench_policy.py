"""A policy that imitates the planner: training, arrivals, time of a decision. The section `policy` of BENCHMARKS.md.

Usage: python tools/bench_policy.py [--quick]. It keeps the policy in build/policy. The runs of the training have seeds
from 10 000 000 on; those that are counted here begin at SEED, which no choice was made by.
"""

from __future__ import annotations

import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

from mazeplan.control.policy import Policy, policy_inputs
from mazeplan.control.policy_file import load_policy
from mazeplan.control.tilt import Plate
from mazeplan.core import resources
from mazeplan.core.records import NavigationResult, State
from mazeplan.maze.mapfile import load_map
from mazeplan.run.campaign.evaluate import Campaign, evaluate

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "build" / "policy"
SEED, WORKERS = 20_000, 2
PLANNED = """\
      <PlanInRing opening="{opening}" plan="{plan}"/>
      <Track opening="{opening}" plan="{plan}"/>
      <Align opening="{opening}"/>
      <PassOpening opening="{opening}"/>
"""
CHOSEN = '<ChooseOpening goal="{goal}" opening="{opening}"/>'


def without_planner() -> str:
    """The tree of `navigate` with the policy, whatever its distance, in the place of all that plans."""
    text = (resources.share("behaviors") / "navigate.xml").read_text(encoding="utf-8")
    assert PLANNED in text
    assert CHOSEN in text
    text = text.replace(PLANNED, '      <FollowPolicy opening="{opening}" max_distance="1e9"/>\n')
    return text.replace(CHOSEN, CHOSEN.replace("/>", ' planned_choices="1"/>'))


def trained(quick: bool) -> tuple[str, float, float]:
    """The command of the training, its wall time and its processor time, s."""
    shutil.rmtree(FOLDER, ignore_errors=True)
    words = ["policy", "train", "--rig", "toy", "--workers", str(WORKERS), "-o", "build/policy"]
    words += ["--rounds", "2", "--runs", "8"] if quick else []
    began, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-m", "mazeplan", *words], check=True, cwd=ROOT, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return "mazeplan " + " ".join(words), time.perf_counter() - began, cpu


def decision_us(policy: Policy, count: int) -> list[float]:
    """Wall times of single decisions, us: inputs, distance and command."""
    maze, rng = load_map("cme"), np.random.default_rng(0)
    opening, plate = maze.openings[0], Plate(maze.tilt_limit)
    ring, times = maze.ring(opening.outer), []
    for row in rng.normal(size=(count, 8)) * (0.1, 0.1, 0.1, 0.1, 0.05, 0.5, 0.05, 0.5):
        x, y, vx, vy, beta, beta_dot, gamma, gamma_dot = row.tolist()
        state = State(0.0, x, y, vx, vy, beta, beta_dot, gamma, gamma_dot, ring.number)
        began = time.perf_counter()
        inputs = policy_inputs(state, ring, opening, 0.3, False, plate)
        policy.distance(inputs)
        policy.command(inputs, plate)
        times.append(1e6 * (time.perf_counter() - began))
    return times


def arrival_row(what: str, results: list[NavigationResult]) -> str:
    """A line of the table of arrivals."""
    times = [result.time_s for result in results if result.success]
    failures = Counter(str(failure.kind) for result in results for failure in result.failures)
    told = ", ".join(f"{kind} {count}" for kind, count in sorted(failures.items())) or "none"
    figures = f"{statistics.mean(times):.2f} | {max(times):.2f}" if times else "- | -"
    plans = sum(result.planner_ms["max"] > 0.0 for result in results)
    row = f"| {what} | {len(times)}/{len(results)} | {figures} | {plans} | {told} |"
    print(row, file=sys.stderr, flush=True)
    return row


def arrival_rows(quick: bool) -> list[str]:
    """The table of arrivals."""
    many, few = (4, 2) if quick else (100, 16)

    def runs(count: int, **more: str) -> list[NavigationResult]:
        given = {"rig": "toy", "policy": str(FOLDER), "behavior": "policy", **more}
        given = {key: value for key, value in given.items() if value}
        return evaluate(Campaign(runs=count, seed=SEED, deadline=False, **given), workers=WORKERS)  # pyright: ignore

    with tempfile.TemporaryDirectory() as folder:
        alone = Path(folder) / "alone.xml"
        alone.write_text(without_planner(), encoding="utf-8")
        return [
            "| tree | arrived | mean s | worst | runs with a plan | failures on the way |",
            "|---|---|---|---|---|---|",
            arrival_row("`policy`: the planner as its fallback", runs(many)),
            arrival_row("no planner: recoveries only, any distance", runs(many, behavior=str(alone))),
            arrival_row("`navigate`: the planner", runs(many, policy="", behavior="navigate")),
            arrival_row("`policy` on the rig rough, of which it knows nothing", runs(few, rig="rough")),
            arrival_row("`policy` on the map lopsided, of which it knows nothing", runs(few, map="lopsided")),
        ]


def policy_section(quick: bool) -> list[str]:
    """Everything, as lines of Markdown."""
    command, wall, cpu = trained(quick)
    policy = load_policy(FOLDER)
    times = decision_us(policy, 2000 if quick else 20_000)
    facts = policy.facts
    return [
        "## A policy that imitates the planner (simulated)",
        "",
        f"`{command}`: {facts['rounds']} rounds of {facts['runs']} runs, {facts['samples']} samples, seeds"
        f" {facts['run_seeds'][0]} to {facts['run_seeds'][1]}.",
        f"It took {wall / 60.0:.1f} min in {WORKERS} processes beside other work on this machine, and"
        f" {cpu / 60.0:.1f} min of processor time. On the samples held out",
        f"its commands are off by {facts['error_deg']:.2f} deg on average.",
        "",
        f"Runs from ring 1 to the centre, seeds from {SEED}, which no choice was made by; plans without a deadline:",
        "",
        *arrival_rows(quick),
        "",
        f"One decision (inputs, distance, command; numpy, one core), wall time of each of {len(times)}: median"
        f" {statistics.median(times):.0f} us, 90 % within {np.quantile(times, 0.9):.0f} us.",
        f"The network has {policy.size} numbers, {policy.size * 4 / 1024:.1f} KiB as `float`, and the"
        f" {len(policy.centres)} centres of its distance {policy.centres.size * 4 / 1024:.1f} KiB.",
    ]  # fmt: skip


if __name__ == "__main__":
    print("\n".join(policy_section("--quick" in sys.argv)))
