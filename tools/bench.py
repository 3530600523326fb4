"""Measures the figures of the program. Usage: python tools/bench.py [--quick] [--only NAME ...] [-o FOLDER]

All figures go into docs/history.json: for each section its title, date, command, machine, notes and tables. The figures
that answer a user's questions go into BENCHMARKS.md, too. `--write` writes BENCHMARKS.md from the file, and measures
nothing. Without --only, sections that take hours are left out.
"""

from __future__ import annotations

import argparse
import json
import platform
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from bench_balls import balls_section
from bench_campaign import campaign_section
from bench_contact import contact_section
from bench_contactplant import contactplant_section
from bench_diagnose import diagnose_section
from bench_drive import drive_section
from bench_effects import effects_section
from bench_faults import faults_section
from bench_growth import growth_section
from bench_kit import ROOT, Section
from bench_logged_runs import loggedruns_section
from bench_measured import machines_section
from bench_models import models_section
from bench_plant import plant_section
from bench_policy import policy_section
from bench_realtime import realtime_section
from bench_rig import rig_section
from bench_strange import drawn_section, strange_section
from bench_trees import trees_section
from bench_waiting import waiting_section

SECTIONS: dict[str, Callable[[bool], Section]] = {
    "drive": drive_section, "realtime": realtime_section, "faults": faults_section,
    "balls": balls_section, "policy": policy_section, "campaign": campaign_section,
    "trees": trees_section, "models": models_section, "strange": strange_section, "drawn": drawn_section,
    "diagnose": diagnose_section, "loggedruns": loggedruns_section, "effects": effects_section,
    "contact": contact_section, "contactplant": contactplant_section, "plant": plant_section,
    "growth": growth_section, "rig": rig_section, "machines": machines_section, "waiting": waiting_section,
}  # fmt: skip
HOURS = ("strange", "drawn", "effects", "contactplant", "plant")
PACKAGES = ("mazeplan", "numpy", "scipy", "numba", "mujoco")


@dataclass(frozen=True)
class Pick:
    """Rows of BENCHMARKS.md.

    table: number of the table of the section.
    columns: columns that are shown as figures.
    what: text that names a row; {0} is its first cell.
    rows: texts, one of which a shown row has; empty: all rows."""

    section: str
    table: int
    columns: tuple[str, ...]
    what: str = "{0}"
    rows: tuple[str, ...] = ()


TIMES = ("arrived", "mean s", "p95", "worst")
TOTAL = ("figure",)
ERRORS = ("before", "after")
PAGE: dict[str, tuple[Pick, ...]] = {
    "Does the ball arrive, and how fast?": (
        Pick("drive", 0, TIMES),
        Pick("realtime", 0, ("arrived", "mean s", "p99 ms"), "toy in real time, machine: {0}"),
        Pick("rig", 0, ("arrived", "s", "failures on the way"), "firmware and camera emulated, seed {0}", (" 0 ",)),
        Pick("balls", 0, ("arrived", "mean, s", "longest, s"), "two balls on {0}"),
        Pick("policy", 0, ("arrived", "mean s", "worst"), "learned policy: {0}"),
    ),
    "What happens when something fails?": (
        Pick("faults", 0, TOTAL),
        Pick("rig", 1, ("level pulses after ms",), "program killed in a run, trial {0}", (" 0 ",)),
    ),
    "What does learning bring on other rigs?": (
        Pick("strange", 0, ("without a model", "learned")),
        Pick("drawn", 0, TOTAL, "drawn rigs: {0}"),
        Pick("strange", 1, ("within 1.05", "arrived"), "{0}: models of 120 s of record beside those of 600 s"),
    ),
    "Does it find what is wrong?": (
        Pick("effects", 0, TOTAL, "record, diagnosis, new model: {0}"),
        Pick("contact", 0, TOTAL, "records of others: {0}"),
        Pick("contactplant", 0, TOTAL, "drawn rigs with walls: {0}"),
        Pick("plant", 0, ("records", "right", "with a wrong name"), "rings without walls: {0}"),
        Pick("loggedruns", 0, TOTAL, "logs of navigation: {0}"),
    ),
    "On whose data?": (
        Pick("models", 0, ("pi", "np", "sp"), "published rig, {0}: nRMSE, train / test"),
        Pick("models", 1, ("pi", "np", "sp"), "published rig, {0}: rad after 20 / 40 samples"),
        Pick("machines", 0, ("finding", "right", "CPU s"), "machine of others: {0}"),
        Pick("diagnose", 1, ERRORS, "published rig, {0}: nRMSE with all named effects"),
        Pick("diagnose", 0, ("finding", *ERRORS), "log with one undeclared effect, {0}: rad after 40 samples"),
        Pick("diagnose", 2, ERRORS, "drive axis, force error: {0}"),
    ),
    "How fast is the program?": (
        Pick("drive", 1, ("p99 ms (worst run)", "longest ms"), "a tick on {0}"),
        Pick("policy", 1, TOTAL, "learned policy: {0}", ("one decision",)),
    ),
    "How long do people wait?": (Pick("waiting", 0, ("earlier, s", "s", "limit, s", "over the limit", "peak MB")),),
    "How does cost grow with size?": (Pick("growth", 0, ("size: time", "exponent"), "{0}, {1}"),),
    "What does each part bring? (toy)": (
        Pick("drive", 2, ("arrived", "mean s", "worst")),
        Pick("drive", 3, ("arrived", "mean s"), "{0}, camera: {1}", (" neither ",)),
    ),
    "What do damaged files do?": (Pick("trees", 1, ("loads", "error at a line", "anything else"), "{0}", (" all ",)),),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="few runs, to try the script itself")
    parser.add_argument("--only", choices=list(SECTIONS), nargs="+", help="measure these sections, keep the others")
    parser.add_argument("--write", action="store_true", help="measure nothing, write BENCHMARKS.md from the figures")
    parser.add_argument("-o", "--output", type=Path, default=ROOT, help="folder of BENCHMARKS.md and docs/history.json")
    options = parser.parse_args()
    names = options.only or [name for name in SECTIONS if name not in HOURS]
    for name in () if options.write else names:
        keep(options.output, name, SECTIONS[name](options.quick), options.quick)
    history = load(options.output)
    (options.output / "BENCHMARKS.md").write_text("\n".join(page(history)) + "\n", encoding="utf-8")


def load(folder: Path) -> dict[str, Any]:
    """{name: section} of the file of figures; that of the checkout if the folder has none."""
    path = folder / "docs" / "history.json"
    return json.loads((path if path.exists() else ROOT / "docs" / "history.json").read_text(encoding="utf-8"))


def keep(folder: Path, name: str, section: Section, quick: bool = False) -> None:
    """Put a section into the file of figures."""
    history = load(folder)
    history[name] = {
        "title": section.title,
        "date": f"{datetime.now(UTC):%Y-%m-%d}" + (" (quick)" if quick else ""),
        "command": f"python tools/bench.py --only {name}",
        "machine": f"{cpu()}, Python {platform.python_version()}, {platform.system()}; "
        + ", ".join(f"{package} {version(package)}" for package in PACKAGES),
        "notes": list(section.notes),
        "tables": [asdict(table) for table in section.tables],
    }
    path = folder / "docs" / "history.json"
    path.parent.mkdir(exist_ok=True, parents=True)
    path.write_text(json.dumps(history, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def cpu() -> str:
    """Name of the processor, if the system has it."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor() or platform.machine())


def page(history: dict[str, Any]) -> Iterator[str]:
    """Lines of BENCHMARKS.md."""
    yield "# Benchmarks"
    yield ""
    yield "`python tools/bench.py` measures these figures and writes this page. `--only NAME` stands for"
    yield "`python tools/bench.py --only NAME`. Rigs are simulated, except in the rows about measured data. On hardware"
    yield "(published), 7 of 10 runs arrived, after 7.71 s on average."
    yield ""
    yield "[docs/history.json](docs/history.json) has all figures, also those of sections whose program has left, with"
    yield "the conditions of measurement and the machine. The documentation shows it as tables."
    for question, picks in PAGE.items():
        yield ""
        yield f"## {question}"
        yield ""
        yield "| what | figures | again with | date |"
        yield "|---|---|---|---|"
        for pick in picks:
            if pick.section in history and pick.table < len(history[pick.section]["tables"]):
                yield from rows(pick, history[pick.section])


def rows(pick: Pick, section: dict[str, Any]) -> Iterator[str]:
    """Rows that a pick shows."""
    table = section["tables"][pick.table]
    at = {name: table["columns"].index(name) for name in pick.columns}
    for cells in table["rows"]:
        text = f" {' | '.join(cells)} "
        if pick.rows and not any(part in text for part in pick.rows):
            continue
        named = (
            cells[i] if name in ("figure", "size: time") else f"{name} {cells[i]}" for name, i in at.items() if cells[i]
        )
        figures = "; ".join(named).replace("finding - ", "nothing missing ")
        yield f"| {pick.what.format(*cells)} | {figures} | `--only {pick.section}` | {section['date']} |"


if __name__ == "__main__":
    main()
