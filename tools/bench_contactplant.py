"""Verdicts on records of rigs that the tests' own plant simulates with contact, and of which every truth is known.

Usage: python tools/bench_contactplant.py [--rigs N] [--seeds N] [--nulls N] [--first N] [--only EFFECT ...]
[--workers K] [--quick]

Healthy rigs are drawn; each has a reference of 600 s. Records of 300 s follow, in which nothing or one thing has
changed, in three sizes. Outcomes go to build/contactplant.jsonl, one a line, and what is there already is not done
again: an interrupted run goes on. About 40 s a record on one core, so the full table takes hours; tools/bench.py
writes it only when it is asked to (--only contactplant).
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import sys
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.core.logs.table import Table
from mazeplan.diagnosis.rig.reference import RigReference, reference_of
from mazeplan.diagnosis.rig.verdict import verdict_on
from mazeplan.maze.mapfile import load_map

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))
# the tests' truth, which shares nothing with the models
import contacteffects  # noqa: E402  # pyright: ignore[reportMissingImports]
import contactrig  # noqa: E402  # pyright: ignore[reportMissingImports]

MAZE = load_map("cme")
KEPT = ROOT / "build" / "contactplant.jsonl"
REFERENCE_S, RECORD_S = 600.0, 300.0
NULL, TOLD = "nothing", 200  # number of the first rig of the table in BENCHMARKS.md
SIZES = ("small", "middle", "large")
SHARE, SURE = 0.2, 3.0  # of the true value, or in standard errors: a size counts as right within either
INSIDE = 1.96  # standard errors of a 95 % interval
OUTCOMES = ("right", "also wrong names", "wrong names", "unknown", "silent")


@dataclass(frozen=True)
class Job:
    """A record: of which rig, with what effect (NULL: none) of what size (0 to 2), and the seed of its sines."""

    rig: int
    effect: str
    size: int
    seed: int


@dataclass(frozen=True)
class Outcome:
    """What a record was called. sizes: per parameter told and known [true, told, standard error, before]; remaining,
    before, after: of the verdict; seconds: that it took, without its reference."""

    job: Job
    verdict: str
    names: list[str]
    alike: list[list[str]]
    sizes: dict[str, list[float]]
    remaining: float
    before: float
    after: float
    seconds: float
    sentence: str = ""

    @property
    def expected(self) -> tuple[str, ...]:
        """Names that are right; nothing else than silence is, where there are none."""
        return () if self.job.effect == NULL else contacteffects.EFFECTS[self.job.effect].names

    @property
    def nameless(self) -> bool:
        """Whether something changed that has no name."""
        return self.job.effect != NULL and contacteffects.EFFECTS[self.job.effect].nameless

    @property
    def outcome(self) -> str:
        """One of OUTCOMES. A name that the verdict cannot tell from a right one is right, too."""
        own = set(self.expected)
        doubts = {name for group in self.alike if own & set(group) for name in group}
        near = set() if self.job.effect == NULL else set(contacteffects.EFFECTS[self.job.effect].near)
        named = set(self.names)
        if self.nameless:
            told = self.verdict == "unknown_effect"
            return "wrong names" if named - near else "right" if told else "silent"
        right = bool(named & (own | doubts)) if own else not named and self.verdict == "nothing_missing"
        surplus = named - own - doubts - near
        if right:
            return "also wrong names" if surplus else "right"
        if named:
            return "wrong names"
        return "unknown" if self.verdict == "unknown_effect" else "silent"

    @property
    def size_right(self) -> bool | None:
        """Whether all sizes are near the truth; None without any."""
        near = [
            abs(told - true) <= max(SHARE * abs(true - before), SURE * stderr)
            for true, told, stderr, before in self.sizes.values()
        ]
        return all(near) if near else None

    @property
    def inside(self) -> list[bool]:
        """Which 95 % intervals hold the truth."""
        return [abs(told - true) <= INSIDE * stderr for true, told, stderr, _ in self.sizes.values()]


@dataclass
class Told:
    """A verdict in this bench's own words. numbers: per name and parameter [value, standard error, before]; radius: m,
    of the ring that they hold for."""

    verdict: str
    names: list[str]
    alike: list[list[str]]
    numbers: dict[str, dict[str, list[float]]] = field(default_factory=dict)
    radius: float = 0.0
    remaining: float = math.nan
    before: float = math.nan
    after: float = math.nan
    sentence: str = ""


def reference(table: Table) -> RigReference:
    """What is known of a rig from a record in which all was well."""
    return reference_of([table], MAZE, None)


def judged(table: Table, was: RigReference) -> Told:
    """The verdict on a record; the one place here that knows its form."""
    done = verdict_on(table, MAZE, was)
    told = Told(done.verdict, [e["name"] for e in done.effects], [list(group) for group in done.alike])
    for effect in done.effects:
        told.radius = MAZE.track_radius(int(next(iter(effect["rings"]))))  # its numbers are of the first of them
        told.numbers[effect["name"]] = {
            key: [number["value"], number["stderr"], effect["known_before"].get(key) or 0.0]
            for key, number in effect["parameters"].items()
        }
    told.remaining, told.sentence = done.remaining, done.sentences()[0]
    told.before, told.after = done.before["rollout40"], done.after["rollout40"]
    return told


def rig_of(number: int) -> Any:
    """A healthy rig by its number."""
    return contactrig.drawn_rig(np.random.default_rng([number, 77]))


def outcome_of(job: Job, was: RigReference) -> Outcome:
    """Simulates a record and has it judged."""
    healthy = rig = rig_of(job.rig)
    if job.effect != NULL:
        rig = contacteffects.changed(rig, job.effect, job.size)
    table = Table(contactrig.record(rig, RECORD_S, 1000 + job.seed))
    began = time.perf_counter()
    told = judged(table, was)
    took, sizes = time.perf_counter() - began, {}
    for name, numbers in told.numbers.items():
        if job.effect == NULL or name not in contacteffects.EFFECTS[job.effect].names:
            continue
        for key, true in contacteffects.truth(rig, job.effect, name, told.radius, healthy).items():
            if key in numbers:
                sizes[f"{name}.{key}"] = [float(true), *map(float, numbers[key])]
    return Outcome(
        job, told.verdict, told.names, told.alike, sizes, told.remaining, told.before, told.after, took, told.sentence
    )


def jobs_of(rigs: int, seeds: int, nulls: int, only: Sequence[str] = (), first: int = 0) -> list[Job]:
    """Nulls of every rig, and each effect in each size as often as there are seeds, with rigs in turn."""
    jobs = [Job(first + rig, NULL, 0, seed) for rig in range(rigs) for seed in range(nulls)]
    combinations = [
        (name, size, seed) for seed in range(seeds) for name in contacteffects.EFFECTS for size in range(len(SIZES))
        if not only or name in only
    ]  # fmt: skip
    # a size of an effect meets another rig with each seed, and the sizes of an effect do not share one
    return jobs + [
        Job(first + (i + i // len(SIZES)) % rigs, *job[:2], 100 + job[2]) for i, job in enumerate(combinations)
    ]


def of_rig(jobs: Sequence[Job]) -> Iterable[Outcome]:
    """Outcomes of jobs that share a rig, one by one."""
    was = reference(Table(contactrig.record(rig_of(jobs[0].rig), REFERENCE_S, 1)))
    for job in jobs:
        yield outcome_of(job, was)


def _part(jobs: Sequence[Job], path: Path) -> int:
    """Runs jobs of one rig and appends each outcome to the file."""
    for done in of_rig(jobs):
        line = f"\n{json.dumps(asdict(done))}\n"  # the last one may have been cut short
        with path.open("a") as file:
            file.write(line)  # less than a page: lines of several workers do not mix
        print(f"rig {done.job.rig} {done.job.effect} {SIZES[done.job.size]}: {done.outcome}: {done.sentence}",
              file=sys.stderr, flush=True)  # fmt: skip
    return len(jobs)


def kept(path: Path) -> dict[Job, Outcome]:
    """What was done before."""
    if not path.exists():
        return {}
    rows = []
    for line in path.read_text().splitlines():
        with contextlib.suppress(json.JSONDecodeError):  # a line that an interrupted run began, or an empty one
            rows.append(json.loads(line))
    done = [Outcome(**row | {"job": Job(**row["job"])}) for row in rows]
    return {outcome.job: outcome for outcome in done}


def run(jobs: Sequence[Job], path: Path, workers: int) -> list[Outcome]:
    """All outcomes, those that are in the file and those that are missing there."""
    path.parent.mkdir(exist_ok=True)
    have = kept(path)
    left = [job for job in jobs if job not in have]
    parts = [[job for job in left if job.rig == rig] for rig in sorted({job.rig for job in left})]
    if workers > 1:
        with ProcessPoolExecutor(workers) as pool:
            list(pool.map(_part, parts, [path] * len(parts)))
    else:
        for part in parts:
            _part(part, path)
    have = kept(path)
    return [have[job] for job in jobs if job in have]


def _row(name: str, size: str, done: Sequence[Outcome]) -> str:
    counts = [sum(o.outcome == kind for o in done) for kind in OUTCOMES]
    others = sorted({name for o in done for name in o.names if name not in o.expected})
    judged_sizes = [o.size_right for o in done if o.size_right is not None]
    sizes = f"{sum(judged_sizes)} of {len(judged_sizes)}" if judged_sizes else ""
    error = f"{np.mean([o.before for o in done]):.3f} -> {np.mean([o.after for o in done]):.3f}"
    seconds = f"{np.mean([o.seconds for o in done]):.0f}"
    cells = [name, size, *(str(c or "") for c in counts), sizes, ", ".join(others), error, seconds]
    return f"| {' | '.join(cells)} |"


def _share(part: int, whole: int) -> str:
    return f"{part} of {whole} ({100.0 * part / whole:.0f} %)" if whole else "none"


def report(done: Sequence[Outcome]) -> list[str]:
    """Table and totals, as lines of Markdown."""
    rows = []
    for name in (NULL, *contacteffects.EFFECTS):
        for i, size in enumerate(SIZES):
            here = [o for o in done if o.job.effect == name and o.job.size == i]
            rows += [_row(name, "" if name == NULL else size, here)] if here else []
    nameless = [o for o in done if o.nameless]
    quiet = [o for o in done if not o.expected and not o.nameless]
    loud = [o for o in done if o.expected]
    right = [o for o in loud if o.outcome in ("right", "also wrong names")]
    unknown = sum(o.outcome == "right" for o in nameless)
    wrong = sum("wrong" in o.outcome for o in (*loud, *nameless))
    sizes = [o.size_right for o in right if o.size_right is not None]
    inside = [held for o in right for held in o.inside]
    alarms = [o for o in quiet if o.outcome != "right"]
    return [
        f"| effect | size | {' | '.join(OUTCOMES)} | size right | other names | error 40 samples ahead, rad | s |",
        "|---" * (5 + len(OUTCOMES)) + "|---|",
        *rows,
        "",
        f"- alarms where nothing changed: {_share(len(alarms), len(quiet))}",
        f"- effects named rightly: {_share(len(right), len(loud))}; and nothing else: "
        f"{_share(sum(o.outcome == 'right' for o in loud), len(loud))}",
        f"- called unknown where nothing has a name: {_share(unknown, len(nameless))}",
        f"- wrong names: {_share(wrong, len(loud) + len(nameless))}",
        f"- sizes within {100 * SHARE:.0f} % of the change or {SURE:g} standard errors: "
        f"{_share(sum(sizes), len(sizes))}",
        f"- 95 % intervals that hold the truth: {_share(sum(inside), len(inside))}",
    ]


def contactplant_section(quick: bool, path: Path = KEPT) -> list[str]:
    """Everything, as lines of Markdown."""
    jobs = jobs_of(1, 1, 1, ("dry_friction",))[:2] if quick else jobs_of(25, 1, 4, first=TOLD)
    return [
        "## Diagnosis of balls that touch walls: rigs of the tests' own",
        "",
        "Healthy rigs are drawn (friction, walls, servos, delays, noise: `tests/contactrig.py`), simulated in three",
        "dimensions by an integrator that shares nothing with mazeplan, and known from a reference of 600 s. In",
        "records of 300 s nothing or one thing changed. Also wrong names: a right one is among them. Verdicts",
        "`unknown_effect` without a name count as unknown: an alarm where nothing changed, no wrong name elsewhere.",
        f"`python tools/bench_contactplant.py --first {TOLD} --rigs 25 --nulls 4`: rigs from {TOLD} on had",
        "no part in the choice of thresholds. Seconds are of a machine that was busy with other work.",
        "",
        *report(run(jobs, path, 1)),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rigs", type=int, default=4)
    parser.add_argument("--first", type=int, default=0, help="number of the first rig; rigs below 100 served to choose")
    parser.add_argument("--seeds", type=int, default=1, help="records of each size of each effect")
    parser.add_argument("--nulls", type=int, default=4, help="records of each rig in which nothing changed")
    parser.add_argument("--only", nargs="+", default=(), choices=list(contacteffects.EFFECTS), metavar="EFFECT")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--quick", action="store_true", help="one rig, two records")
    parser.add_argument("-o", "--output", type=Path, default=KEPT, help="JSON lines; what is there is not done again")
    options = parser.parse_args()
    if options.quick:
        print("\n".join(contactplant_section(True, options.output)))
        return
    jobs = jobs_of(options.rigs, options.seeds, options.nulls, options.only, options.first)
    print("\n".join(report(run(jobs, options.output, options.workers))))


if __name__ == "__main__":
    main()
