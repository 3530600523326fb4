"""Prints constraints.txt: one exact version of everything that mazeplan and its extras need. Usage: make constraints"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
EXTRAS = "dev,learn,view,hardware"
EXACT = ("mujoco==4.0.0", "torch==2.13.0")  # results are compared across machines: physics and fits must not drift
HEAD = """\
# Exact versions of everything that mazeplan and its extras need; `make navigate` and `make test` install these.
# Written by `make constraints` (tools/pin.py): the newest that fit together, but for those that are named there."""


def resolved() -> dict[str, str]:
    """{package: version} that pip would install into an empty environment; local parts such as +cpu left out."""
    command = [sys.executable, "-m", "pip", "install", "--dry-run", "--ignore-installed", "--quiet", "--report", "-"]
    done = subprocess.run([*command, f"{ROOT}[{EXTRAS}]", *EXACT], stdout=subprocess.PIPE, text=True, check=True)
    found = [item["metadata"] for item in json.loads(done.stdout)["install"]]
    return {item["name"]: item["version"].split("+")[0] for item in found}


def wanted(package: str) -> bool:
    """Not mazeplan itself, nor what torch brings and pins for graphics cards."""
    return package != "mazeplan" and not package.startswith(("nvidia-", "cuda-", "triton"))


def main() -> None:
    print(HEAD)
    for package, version in sorted(resolved().items(), key=lambda item: item[0].lower()):
        if wanted(package):
            print(f"{package}=={version}")


if __name__ == "__main__":
    main()
