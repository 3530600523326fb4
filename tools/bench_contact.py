"""Section `contact`: verdicts on records of two rigs that others simulated with contact, against a reference record."""

from __future__ import annotations

import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from bench_kit import Section, Table, data_folder

from mazeplan.core.logs.table import read_table
from mazeplan.diagnosis.rig.reference import reference_of
from mazeplan.diagnosis.rig.verdict import verdict_on
from mazeplan.learning.modelfile import load_model
from mazeplan.maze.mapfile import load_map

# What changed on rig A, by record; of rig B it is not known here.
TRUE = {
    "null-1": "", "null-2": "", "null-3": "", "friction": "dry_friction", "hollow": "rolling_inertia",
    "tilt": "tilt_offset", "late": "sensor_delay", "camera-offset": "camera_offset", "camera-scale": "camera_scale",
    "camera-turned": "axis_misalignment", "gain": "servo_gain", "slow-servo": "servo_lag", "cross": "axis_coupling",
    "sensor": "tilt_gain", "backlash": "backlash", "warp": "surface_profile", "magnet": "surface_bump",
    "rocking": "table_rocking", "drops-friction": "dry_friction",
}  # fmt: skip


def rig_rows(folder: Path, quick: bool) -> list[list[str]]:
    """A row for each record of a rig."""
    maze = load_map("cme")
    reference = reference_of([read_table(folder / "reference.csv")], maze, load_model(folder / "model"))
    rows = []
    for path in sorted(path for path in folder.glob("*.csv") if path.stem != "reference")[: 2 if quick else None]:
        began = time.perf_counter()
        done = verdict_on(read_table(path), maze, reference)
        took = time.perf_counter() - began
        sizes = [
            f"{key} {number['value']:.4g} ± {number['stderr']:.2g}"
            for effect in done.effects for key, number in effect["parameters"].items()
            if abs(number["value"] - effect["known_before"].get(key, 0.0)) > 3.0 * number["stderr"]
        ]  # fmt: skip
        names = ", ".join(effect["name"] for effect in done.effects)
        errors = [f"{when['rollout40']:.3f}" for when in (done.before, done.after)]
        name = f"{folder.name} {path.stem}"
        rows.append([name, done.verdict, names, ", ".join(sizes), *errors, f"{done.remaining:.2f}", f"{took:.0f}"])
    return rows


def contact_section(quick: bool) -> Section:
    """Totals of rig A, and a row for each record."""
    title, folder = "Diagnosis of balls that touch walls", data_folder("contact")
    if folder is None:
        raise SystemExit("contact: the records are not on this machine; MAZEPLAN_DATA names the folder of the data")
    rigs = [folder / name for name in ("A", "B")]
    with ProcessPoolExecutor(len(rigs)) as pool:
        found = [row for rows in pool.map(rig_rows, rigs, [quick] * len(rigs)) for row in rows]
    table = Table(("record", "verdict", "effects", "sizes", "before", "after", "remaining", "s"))
    right = surplus = effects = 0
    for row in found:
        table.add(*row)
        rig, _, record = row[0].partition(" ")
        if rig == "A":
            names, true = [name for name in row[2].split(", ") if name], TRUE.get(record, "")
            effects += bool(true)
            right += bool(true) and names[:1] == [true]
            surplus += len([name for name in names if name != true])
    total = Table(("what", "figure"))
    total.add("rig A: the right effect first", f"{right} of {effects}")
    total.add("rig A: wrong names", f"{surplus} in {sum(row[0].startswith('A ') for row in found)} records")
    notes = (
        "`mazeplan diagnose LOG --reference REFERENCE --model MODEL`: records of 300 s, reference of 600 s.",
        "Before and after: error of the angle after 40 samples, rad. Remaining: innovations over those of noise alone.",
        "Thresholds were chosen on rig A.",
    )
    return Section(title, notes, (total, table))
