"""What `mazeplan diagnose` finds: logs with an undeclared effect, and a plant of its own. Used by tools/bench.py.

Usage: python tools/bench_diagnose.py [--quick]
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from bench_models import data_folder
from bench_plant import DECLARED

from mazeplan.core.logs.table import read_table
from mazeplan.diagnosis.record import record_of
from mazeplan.diagnosis.ring.diagnose import RingDiagnosis, diagnose


def undeclared_rows(folder: Path, quick: bool) -> list[str]:
    """The logs A to H."""
    rows = ["| log | verdict | finding | 40-step error before, after, noise alone, rad | s |", "|---" * 5 + "|"]
    for path in sorted((folder / "undeclared").glob("case-*.csv"))[: 2 if quick else None]:
        table, began = read_table(path), time.perf_counter()
        done = diagnose(record_of(table, np.ones(len(table), dtype=bool)), 0.0925, DECLARED)
        seconds = time.perf_counter() - began
        scores = f"{done.before.rollout40:.4f}, {done.after.rollout40:.4f}, {done.after.floor:.4f}"
        rows.append(f"| {path.stem} | {done.verdict} | {in_words(done)} | {scores} | {seconds:.0f} |")
        print(rows[-1], file=sys.stderr)
    return rows


def in_words(done: RingDiagnosis) -> str:
    """Effects with values, groups that are hard to tell apart, the unknown."""
    parts = []
    for e in done.effects:
        numbers = (f"{n} {p['value']:.4g} +- {p['stderr']:.1g} {p['unit']}".strip() for n, p in e["parameters"].items())
        parts.append(f"{e['name']}: {', '.join(numbers)}")
    parts += [f"hard to tell apart: {', '.join(group)}" for group in done.finding.alike]
    unknown = done.document()["unknown"]
    return "; ".join(parts + ([unknown["description"]] if unknown else [])) or "-"


def diagnose_section(quick: bool) -> list[str]:
    """Everything, as lines of Markdown."""
    lines = [
        "## Diagnosis",
        "",
        "`mazeplan diagnose LOG`. Search and fits see the first 70 % of a record; errors are of the rest.",
        "",
    ]
    measured = data_folder()
    folder = None if measured is None else measured.parent
    if folder is None or not (folder / "undeclared").is_dir():
        lines += ["The logs with an undeclared effect are not on this machine."]
    else:
        lines += ["### Logs with one undeclared effect each", "", *undeclared_rows(folder, quick)]
    return lines


if __name__ == "__main__":
    print("\n".join(diagnose_section("--quick" in sys.argv)))
