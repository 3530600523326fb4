"""Section `contactplant`: verdicts on records of rigs that the tests' own plant simulates with contact.

Usage by itself: python tools/bench_contactplant.py [--rigs N] [--first N] [--seeds N] [--nulls N] [--only EFFECT ...]
[--workers K] [-o FILE]

Healthy rigs are drawn; each has a reference of 600 s. Records of 300 s follow, in which nothing or one thing has
changed, in three sizes. All truths are known. Outcomes go to build/contactplant.jsonl, a line a rig; an interrupted run
goes on from there. A record takes about 40 s on one core, so the full table takes hours.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from bench_kit import BUILD, Section, Table, resumed
from contact_outcomes import NULL, SIZES, Job, Outcome, rows, totals
from contacteffects import EFFECTS, changed, truth
from contactrig import drawn_rig, record

from mazeplan.core.logs.table import Table as Record
from mazeplan.diagnosis.rig.reference import RigReference, reference_of
from mazeplan.diagnosis.rig.verdict import verdict_on
from mazeplan.maze.mapfile import load_map

MAZE = load_map("cme")
KEPT = BUILD / "contactplant.jsonl"
REFERENCE_S, RECORD_S = 600.0, 300.0
FIRST = 200  # number of the first rig of the section; lower ones had a part in the choice of thresholds


def rig_of(number: int) -> Any:
    """A healthy rig by its number."""
    return drawn_rig(np.random.default_rng([number, 77]))


def judged(job: Job, reference: RigReference) -> Outcome:
    """Simulate a record, and judge the verdict on it."""
    healthy = rig = rig_of(job.rig)
    if job.effect != NULL:
        rig = changed(rig, job.effect, job.size)
    table = Record(record(rig, RECORD_S, 1000 + job.seed))
    began = time.perf_counter()
    done = verdict_on(table, MAZE, reference)
    took, sizes = time.perf_counter() - began, {}
    for effect in done.effects:
        if job.effect == NULL or effect["name"] not in EFFECTS[job.effect].names:
            continue
        radius = MAZE.track_radius(int(next(iter(effect["rings"]))))  # its numbers are of the first ring
        true = truth(rig, job.effect, effect["name"], radius, healthy)
        for key, number in effect["parameters"].items():
            if key in true:
                before = effect["known_before"].get(key) or 0.0
                sizes[f"{effect['name']}.{key}"] = [float(true[key]), number["value"], number["stderr"], before]
    names, alike = [e["name"] for e in done.effects], [list(group) for group in done.alike]
    errors = done.before["rollout40"], done.after["rollout40"]
    return Outcome(job, done.verdict, names, alike, sizes, done.remaining, *errors, took, done.sentences()[0])


def of_rig(rig: int, records: Sequence[Sequence[Any]]) -> dict[str, Any]:
    """Outcomes of all records of a rig.

    records: (effect, size, seed) of each"""
    reference = reference_of([Record(record(rig_of(rig), REFERENCE_S, 1))], MAZE, None)
    return {"outcomes": [asdict(judged(Job(rig, *record), reference)) for record in records]}


def jobs_of(rigs: int, seeds: int, nulls: int, only: Sequence[str] = (), first: int = 0) -> list[Job]:
    """Nulls of every rig, and each effect in each size as often as there are seeds, with rigs in turn."""
    jobs = [Job(first + rig, NULL, 0, seed) for rig in range(rigs) for seed in range(nulls)]
    combinations = [
        (name, size, seed) for seed in range(seeds) for name in EFFECTS for size in range(len(SIZES))
        if not only or name in only
    ]  # fmt: skip
    # a size of an effect meets another rig with each seed, and the sizes of an effect do not share one
    return jobs + [
        Job(first + (i + i // len(SIZES)) % rigs, *job[:2], 100 + job[2]) for i, job in enumerate(combinations)
    ]


def measured(jobs: Sequence[Job], path: Path, workers: int) -> tuple[Table, Table]:
    """Totals, and a row for each size of each effect."""
    numbers = sorted({job.rig for job in jobs})
    parts = [(rig, [[job.effect, job.size, job.seed] for job in jobs if job.rig == rig]) for rig in numbers]
    outcomes = [row for done in resumed(path, of_rig, parts, workers) for row in done["outcomes"]]
    done = [Outcome(**row | {"job": Job(**row["job"])}) for row in outcomes]
    return totals(done), rows(done)


def contactplant_section(quick: bool) -> Section:
    """Totals, and a row for each size of each effect."""
    jobs = jobs_of(1, 1, 1, ("dry_friction",))[:2] if quick else jobs_of(25, 1, 4, first=FIRST)
    notes = (
        "Healthy rigs are drawn (friction, walls, servos, delays, noise: `tests/contactrig.py`), and simulated in",
        "three dimensions by an integrator that shares nothing with mazeplan. Also wrong names: a right one is there.",
        f"Rigs from {FIRST} on had no part in the choice of thresholds.",
    )
    title = "Diagnosis of balls that touch walls: rigs of the tests' own"
    return Section(title, notes, measured(jobs, BUILD / "quick.jsonl" if quick else KEPT, 1))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    for name, default in (("rigs", 4), ("first", 0), ("seeds", 1), ("nulls", 4), ("workers", 1)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--only", nargs="+", default=(), choices=list(EFFECTS), metavar="EFFECT")
    parser.add_argument("-o", "--output", type=Path, default=KEPT)
    o = parser.parse_args()
    measured(jobs_of(o.rigs, o.seeds, o.nulls, o.only, o.first), o.output, o.workers)


if __name__ == "__main__":
    main()
