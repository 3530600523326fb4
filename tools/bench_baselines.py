"""What two usual ways to correct a model reach where `mazeplan diagnose` names what is missing: a Gaussian process on
the residual acceleration, and sparse regression of it on the terms of named effects. Used by tools/bench.py.

Usage: python tools/bench_baselines.py [--quick] [--workers N]   (PySINDy: pip install 'mazeplan[bench]')

All see the first 70 % of a record; what they choose (how to smooth, which threshold) they choose within it. Roll-outs
begin on the same rows of the rest, from the same states, those of the filter with the diagnosed model, and along the
same motion of the plate, that of the stage as the diagnosis corrected it. Both favour the other ways: with a model of
their own they would have to do with worse ones.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

import numpy as np
from bench_baselines_ways import (
    FOLDS,
    MOST,
    RIGHT,
    TERMS,
    TRIED,
    Correction,
    Ground,
    chosen,
    declared_model,
    error_of,
    gaussian_process,
    right,
    sparse_regression,
)  # fmt: skip
from bench_plant import DECLARED, RADII, SECONDS, Job, jobs_of, plant

from mazeplan.core.logs.table import Table
from mazeplan.core.maths.angles import wrap
from mazeplan.core.records import Array
from mazeplan.diagnosis.coordinate.fit import Likelihood
from mazeplan.diagnosis.coordinate.kalman import NODES
from mazeplan.diagnosis.coordinate.search import SEEN
from mazeplan.diagnosis.record import RingRecord, record_of
from mazeplan.diagnosis.ring.camera import true_angle_at_radius
from mazeplan.diagnosis.ring.candidates import ring_library
from mazeplan.diagnosis.ring.diagnose import RingDiagnosis, diagnose
from mazeplan.diagnosis.ring.scores import score_starts
from mazeplan.diagnosis.ring.system import RingSystem
from mazeplan.diagnosis.stage.plate_motion import plate_motion

RING, SIZE, SEEDS = "1", 3, 2


def ground_of(record: RingRecord, radius: float, done: RingDiagnosis) -> Ground:
    """From a record and its diagnosis; see the head of this file."""
    n, final, theta, offset = len(record), done.finding.final, record.theta, None
    if done.circle is not None and done.circle.shifted and record.r is not None:
        offset = done.circle.offset
        theta = true_angle_at_radius(theta, record.r, offset)
    tilt = plate_motion(record, done.stage)
    system = RingSystem(record.t, theta, record.begins, radius, tilt, DECLARED)
    count = np.cumsum(np.isfinite(record.theta))
    seen, early = count <= SEEN * count[-1], count <= TRIED * SEEN * count[-1]
    likelihood = Likelihood(system, [*ring_library(), *final.candidates], seen)
    states = likelihood.filtered(final.values, final.q)[:, :2].copy()
    if offset is not None:
        states = as_seen(states, radius, offset)
    times = (record.t[:, None] + system.dt * np.arange(NODES) / (NODES - 1)).ravel()
    motion = tilt.at(times)
    for name, size in final.values.get("stage", {}).items():
        motion += size * tilt.at(times, name)
    held_out, tried = (score_starts(rows, record.begins, np.isfinite(record.theta)) for rows in (~seen, seen & ~early))
    return Ground(
        record.t, system.dt, record.theta, motion.reshape(n, NODES, 6), declared_model(radius), seen, early, states,
        held_out, tried,
    )  # fmt: skip


def as_seen(states: Array, radius: float, offset: tuple[float, float]) -> Array:
    """Angles and speeds (N, 2) about the true centre as a camera that is off sees them."""

    def seen(x: Array) -> Array:
        there = np.arctan2(radius * np.sin(x) + offset[1], radius * np.cos(x) + offset[0])
        return x + wrap(there - x)

    x, v = states.T
    return np.column_stack([seen(x), v * (seen(x + 1e-6) - seen(x - 1e-6)) / 2e-6])


@dataclass(frozen=True)
class Row:
    """Errors over noise alone: of the declared model, with the diagnosis, the process, sparse regression, and sparse
    regression as usual, on what is not averaged; what was said; nan, (): not measured."""

    effect: str
    declared: float
    diagnosed: float
    process: float
    sparse: float
    usual: float
    named: bool
    kept: tuple[str, ...]
    kept_usual: tuple[str, ...]


def compared(job: Job) -> Row:
    """One record, corrected in each way."""
    radius = RADII[job.ring]
    columns = plant.play(seed=job.seed, seconds=SECONDS, radius=radius, process=job.process, **job.what)
    record = record_of(Table(columns), np.ones(len(columns["t"]), dtype=bool))
    done = diagnose(record, radius, DECLARED)
    ground = ground_of(record, radius, done)
    if len(ground.held_out) != done.after.windows:
        raise SystemExit(f"{len(ground.held_out)} roll-outs, but the diagnosis has {done.after.windows}")

    def ratio(correction: Correction | None) -> float:
        if correction is None:
            return float("nan")
        return error_of(ground, correction.force, ground.held_out) / done.after.floor

    averaged, usual = None, None
    if pysindy():
        averaged, usual = (chosen(ground, sparse_regression, how) for how in (True, False))
    return Row(
        next(iter(job.true), "nothing"), ratio(Correction(lambda x, v, t, motion: np.zeros_like(x))),
        done.after.rollout40 / done.after.floor, ratio(chosen(ground, gaussian_process)), ratio(averaged), ratio(usual),
        {e["name"] for e in done.effects} == set(job.true),
        averaged.kept if averaged else (), usual.kept if usual else (),
    )  # fmt: skip


def pysindy() -> str:
    """Its version; empty where it is not installed."""
    try:
        return version("pysindy")
    except PackageNotFoundError:
        return ""


def table(rows: Sequence[Row]) -> list[str]:
    """A line for each effect, with a figure for each record."""
    lines = [
        "| in the record | declared model | `diagnose` | names right | Gaussian process | STLSQ | its terms | names"
        " right | STLSQ as usual | names right |",
        "|---" * 10 + "|",
    ]
    measured = bool(pysindy())
    for effect in dict.fromkeys(row.effect for row in rows):
        here = [row for row in rows if row.effect == effect]

        def figures(name: str, here: list[Row] = here) -> str:
            return ", ".join(f"{getattr(row, name):.2f}" for row in here)

        def verdicts(said: Sequence[bool]) -> str:
            return ", ".join("yes" if s else "no" for s in said)

        none = RIGHT[effect] is None
        sparse = ["-"] * 5
        if measured:
            names = [
                "none of these" if none else verdicts([right(effect, k) for k in kept])
                for kept in ([r.kept for r in here], [r.kept_usual for r in here])
            ]
            terms = "; ".join(dict.fromkeys(", ".join(row.kept) or "nothing" for row in here))
            sparse = [figures("sparse"), terms, names[0], figures("usual"), names[1]]
        ours = [figures("declared"), figures("diagnosed"), verdicts([r.named for r in here])]
        cells = [effect, *ours, figures("process"), *sparse]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def in_words(rows: Sequence[Row]) -> list[str]:
    """What the table says."""
    ways = {"declared": "declared model", "diagnosed": "`diagnose`", "process": "Gaussian process"}
    if pysindy():
        ways |= {"sparse": "STLSQ", "usual": "STLSQ as usual"}
    lines = []
    for name, words in ways.items():
        ratios = [getattr(row, name) for row in rows]
        lines.append(f"- {words}: median {np.median(ratios):.2f} times noise alone, worst {max(ratios):.2f}")
    said = f"`diagnose` in {sum(row.named for row in rows)}"
    if pysindy():
        can = [row for row in rows if RIGHT[row.effect] is not None]
        counts = [
            sum(right(row.effect, kept) for row, kept in zip(can, each, strict=True))
            for each in ([r.kept for r in can], [r.kept_usual for r in can])
        ]
        said += f", STLSQ in {counts[0]} (as usual: {counts[1]}; its terms could have been right in {len(can)})"
    return [*lines, f"- right names in {len(rows)} records: {said}, a Gaussian process has no names"]


def baselines_section(quick: bool, workers: int = 2) -> list[str]:
    """Everything, as lines of Markdown."""
    jobs = [j for j in jobs_of(SEEDS) if j.ring == RING and not j.process and j.group.endswith(f" x {SIZE}")]
    jobs += [j for j in jobs_of(SEEDS) if j.ring == RING and j.group == "nothing"][:SEEDS]
    rows = []
    with ProcessPoolExecutor(workers) as pool:
        for row in pool.map(compared, jobs[:: 2 * SEEDS] if quick else jobs):
            rows.append(row)
            print(row, file=sys.stderr, flush=True)
    installed = pysindy()
    how = f"PySINDy {installed}" if installed else "PySINDy is not installed here, so that its columns are empty"
    return [
        "## Diagnosis beside other ways to correct a model",
        "",
        f"The same plant, ring {RING}, effects at {SIZE} times the smallest size, {SEEDS} records each: 40-step error"
        " on the last 30 % over that of noise alone. `diagnose` as it is; a Gaussian process on the residual"
        f" acceleration (at most {MOST} rows of speed, angle, tilts and their rates); sparse regression of it on"
        f" {len(TERMS)} terms of named effects ({how}; threshold by cross-validation in {FOLDS} blocks,"
        " one-standard-error rule). Derivatives by Savitzky and Golay, the window chosen by roll-outs within the first"
        " 70 %; what it averages is averaged in the declared model and in the regressors, too (`as usual`: it is not)."
        " All begin on the same rows from the same states, those of the diagnosed model's filter, and see the same"
        " motion of the plate, which favours the others. `none of these`: no sum of the terms makes the effect.",
        "",
        *table(rows),
        "",
        *in_words(rows),
    ]


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    print("\n".join(baselines_section(given.quick, given.workers)))
