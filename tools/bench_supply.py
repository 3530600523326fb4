"""The section on installation for BENCHMARKS.md: the wheel in empty environments, the lowest versions, the pins."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

from check_pins import FILE, needed, pins, problems
from try_wheel import try_wheel

ROOT = Path(__file__).resolve().parent.parent
PYTHONS = ("python3.11", "python3.12", "python3.13")
LIMIT_S = 1800.0  # for the lowest versions: installation, compilation and tests


def supply_section(quick: bool) -> list[str]:
    """Rows in Markdown; quick: the wheel for this Python alone, without the lowest versions."""
    rows = ["## Installation", "", "| what | command | result |", "|---|---|---|"]
    for python in [sys.executable] if quick else [found for name in PYTHONS if (found := working(name))]:
        got = try_wheel(python)
        rows.append(
            f"| wheel of {got['megabytes']} MB in an empty environment, Python {got['python']} | "
            f"`python tools/try_wheel.py` | {got['good']} of {got['commands']} commands of README |"
        )
        print(rows[-1], file=sys.stderr)
    if not quick:
        rows.append(f"| lowest versions that pyproject.toml allows | `make lowest` | {lowest_tests()} |")
    pinned = pins(FILE.read_text(encoding="utf-8"))
    wrong = len(problems(pinned, needed()))
    rows.append(f"| pins in constraints.txt | `make pins` | {len(pinned)} pins, {wrong} wrong or missing |")
    return rows


def working(name: str) -> str | None:
    """The program of a Python that is there and starts, or None."""
    for found in (shutil.which(name), *(str(path) for path in Path.home().glob(f".pyenv/versions/*/bin/{name}"))):
        if found and subprocess.run([found, "-c", ""], capture_output=True, check=False).returncode == 0:
            return found
    return None


def lowest_tests() -> str:
    """`N tests passed, M failed` of `make lowest`."""
    done = subprocess.run(["make", "lowest"], cwd=ROOT, capture_output=True, text=True, check=False, timeout=LIMIT_S)
    passed, failed = (re.search(rf"(\d+) {word}", done.stdout) for word in ("passed", "failed"))
    if passed is None:
        return f"exit status {done.returncode}"
    return f"{passed[1]} tests passed, {failed[1] if failed else 0} failed"
