"""Section `diagnose`: what `mazeplan diagnose` finds in records of others: logs with one undeclared effect, the
published rig, and the drive axis of the benchmark EMPS."""

from __future__ import annotations

import time
from typing import Any

from bench_kit import Section, Table, data_folder, mazeplan

DECLARED = ("--declare", "rolling_inertia.factor=0.7142857142857143", "--declare", "viscous_friction.coefficient=0.35")


def in_words(document: dict[str, Any]) -> str:
    """Effects with values and standard errors, groups that are hard to tell apart, the unknown."""
    parts = []
    for effect in document["effects"]:
        numbers = (
            f"{name} {p['value']:.4g} ± {p['stderr']:.1g} {p['unit']}".strip()
            if p["stderr"]
            else f"{name} {p['value']:.4g}"
            for name, p in effect["parameters"].items()
        )
        parts.append(f"{effect['name']}: {', '.join(numbers)}")
    parts += [f"hard to tell apart: {', '.join(group)}" for group in document["ambiguous_with"]]
    return "; ".join(parts + ([document["unknown"]["description"]] if document["unknown"] else [])) or "-"


def add(table: Table, name: str, *words: str, score: str = "rollout40") -> None:
    """Diagnose a record, and append its row."""
    began = time.perf_counter()
    done = mazeplan("diagnose", *words)
    took = time.perf_counter() - began
    errors = [f"{done[when][score]:.4f}" for when in ("before", "after")]
    table.add(name, done["verdict"], in_words(done), *errors, f"{took:.0f}")


def found(caption: str) -> Table:
    """An empty table."""
    return Table(("record", "verdict", "finding", "before", "after", "s"), caption=caption)


def diagnose_section(quick: bool) -> Section:
    """A table for each kind of record that is on this machine."""
    tables: list[Table] = []
    undeclared, measured, emps = (data_folder(name) for name in ("undeclared", "cme-rig", "emps"))
    if undeclared is not None:
        table = found("Logs with one undeclared effect each: error after 40 samples, rad")
        for path in sorted(undeclared.glob("case-*.csv"))[: 2 if quick else None]:
            add(table, path.stem, str(path), "--radius", "0.0925", *DECLARED)
        tables.append(table)
    if measured is not None:
        table = found("Measured data of the published rig: nRMSE of theta_dd")
        for ring in (1,) if quick else (1, 2, 3, 4):
            add(table, f"ring {ring}", str(measured / f"ring{ring}.csv"), "--ring", str(ring), score="nrmse")
        tables.append(table)
    if emps is not None:
        table = found("Drive axis (EMPS): relative force error")
        add(table, "DATA_EMPS.mat", str(emps / "DATA_EMPS.mat"), "--system", "emps", score="nrmse")
        tables.append(table)
    notes = (
        "`mazeplan diagnose LOG`. Errors are of blocks that took no part in search and fit.",
        "Undeclared: rolling_inertia 5/7 and viscous_friction 0.35 1/s are declared, radius 92.5 mm.",
        "Published force error of EMPS on the whole record: 4.08 % (symmetric friction), 3.11 % (by direction).",
    )
    return Section("Diagnosis of records of others", notes, tables)
