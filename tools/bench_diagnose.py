"""What `mazeplan diagnose` finds: logs with an undeclared effect, and a plant of its own. Used by tools/bench.py.

Usage: python tools/bench_diagnose.py [--quick]
"""

from __future__ import annotations

import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from bench_models import data_folder

from mazeplan.data.table import Table, read_table
from mazeplan.diagnosis.diagnose import Diagnosis, diagnose
from mazeplan.diagnosis.record import record_of

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))
# the tests' truth, which shares nothing with the models
import plant  # noqa: E402  # pyright: ignore[reportMissingImports]

DECLARED = {"rolling_inertia": {"factor": 5 / 7}, "viscous_friction": {"coefficient": 0.35}}
RADII = (0.0925, 0.0689, 0.0488)  # m, about rings 1 to 3
SECONDS = 300.0
# smallest sizes that are to be found every time
CASES: dict[str, tuple[dict[str, Any], str]] = {
    "dry friction 0.05": ({"dry": 0.05}, "dry_friction"),
    "tilt offset 0.5 mrad": ({"offset": (0.0005, -0.0005)}, "tilt_offset"),
    "rolling factor 1.5 % off": ({"factor": 5 / 7 * 1.015}, "rolling_inertia"),
    "viscous 0.03 more": ({"viscous": 0.38}, "viscous_friction"),
    "quadratic 0.015": ({"quadratic": 0.015}, "quadratic_drag"),
    "torque 0.045": ({"torque": 0.045}, "constant_torque"),
    "misalignment 7.5 mrad": ({"angle": 0.0075}, "axis_misalignment"),
    "camera 6.6 ms late": ({"delay": 0.0066}, "sensor_delay"),
    "drift 0.12 in the record": ({"drift": 0.12 / SECONDS}, "friction_drift"),
    "bump 0.10": ({"bump": (1.0, 0.3, 0.10)}, "surface_bump"),
}


def run(what: dict[str, Any], radius: float, seed: int) -> tuple[str, list[str], float, float]:
    """Verdict, names, error over floor after, seconds, of one record of the plant."""
    columns = plant.play(seed=seed, seconds=SECONDS, radius=radius, **what)
    began = time.perf_counter()
    done = diagnose(record_of(Table(columns), np.ones(len(columns["t"]), dtype=bool)), radius, DECLARED)
    return (
        done.verdict,
        [e["name"] for e in done.effects],
        done.after.rollout40 / done.after.floor,
        time.perf_counter() - began,
    )


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


def in_words(done: Diagnosis) -> str:
    """Effects with values, groups that are hard to tell apart, the unknown."""
    parts = []
    for e in done.effects:
        numbers = (f"{n} {p['value']:.4g} +- {p['stderr']:.1g} {p['unit']}".strip() for n, p in e["parameters"].items())
        parts.append(f"{e['name']}: {', '.join(numbers)}")
    parts += [f"hard to tell apart: {', '.join(group)}" for group in done.finding.alike]
    unknown = done.document()["unknown"]
    return "; ".join(parts + ([unknown["description"]] if unknown else [])) or "-"


def plant_rows(quick: bool) -> list[str]:
    """Effects at the smallest sizes, and records in which nothing is missing."""
    seeds = range(1)
    radii = RADII[:1] if quick else RADII
    jobs = [(name, what, radius, seed) for name, (what, _) in CASES.items() for radius in radii for seed in seeds]
    nulls = [
        ("nothing" if not noise else "nothing, process noise", {"process": noise} if noise else {}, radius, 100 + seed)
        for noise in (0.0, 0.4)
        for radius in radii
        for seed in range(1 if quick else 2)
    ]
    with ProcessPoolExecutor(2) as pool:
        done = list(pool.map(_run, [*jobs, *nulls]))
    rows = [
        "| in the record | records | named | wrong names | median error over noise alone | longest, s |",
        "|---" * 6 + "|",
    ]
    for name in dict.fromkeys(job[0] for job in [*jobs, *nulls]):
        here = [outcome for job, outcome in zip([*jobs, *nulls], done, strict=True) if job[0] == name]
        true = CASES[name][1] if name in CASES else None
        named = sum(true in names if true else verdict == "nothing_missing" for verdict, names, *_ in here)
        wrong = sum(any(n != true for n in names) for _, names, *_ in here)
        ratio, seconds = np.median([r for *_, r, _ in here]), max(s for *_, s in here)
        rows.append(f"| {name} | {len(here)} | {named} | {wrong} | {ratio:.2f} | {seconds:.0f} |")
        print(rows[-1], file=sys.stderr)
    return rows


def _run(job: tuple[str, dict[str, Any], float, int]) -> tuple[str, list[str], float, float]:
    return run(job[1], job[2], job[3])


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
    return [
        *lines,
        "",
        "### A plant of its own, at the smallest sizes that are to be found",
        "",
        f"tests/plant.py, which shares nothing with the models: {SECONDS:g} s, camera noise 0.3 mm,",
        "tilt noise 8e-4 rad; one record in each of three rings, and records in which nothing is missing. Simulated.",
        "",
        *plant_rows(quick),
    ]


if __name__ == "__main__":
    print("\n".join(diagnose_section("--quick" in sys.argv)))
