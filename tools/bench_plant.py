"""What `mazeplan diagnose` finds in records of the tests' own plant: each effect in three sizes and rings, records in
which nothing is missing, process noise, two effects at once, effects that no library has.


Usage: python tools/bench_plant.py [--seeds N] [--only NAME...]   (each record's outcome goes to build/plant.jsonl)
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.core.logs.table import Table
from mazeplan.diagnosis.record import record_of
from mazeplan.diagnosis.ring.diagnose import diagnose

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))
# the tests' truth, which shares nothing with the models
import plant  # noqa: E402  # pyright: ignore[reportMissingImports]

DECLARED = {"rolling_inertia": {"factor": 5 / 7}, "viscous_friction": {"coefficient": 0.35}}
RADII = {"1": 0.0925, "2": 0.0689, "3": 0.0488}  # m, about those of rings 1 to 3
SECONDS, NOISE = 300.0, 0.4  # NOISE: rad/s^1.5, of the process where there is any
KEPT = ROOT / "build" / "plant.jsonl"
SIZES = (1, 3, 10)  # times the smallest size that is to be found


def _effect(name: str, k: float) -> tuple[dict[str, Any], dict[str, float]]:
    """An effect at k times the smallest size: what the plant is told, and the parameters that are to come out."""
    return {
        "dry_friction": ({"dry": 0.05 * k}, {"coefficient": 0.05 * k}),
        "tilt_offset": ({"offset": (0.0005 * k, -0.0005 * k)}, {"beta": 0.0005 * k, "gamma": -0.0005 * k}),
        "rolling_inertia": ({"factor": 5 / 7 * (1 + 0.015 * k)}, {"factor": 5 / 7 * (1 + 0.015 * k)}),
        "viscous_friction": ({"viscous": 0.35 + 0.03 * k}, {"coefficient": 0.35 + 0.03 * k}),
        "quadratic_drag": ({"quadratic": 0.015 * k}, {"coefficient": 0.015 * k}),
        "constant_torque": ({"torque": 0.045 * k}, {"acceleration": 0.045 * k}),
        "axis_misalignment": ({"angle": 0.0075 * k}, {"angle": 0.0075 * k}),
        "sensor_delay": ({"delay": 0.0066 * k}, {"delay": round(0.0066 * k * 1200) / 1200}),
        "friction_drift": ({"drift": 0.12 * k / SECONDS}, {"rate": 0.12 * k / SECONDS}),
        "surface_profile": (
            {"wave": (0.08 * k, 0.0, 0.0, 0.08 * k)},
            {"cos1": 0.08 * k, "sin1": 0.0, "cos2": 0.0, "sin2": 0.08 * k},
        ),
        "surface_bump": ({"bump": (1.0, 0.3, 0.1 * k)}, {"height": 0.1 * k}),
        "gate_loss": ({"gate": (0.8, min(0.03 * k, 0.5))}, {"loss": min(0.03 * k, 0.5)}),
        "tilt_gain": ({"gain": (1 + 0.015 * k, 1 - 0.015 * k)}, {"beta": 1 + 0.015 * k, "gamma": 1 - 0.015 * k}),
        "camera_offset": (
            {"camera_offset": (0.0003 * k, -0.0002 * k)},
            {"x": 0.0003 * k, "y": -0.0002 * k},
        ),
    }[name]


NAMES = (
    "dry_friction", "tilt_offset", "rolling_inertia", "viscous_friction", "quadratic_drag", "constant_torque",
    "axis_misalignment", "sensor_delay", "friction_drift", "surface_profile", "surface_bump", "gate_loss", "tilt_gain",
    "camera_offset",
)  # fmt: skip
PAIRS = (
    ("dry_friction", "tilt_offset"), ("dry_friction", "sensor_delay"), ("viscous_friction", "rolling_inertia"),
    ("tilt_offset", "sensor_delay"), ("camera_offset", "dry_friction"), ("surface_bump", "tilt_offset"),
    ("friction_drift", "axis_misalignment"), ("gate_loss", "dry_friction"), ("quadratic_drag", "tilt_offset"),
    ("rolling_inertia", "surface_bump"),
)  # fmt: skip
UNKNOWN: dict[str, dict[str, Any]] = {
    "speed times tilt": {"cross": (4.0, -2.0)},
    "pull of the speed's past": {"memory": (1.0, 0.5)},
    "force that swings with time": {"hum": (1.7, 0.3)},
}


@dataclass(frozen=True)
class Job:
    """A record: what group it counts to, the plant's effects, the names and parameters to be found."""

    group: str
    what: dict[str, Any]
    true: dict[str, dict[str, float]]
    ring: str
    seed: int
    process: float = 0.0


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


def jobs_of(seeds: int) -> list[Job]:
    """Every record of the table."""
    jobs = [
        Job(f"{name} x {k}", *sized(name, k), ring, seed)
        for name in NAMES
        for k in SIZES
        for ring in RADII
        for seed in range(seeds)
    ]
    jobs += [
        Job(f"{name}, process noise", *sized(name, 10), ring, 50 + seed, NOISE)
        for name in NAMES
        for ring in RADII
        for seed in range(max(seeds // 3, 1))
    ]
    rings = list(RADII)
    jobs += [Job("nothing", {}, {}, rings[i % 3], 100 + i) for i in range(6 * seeds)]
    jobs += [Job("nothing, process noise", {}, {}, rings[i % 3], 200 + i, NOISE) for i in range(4 * seeds)]
    for i in range(3 * seeds):
        pair = PAIRS[i % len(PAIRS)]
        what, true = ({k: v for n in pair for k, v in sized(n, 3)[j].items()} for j in (0, 1))
        jobs.append(Job("two effects", what, true, rings[i % 3], 300 + i))
    jobs += [
        Job(f"unknown: {name}", what, {}, rings[seed % 3], 400 + seed)
        for name, what in UNKNOWN.items()
        for seed in range(seeds)
    ]
    return jobs


def sized(name: str, k: float) -> tuple[dict[str, Any], dict[str, dict[str, float]]]:
    """An effect at k times the smallest size: what the plant is told, and names with the parameters to be found."""
    what, parameters = _effect(name, k)
    return what, {name: parameters}


def run(job: Job) -> Outcome:
    """Diagnose one record of the plant."""
    radius = RADII[job.ring]
    columns = plant.play(seed=job.seed, seconds=SECONDS, radius=radius, process=job.process, **job.what)
    record = record_of(Table(columns), np.ones(len(columns["t"]), dtype=bool))
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


def rows_of(jobs: Sequence[Job], outcomes: Sequence[Outcome]) -> list[str]:
    """A line for each group."""
    lines = [
        "| in the record | records | right | wrong names | 95 % intervals that hold the truth | median error over noise"
        " alone | median, longest CPU s |",
        "|---" * 7 + "|",
    ]
    for group in dict.fromkeys(job.group for job in jobs):
        here = [(j, o) for j, o in zip(jobs, outcomes, strict=True) if j.group == group]
        verdicts = [judged(j, o) for j, o in here]
        right, wrong = (sum(v[i] for v in verdicts) for i in (0, 1))
        inside, intervals = sum(o.inside for _, o in here), sum(o.intervals for _, o in here)
        ratio, seconds = np.median([o.ratio for _, o in here]), [o.seconds for _, o in here]
        cells = [
            group, len(here), right, wrong, f"{inside} of {intervals}" if intervals else "-", f"{ratio:.2f}",
            f"{np.median(seconds):.1f}, {max(seconds):.1f}",
        ]  # fmt: skip
        lines.append("| " + " | ".join(str(c) for c in cells) + " |")
    return lines


def summary(jobs: Sequence[Job], outcomes: Sequence[Outcome]) -> list[str]:
    """The figures that count, over groups."""
    pairs = list(zip(jobs, outcomes, strict=True))

    def share(label: str, chosen: list[tuple[Job, Outcome]]) -> str:
        verdicts = [judged(j, o) for j, o in chosen]
        right, wrong = (sum(v[i] for v in verdicts) for i in (0, 1))
        return f"- {label}: {right} of {len(chosen)} right, {wrong} with a wrong name"

    single = [(j, o) for j, o in pairs if " x " in j.group]
    noisy = [(j, o) for j, o in pairs if j.process > 0.0]
    inside, count = sum(o.inside for _, o in noisy), sum(o.intervals for _, o in noisy)
    quiet, quiet_count = sum(o.inside for _, o in single), sum(o.intervals for _, o in single)
    lines = [
        share("one effect", single),
        share("one effect, with process noise", [(j, o) for j, o in noisy if j.true]),
        share("nothing missing", [(j, o) for j, o in pairs if j.group.startswith("nothing")]),
        share("two effects at once", [(j, o) for j, o in pairs if j.group == "two effects"]),
        share("of a kind that has no name", [(j, o) for j, o in pairs if j.group.startswith("unknown")]),
        f"- 95 % intervals with the truth: {inside} of {count} with process noise, {quiet} of {quiet_count} without",
    ]
    for name in NAMES:
        ratios = [o.ratio for j, o in single if name in j.true and name in o.names]
        if ratios:
            lines.append(
                f"- {name}: 40-step error over noise alone: median {np.median(ratios):.2f}, worst {max(ratios):.2f}"
            )
    return lines


def key(job: Job) -> str:
    """What tells jobs apart."""
    return json.dumps(asdict(job), sort_keys=True)


def kept_outcomes() -> dict[str, Outcome]:
    """Outcomes of an earlier run."""
    if not KEPT.exists():
        return {}
    lines = [json.loads(line) for line in KEPT.read_text().splitlines()]
    jobs = [Job(**{f.name: line[f.name] for f in fields(Job)}) for line in lines]
    found = [Outcome(**{f.name: line[f.name] for f in fields(Outcome)}) for line in lines]
    return {key(job): outcome for job, outcome in zip(jobs, found, strict=True)}


def plant_section(
    quick: bool, seeds: int = 10, only: Sequence[str] = (), workers: int = 2, keep: bool = False
) -> list[str]:
    """The table, as lines of Markdown; keep: what an earlier run left in build/plant.jsonl is not run again."""
    jobs = [job for job in jobs_of(1 if quick else seeds) if not only or any(name in job.group for name in only)]
    KEPT.parent.mkdir(exist_ok=True)
    outcomes = kept_outcomes() if keep else {}
    # as they come back from the file
    left = [job for job in jobs if key(Job(**json.loads(key(job)))) not in outcomes]
    with ProcessPoolExecutor(workers) as pool, KEPT.open("a" if keep else "w") as file:
        for i, (job, found) in enumerate(zip(left, pool.map(run, left), strict=False)):
            outcomes[key(job)] = found
            right, wrong = judged(job, found)
            file.write(json.dumps({**asdict(job), **asdict(found)}) + "\n")
            file.flush()
            if not right or wrong:
                print(f"{job.group} ring {job.ring} seed {job.seed}: {found.sentence}", file=sys.stderr)
            elif i % 50 == 0:
                print(f"{i + 1} of {len(left)}", file=sys.stderr)
    done = [outcomes[key(job)] for job in jobs]
    return [
        "## Diagnosis of a plant of its own (simulated)",
        "",
        f"tests/plant.py, which shares nothing with the models: {SECONDS:g} s, camera noise 0.3 mm, tilt noise 8e-4",
        f"rad, process noise {NOISE} rad/s^1.5 where there is any; `x k`: k times the smallest size; {seeds} seeds.",
        "",
        *summary(jobs, done),
        "",
        *rows_of(jobs, done),
    ]


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--only", nargs="*", default=())
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--keep", action="store_true", help="go on with build/plant.jsonl")
    given = parser.parse_args()
    print("\n".join(plant_section(False, given.seeds, given.only, given.workers, given.keep)))
