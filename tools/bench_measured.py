"""What `mazeplan diagnose --system` finds in records that others measured on hardware. Used by tools/bench.py.

Usage: MAZEPLAN_MEASURED=FOLDER python tools/bench_measured.py [NAME...]

The folder holds tables (CSV), systems.py with a class for each, and answers.json: {table: {"right": [names],
"also": [names]}}. A table is right if the first effect is one of `right`, no effect is outside of both lists, none has
a standard error beyond its size, and no table is called complete.
"""

from __future__ import annotations

import importlib.util
import json
import math
import os
import sys
import time
from pathlib import Path
from typing import Any

from bench_kit import ROOT, Section, Table

from mazeplan.diagnosis.engine.diagnosis import MotionDiagnosis, diagnose_motion
from mazeplan.diagnosis.engine.record import read_record
from mazeplan.diagnosis.engine.system import system_of

# class of a table, by the begin of its name
CLASSES = {"swing": "Swing", "cart": "Cart", "pendulum-motor": "PendulumMotor", "motor": "Motor", "axis": "Axis",
           "arm": "Arm"}  # fmt: skip


def measured_folder() -> Path | None:
    """Where the tables are: MAZEPLAN_MEASURED, or beside the checkout."""
    for folder in (os.environ.get("MAZEPLAN_MEASURED"), ROOT.parent / "shared" / "data" / "measured"):
        if folder is not None and (Path(folder) / "answers.json").exists():
            return Path(folder)
    return None


def classes_of(folder: Path) -> Any:
    """The module systems.py of a folder."""
    spec = importlib.util.spec_from_file_location("measured_systems", folder / "systems.py")
    if spec is None or spec.loader is None:
        raise FileNotFoundError(folder / "systems.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def diagnosed(folder: Path, table: str) -> MotionDiagnosis:
    """The diagnosis of a table."""
    name = next(CLASSES[begin] for begin in sorted(CLASSES, key=len, reverse=True) if table.startswith(begin))
    system = system_of(getattr(classes_of(folder), name))
    record = read_record(folder / f"{table}.csv", system.positions, system.units, system.inputs)
    return diagnose_motion(system, record, {})


def is_right(done: MotionDiagnosis, answer: dict[str, list[str]]) -> bool:
    """Whether a diagnosis agrees with an answer."""
    right, also = answer["right"], answer.get("also", [])
    found = [e["name"] for e in done.effects]
    sized = all(
        p["stderr"] is None or p["stderr"] <= abs(p["value"]) for e in done.effects for p in e["parameters"].values()
    )
    first = found[:1] == [] if not right else bool(found) and found[0] in right
    return first and set(found) <= {*right, *also} and sized and done.verdict != "nothing_missing"


def machines_section(quick: bool, only: list[str] | None = None) -> Section:
    """The records of a folder, or some of them."""
    table = Table(("record", "finding", "error of windows", "free run", "times the noise", "right", "CPU s"))
    folder = measured_folder()
    answers = json.loads((folder / "answers.json").read_text()) if folder is not None else {}
    for name in only or list(answers)[: 3 if quick else None]:
        assert folder is not None
        began = time.process_time()
        done = diagnosed(folder, name)
        seconds = time.process_time() - began
        sizes = ", ".join(
            f"{e['name']} {p['value']:.3g} +- {p['stderr'] or math.nan:.1g}"
            for e in done.effects
            for p in e["parameters"].values()
        )
        run = f"{done.after.free_run:.3g}" if math.isfinite(done.after.free_run) else "leaves the record"
        errors = f"{done.before.nrmse:.3g} -> {done.after.nrmse:.3g}"
        right = "yes" if is_right(done, answers[name]) else "no"
        table.add(
            name, f"{done.verdict}: {sizes or '-'}", errors, run, f"{done.remaining:.2f}", right, f"{seconds:.1f}"
        )
    return Section(
        "Machines that others measured", [f"{sum(r[5] == 'yes' for r in table.rows)} of {len(table.rows)}"], [table]
    )


if __name__ == "__main__":
    section = machines_section("--quick" in sys.argv, [a for a in sys.argv[1:] if not a.startswith("-")])
    print(*section.notes, "right")
