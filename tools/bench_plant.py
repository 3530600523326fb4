"""Section `plant`: what the diagnosis finds in records of the plant of tests/plant.py: each effect in three sizes and
rings, records in which nothing is missing, process noise, two effects at once, effects without a name.

Outcomes go to build/plant.jsonl; an interrupted run goes on from there.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from bench_kit import BUILD, Section, Table, resumed
from plant import play
from plant_cases import DECLARED, NOISE, RADII, SECONDS, Job, jobs_of

from mazeplan.core.logs.table import Table as Record
from mazeplan.diagnosis.record import record_of
from mazeplan.diagnosis.ring.diagnose import diagnose


@dataclass(frozen=True)
class Outcome:
    """What was found: ratio: 40-step error over that of noise alone; inside, intervals: how many 95 % intervals hold
    the truth, of how many."""

    verdict: str
    names: list[str]
    alike: list[list[str]]
    ratio: float
    seconds: float
    inside: int = 0
    intervals: int = 0
    sentence: str = ""
    deviations: dict[str, float] = field(default_factory=dict)


def run(job: Job) -> Outcome:
    """Diagnose one record of the plant."""
    radius = RADII[job.ring]
    columns = play(seed=job.seed, seconds=SECONDS, radius=radius, process=job.process, **job.what)
    record = record_of(Record(columns), np.ones(len(columns["t"]), dtype=bool))
    began = time.process_time()
    done = diagnose(record, radius, DECLARED)
    seconds = time.process_time() - began
    deviations = {
        f"{e['name']}.{n}": (e["parameters"][n]["value"] - value) / e["parameters"][n]["stderr"]
        for e in done.effects
        for n, value in job.true.get(e["name"], {}).items()
    }
    return Outcome(
        done.verdict, [e["name"] for e in done.effects], [list(g) for g in done.finding.alike],
        done.after.rollout40 / done.after.floor, seconds, sum(abs(d) < 1.96 for d in deviations.values()),
        len(deviations), done.sentence(), deviations,
    )  # fmt: skip


def judged(job: Job, found: Outcome) -> tuple[bool, bool]:
    """(Whether the right thing was said, whether a wrong name was)."""
    wrong = any(name not in job.true for name in found.names)
    if job.group.startswith("unknown"):
        return found.verdict == "unknown_effect", wrong
    if not job.true:
        return found.verdict == "nothing_missing", wrong
    return set(job.true) <= set(found.names), wrong


def outcome(text: str) -> dict[str, Any]:
    """The outcome of a job in JSON."""
    return asdict(run(Job(**json.loads(text))))


def totals(pairs: Sequence[tuple[Job, Outcome]]) -> Table:
    """Figures over groups of records."""
    table = Table(("what", "records", "right", "with a wrong name", "95 % intervals that hold the truth"))
    groups = {
        "one effect": [(j, o) for j, o in pairs if " x " in j.group],
        "one effect, with process noise": [(j, o) for j, o in pairs if j.process > 0.0 and j.true],
        "nothing missing": [(j, o) for j, o in pairs if j.group.startswith("nothing")],
        "two effects at once": [(j, o) for j, o in pairs if j.group == "two effects"],
        "of a kind that has no name": [(j, o) for j, o in pairs if j.group.startswith("unknown")],
    }
    for name, here in groups.items():
        verdicts = [judged(j, o) for j, o in here]
        right, wrong = (sum(v[i] for v in verdicts) for i in (0, 1))
        inside, intervals = sum(o.inside for _, o in here), sum(o.intervals for _, o in here)
        table.add(name, len(here), right, wrong, f"{inside} of {intervals}" if intervals else "-")
    return table


def groups(pairs: Sequence[tuple[Job, Outcome]]) -> Table:
    """A row for each kind of record."""
    table = Table(("in the record", "records", "right", "wrong names", "median error over noise alone", "median CPU s"))
    for group in dict.fromkeys(job.group for job, _ in pairs):
        here = [(j, o) for j, o in pairs if j.group == group]
        right, wrong = (sum(judged(j, o)[i] for j, o in here) for i in (0, 1))
        ratio, seconds = (np.median([getattr(o, name) for _, o in here]) for name in ("ratio", "seconds"))
        table.add(group, len(here), right, wrong, f"{ratio:.2f}", f"{seconds:.1f}")
    return table


def plant_section(quick: bool, seeds: int = 10) -> Section:
    """Totals, and a row for each kind of record."""
    jobs = jobs_of(1 if quick else seeds)
    path = BUILD / ("quick_plant.jsonl" if quick else "plant.jsonl")
    done = [Outcome(**row) for row in resumed(path, outcome, [(json.dumps(asdict(job)),) for job in jobs])]
    pairs = list(zip(jobs, done, strict=True))
    notes = (
        f"tests/plant.py shares nothing with the models: {SECONDS:g} s, camera noise 0.3 mm, tilt noise 8e-4 rad,",
        f"process noise {NOISE} rad/s^1.5 where there is any; `x k`: k times the smallest size; {seeds} seeds.",
    )
    return Section("Diagnosis of a plant of its own (simulated)", notes, (totals(pairs), groups(pairs)))
