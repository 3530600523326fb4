"""Verdicts on records of balls that touch walls, against a reference record of the same rig.

Usage: python tools/bench_contact.py [--quick]. Two rigs that others simulated with contact, taken from MAZEPLAN_DATA or
beside the checkout, and left out where there are none. What changed is known of rig A; of rig B it is not. Used by
tools/bench.py.
"""

from __future__ import annotations

import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from bench_body import contact_folder

from mazeplan.core.logs.table import read_table
from mazeplan.diagnosis.rig.reference import RigReference, reference_of
from mazeplan.diagnosis.rig.result import RigVerdict
from mazeplan.diagnosis.rig.verdict import verdict_on
from mazeplan.learning.modelfile import load_model
from mazeplan.maze.mapfile import load_map

MAZE = load_map("cme")
TRUE = {
    "null-1": "", "null-2": "", "null-3": "", "friction": "dry_friction", "hollow": "rolling_inertia",
    "tilt": "tilt_offset", "late": "sensor_delay", "camera-offset": "camera_offset", "camera-scale": "camera_scale",
    "camera-turned": "axis_misalignment", "gain": "servo_gain", "slow-servo": "servo_lag", "cross": "axis_coupling",
    "sensor": "tilt_gain", "backlash": "backlash", "warp": "surface_profile", "magnet": "surface_bump",
    "rocking": "table_rocking", "drops-friction": "dry_friction",
}  # fmt: skip


def record_row(path: Path, was: RigReference) -> tuple[str, RigVerdict]:
    """A line of the table: what was found, how it predicts, how long it took."""
    began = time.perf_counter()
    done = verdict_on(read_table(path), MAZE, was)
    took = time.perf_counter() - began
    names = [effect["name"] for effect in done.effects]
    sizes = [
        f"{key} {number['value']:.4g} ± {number['stderr']:.2g}"
        for effect in done.effects for key, number in effect["parameters"].items()
        if abs(number["value"] - effect["known_before"].get(key, 0.0)) > 3.0 * number["stderr"]
    ]  # fmt: skip
    errors = f"{done.before['rollout40']:.3f} | {done.after['rollout40']:.3f}"
    cells = [
        path.stem,
        done.verdict,
        ", ".join(names),
        ", ".join(sizes),
        errors,
        f"{done.remaining:.2f}",
        f"{took:.0f}",
    ]
    return f"| {' | '.join(cells)} |", done


def rig_rows(folder: Path, quick: bool) -> tuple[list[str], int, int]:
    """The lines of a rig; how many of its known effects come first, and how many names there are too many."""
    began = time.perf_counter()
    was = reference_of([read_table(folder / "reference.csv")], MAZE, load_model(folder / "model"))
    rows, right, surplus = [f"| {folder.name}: reference | | | | | | | {time.perf_counter() - began:.0f} |"], 0, 0
    records = sorted(path for path in folder.glob("*.csv") if path.stem != "reference")
    for path in records[: 2 if quick else None]:
        row, done = record_row(path, was)
        rows.append(row)
        names, true = [effect["name"] for effect in done.effects], TRUE.get(path.stem, "")
        right += bool(true) and names[:1] == [true]
        surplus += len([name for name in names if name != true])
        print(row, file=sys.stderr, flush=True)
    return rows, right, surplus


def contact_section(quick: bool) -> list[str]:
    """Everything, as lines of Markdown."""
    folder = contact_folder()
    lines = [
        "## Diagnosis of balls that touch walls",
        "",
        "`mazeplan diagnose LOG --reference REFERENCE --model MODEL`: records of 300 s by two rigs that others",
        "simulated with contact, against a record of 600 s in which the model was right. Errors of the angle (rad) 40",
        "samples ahead, each half predicted with what the other half tells; remaining: innovations over those",
        "that noise alone would cause. What changed on B is not known here. Thresholds were chosen on A.",
        "",
    ]
    if folder is None:
        return [*lines, "The records are not on this machine (MAZEPLAN_DATA names their folder); nothing was measured."]
    table, (right, surplus) = list[str](), (0, 0)
    rigs = (folder, folder.parent / "B")
    with ProcessPoolExecutor(len(rigs)) as pool:
        found = list(pool.map(rig_rows, rigs, [quick] * len(rigs)))
    for rig, (rows, first, more) in zip(rigs, found, strict=True):
        table += rows
        if rig.name == "A":
            right, surplus = first, more
    effects = sum(bool(name) for name in TRUE.values())
    return [
        *lines,
        f"On A {right} of {effects} effects come first, with {surplus} names too many in {len(TRUE)} records.",
        "",
        "| record | verdict | effects | sizes | before | after | remaining | s |", "|---" * 8 + "|", *table,
    ]  # fmt: skip


if __name__ == "__main__":
    print("\n".join(contact_section("--quick" in sys.argv)))
