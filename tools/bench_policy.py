"""Section `policy`: a policy that imitates the planner: training, arrivals, time of a decision.

The policy stays in build/policy. The runs of the training have seeds from 10 000 000 on.
"""

from __future__ import annotations

import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from bench_kit import BUILD, ROOT, Section, Table, arrivals

from mazeplan.control.policy import Policy, load_policy, policy_inputs
from mazeplan.control.tilt import Plate
from mazeplan.core import resources
from mazeplan.core.records import State
from mazeplan.maze.mapfile import load_map
from mazeplan.run.campaign.one_run import Campaign
from mazeplan.run.commands.evaluate import results_of

FOLDER = BUILD / "policy"
SEED, WORKERS = 20_000, 2  # no choice was made by runs with seeds from here on
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


def arrival_table(quick: bool) -> Table:
    """Runs from ring 1 to the centre with each tree; plans have no deadline."""
    many, few = (4, 2) if quick else (100, 16)
    table = Table(("tree", "arrived", "mean s", "worst", "runs with a plan", "failures on the way"))

    def row(what: str, count: int, **more: str) -> None:
        given = {"rig": "toy", "policy": str(FOLDER), "behavior": "policy", **more}
        campaign = Campaign(runs=count, seed=SEED, deadline=False, **{k: v for k, v in given.items() if v})  # pyright: ignore
        results = results_of(campaign, workers=WORKERS)
        arrived, times, failures = arrivals(results)
        figures = (f"{statistics.mean(times):.2f}", f"{max(times):.2f}") if times else ("-", "-")
        table.add(what, arrived, *figures, sum(r.planner_ms["max"] > 0.0 for r in results), failures)

    with tempfile.TemporaryDirectory() as folder:
        alone = Path(folder) / "alone.xml"
        alone.write_text(without_planner(), encoding="utf-8")
        row("`policy`: the planner as its fallback", many)
        row("no planner: recoveries only, any distance", many, behavior=str(alone))
        row("`navigate`: the planner", many, policy="", behavior="navigate")
        row("`policy` on the rig rough, of which it knows nothing", few, rig="rough")
        row("`policy` on the map lopsided, of which it knows nothing", few, map="lopsided")
    return table


def policy_section(quick: bool) -> Section:
    """Training, arrivals, time of a decision."""
    command, wall, cpu = trained(quick)
    policy = load_policy(FOLDER)
    times, facts = decision_us(policy, 2000 if quick else 20_000), policy.facts
    training = Table(("what", "figure"))
    training.add("runs of the training", f"{facts['rounds']} rounds of {facts['runs']}, {facts['samples']} samples")
    training.add("time of the training", f"{wall / 60.0:.1f} min in {WORKERS} processes, {cpu / 60.0:.1f} min of CPU")
    training.add("mean error of its commands, held-out samples", f"{facts['error_deg']:.2f} deg")
    low, high = statistics.median(times), np.quantile(times, 0.9)
    training.add("one decision (numpy, one core)", f"median {low:.0f} us, 90 % within {high:.0f} us")
    size = sum(weights.size + bias.size for weights, bias in policy.layers)
    training.add("size", f"{size} numbers, {size * 4 / 1024:.1f} KiB as `float`")
    notes = (f"`{command}`.", f"Counted runs: seeds from {SEED}; no choice was made by these seeds.")
    return Section("A policy that imitates the planner (simulated)", notes, (arrival_table(quick), training))
