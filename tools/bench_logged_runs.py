"""Section `loggedruns`: what `mazeplan diagnose` says of logs of navigation: rigs with one change, and healthy ones."""

from __future__ import annotations

import tempfile
from collections import Counter
from pathlib import Path

from bench_kit import Section, Table, counts
from hidden_effects import KINDS, write_hidden_rig

import mazeplan
from mazeplan.core.logs.table import join, read_table
from mazeplan.diagnosis.rig.reference import known_reference
from mazeplan.diagnosis.rig.verdict import RigVerdict, verdict_on
from mazeplan.learning.modelfile import load_model
from mazeplan.maze.mapfile import load_map
from mazeplan.run.settings import load_settings

RUNS, FIRST, HEALTHY = 20, 2000, 10  # runs of each rig, seed of the first, healthy rigs
ALSO_RIGHT = {"constant_force": "tilt_offset"}  # a steady draught looks like a table that leans
PATIENT = load_settings().with_values({"travel": {"deadline_ms": 1e6}})  # the same runs on any machine


def verdict(kind: str | None, runs: int, first: int) -> RigVerdict:
    """The verdict on runs with seeds from `first` on, against the packaged model of the toy.

    kind: of the hidden effect; None: the toy"""
    maze, model = load_map("cme"), load_model("toy")
    with tempfile.TemporaryDirectory() as folder:
        rig = "toy"
        if kind is not None:
            rig = str(Path(folder) / "rig.yaml")
            write_hidden_rig(Path(rig), kind, maze)
        logs = [Path(folder) / f"{i}.mcap" for i in range(runs)]
        for i, log in enumerate(logs):
            angle = 25 * i % 360
            mazeplan.navigate(1, rig=rig, model="toy", seed=first + i, start_angle_deg=angle, log=log, settings=PATIENT)
        table = join([read_table(log) for log in logs])
    return verdict_on(table, maze, known_reference("toy", model, maze))


def outcome(effect: str, done: RigVerdict) -> str:
    """right, right, and more; wrong; unknown; silent."""
    names, right = {e["name"] for e in done.effects}, {effect, ALSO_RIGHT.get(effect)}
    if names & right:
        return "right, and more" if done.unknown is not None or not names <= right else "right"
    return "silent" if done.verdict == "nothing_missing" else "wrong" if names else "unknown"


def loggedruns_section(quick: bool) -> Section:
    """A row for each kind of change, and totals."""
    table, found = Table(("kind", "effect", "record s", "told", "outcome")), Counter[str]()
    for kind in ["table", "lens"] if quick else list(KINDS):
        effect, done = KINDS[kind].effect, verdict(kind, RUNS, FIRST)
        told = [e["name"] for e in done.effects]
        told += [] if done.unknown is None else [done.unknown.document()["description"]]
        seconds = len(done.plate.body.pictures) * done.plate.body.pictures.dt
        result = outcome(effect, done)
        found[result] += 1
        table.add(kind, effect, f"{seconds:.0f}", "; ".join(told) or "nothing is missing", result)
    count = 1 if quick else HEALTHY
    silent = sum(verdict(None, RUNS, FIRST + RUNS * i).verdict == "nothing_missing" for i in range(count))
    total = Table(("what", "figure"))
    total.add("changed rigs", counts(found))
    total.add("healthy rigs on which nothing is found", f"{silent} of {count}")
    notes = (
        f"`mazeplan diagnose RUN.mcap ... --model toy`, with {RUNS} runs (seeds from {FIRST}): the toy with a change.",
        "Runs are short, and commands are faster than the servos, so only large changes of the servos show.",
    )
    return Section("Diagnosis of logs of navigation (simulated)", notes, (total, table))
