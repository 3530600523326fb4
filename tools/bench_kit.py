"""What the sections of tools/bench.py share: records of figures, commands, data of others, and outcomes that resume."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
BUILD = ROOT / "build"
sys.path.insert(0, str(ROOT / "tests"))  # its plants and rigs, which share nothing with the models


@dataclass
class Table:
    """Rows of figures under the names of their columns."""

    columns: Sequence[str]
    rows: list[list[str]] = field(default_factory=list)
    caption: str = ""

    def add(self, *cells: object) -> None:
        """Append a row, and print it to stderr."""
        row = [str(cell) for cell in cells]
        assert len(row) == len(self.columns), (row, self.columns)
        self.rows.append(row)
        print(" | ".join(row), file=sys.stderr, flush=True)


@dataclass
class Section:
    """What a section measured.

    notes: sentences on how it was measured."""

    title: str
    notes: Sequence[str]
    tables: Sequence[Table]


def mazeplan(*words: str) -> dict[str, Any]:
    """The JSON document of a command. Ends the program if the command prints none."""
    command = [sys.executable, "-m", "mazeplan", *words, "--json"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    if not done.stdout.strip():
        raise SystemExit(f"mazeplan {' '.join(words)}: exit {done.returncode}\n{done.stderr}")
    return json.loads(done.stdout)


def execute(*words: str) -> None:
    """Run a command that prints no document. Raises CalledProcessError."""
    subprocess.run([sys.executable, "-m", "mazeplan", *words], check=True, capture_output=True, cwd=ROOT)


def data_folder(name: str) -> Path | None:
    """A folder of measured data: in MAZEPLAN_DATA, or beside the checkout. None if it is not on this machine."""
    for folder in (os.environ.get("MAZEPLAN_DATA"), ROOT.parent / "shared" / "data"):
        if folder is not None and (Path(folder) / name).exists():
            return Path(folder) / name
    return None


def arrivals(results: Iterable[Any]) -> tuple[str, list[float], str]:
    """Of navigation results: "arrived/runs", times of those that arrived (s), and failures by kind."""
    done = list(results)
    times = [result.time_s for result in done if result.success]
    failures = Counter(str(failure.kind) for result in done for failure in result.failures)
    return f"{len(times)}/{len(done)}", times, counts(failures)


def counts(numbers: dict[str, int]) -> str:
    """Counts by name, in words."""
    return ", ".join(f"{name} {number}" for name, number in sorted(numbers.items())) or "none"


def resumed(
    path: Path, work: Callable[..., dict[str, Any]], jobs: Sequence[tuple[Any, ...]], workers: int = 2
) -> list[dict[str, Any]]:
    """Outcomes of `work(*job)` for each job, one JSON line each in a file.

    Jobs whose outcome is in the file are not done again: an interrupted run goes on. Delete the file to begin anew."""
    path.parent.mkdir(exist_ok=True)
    lines = path.read_text().splitlines() if path.exists() else []
    known = {line["job"]: line["outcome"] for line in map(json.loads, lines)}
    left = [job for job in jobs if json.dumps(job) not in known]
    with ProcessPoolExecutor(workers) as pool, path.open("a") as file:
        for job, outcome in zip(left, pool.map(work, *zip(*left, strict=True)) if left else (), strict=True):
            known[json.dumps(job)] = outcome
            print(json.dumps({"job": json.dumps(job), "outcome": outcome}), file=file, flush=True)
            print(json.dumps(job), outcome, file=sys.stderr, flush=True)
    return [known[json.dumps(job)] for job in jobs]
