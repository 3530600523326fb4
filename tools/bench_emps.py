"""What `mazeplan diagnose --system emps` finds: the measured axis of the benchmark, and a plant of its own. Used by
tools/bench.py.

Usage: python tools/bench_emps.py [--quick]
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import Any

from mazeplan.diagnosis.mechanism.diagnose import MechanismDiagnosis, diagnose_mechanism
from mazeplan.diagnosis.mechanism.drive_log import MotionLog, read_drive
from mazeplan.diagnosis.mechanism.emps import EMPS

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))
# the tests' truth, which shares nothing with the models
import axisplant  # noqa: E402  # pyright: ignore[reportMissingImports]

FRICTION = ("viscous_friction", "dry_friction")
RECORDS = ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat")  # the second one, where there is one, is only scored
# in the record, and what is to be found of it: about twice the smallest sizes worth a word
CASES: dict[str, tuple[dict[str, Any], str | None]] = {
    "nothing": ({}, None),
    "nothing, much process noise": ({"process": 1.5}, None),
    "viscous friction, 20 N s/m more forwards": ({"lopsided": 20.0}, "viscous_asymmetry"),
    "quadratic drag 300 N s^2/m^2": ({"quadratic": 300.0}, "quadratic_drag"),
    "elastic force 12 N/m": ({"stiffness": 12.0}, "elastic_force"),
    "friction that grows by 20 N s/m": ({"drift": 1.0}, "friction_drift"),
}


def data_folder() -> Path | None:
    """Where the benchmark's records are: MAZEPLAN_DATA, or beside the checkout."""
    for folder in (os.environ.get("MAZEPLAN_DATA"), ROOT.parent / "shared" / "data"):
        if folder is not None and (Path(folder) / "emps" / RECORDS[0]).exists():
            return Path(folder) / "emps"
    return None


def in_words(done: MechanismDiagnosis) -> str:
    """Effects with values, the unknown."""
    parts = []
    for e in done.effects:
        numbers = (f"{n} {p['value']:.4g} +- {p['stderr']:.1g} {p['unit']}" for n, p in e["parameters"].items())
        parts.append(f"{e['name']}: {', '.join(numbers)}")
    unknown = done.document()["unknown"]
    return "; ".join(parts + ([unknown["description"]] if unknown else [])) or "-"


def emps_rows(folder: Path, quick: bool) -> list[str]:
    """The measured axis: declared nothing but that it has a mass, and symmetric friction beside."""
    rows = [
        "| known, fitted along | finding | on | force error before, after | free run before, after, mm | s |",
        "|---" * 6 + "|",
    ]
    log, second = read_drive(folder / RECORDS[0]), folder / RECORDS[1]
    test = read_drive(second, log.gain) if second.exists() else None
    for along in ((), FRICTION)[1 if quick else 0 :]:
        began = time.perf_counter()
        done = diagnose_mechanism(EMPS, log, {}, along, test=test)
        seconds = time.perf_counter() - began
        known, scored = ", ".join(["moving_mass", *along]), [("the last 30 %", done.before, done.after)]
        if done.test is not None:
            scored.append(("the second record", *done.test))
        for where, before, after in scored:
            force = f"{before.nrmse:.2%}, {after.nrmse:.2%}"
            run = f"{1e3 * before.free_run:.1f}, {1e3 * after.free_run:.1f} ({after.seconds:.1f} s)"
            rows.append(f"| {known} | {in_words(done)} | {where} | {force} | {run} | {seconds:.0f} |")
            print(rows[-1], file=sys.stderr)
    return rows


def plant_rows(quick: bool) -> list[str]:
    """Effects at small sizes, and records in which nothing is missing; friction and mass are fitted along."""
    rows = ["| in the record | records | named | wrong names | longest, s |", "|---" * 5 + "|"]
    for name, (what, true) in list(CASES.items())[: 3 if quick else None]:
        named, wrong, longest = 0, 0, 0.0
        seeds = range(1 if quick else 4)
        for seed in seeds:
            columns = axisplant.play(seed=seed, **what)
            gain = columns["gtau"]
            log = MotionLog(axisplant.DT, columns["qm"].ravel(), gain * columns["vir"], gain)
            began = time.perf_counter()
            done = diagnose_mechanism(EMPS, log, {}, FRICTION)
            longest = max(longest, time.perf_counter() - began)
            found = [e["name"] for e in done.effects]
            named += true in found if true else done.verdict == "nothing_missing"
            wrong += any(other != true for other in found)
        rows.append(f"| {name} | {len(seeds)} | {named} | {wrong} | {longest:.0f} |")
        print(rows[-1], file=sys.stderr)
    return rows


def emps_section(quick: bool) -> list[str]:
    """Everything, as lines of Markdown."""
    lines = [
        "## Diagnosis of a drive axis",
        "",
        "`mazeplan diagnose DATA_EMPS.mat --system emps`. Search and fits see the first 70 % of the record. Published",
        "on the whole of it: force error 4.08 % with symmetric, 3.11 % with direction-dependent friction.",
        "",
    ]
    folder = data_folder()
    lines += ["The record is not on this machine."] if folder is None else emps_rows(folder, quick)
    return [
        *lines,
        "",
        "### A plant of its own",
        "",
        "tests/axisplant.py, which shares nothing with the models: 20 s at 1 kHz, under control. Simulated.",
        "",
        *plant_rows(quick),
    ]


if __name__ == "__main__":
    print("\n".join(emps_section("--quick" in sys.argv)))
