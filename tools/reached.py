"""Which tests run a line of the program? tools/mutate.py lets these look for a fault.

    python tools/reached.py [--slow]

The tests run once under coverage.py, each with a context of its own. Lines that run while a module is imported, or
inside of functions that Numba compiled, belong to no test.
"""

from __future__ import annotations

import argparse
import ast
import os
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

from coverage import CoverageData

ROOT = Path(__file__).resolve().parents[1]
OUTPUT = ROOT / "build" / "reached"  # of coverage.py; beside it, the seconds of each test as text
OUTPUT_SLOW = ROOT / "build" / "reached-slow"
FAST, SLOW = "not slow and not realtime", "slow and not realtime"  # tests, by marker
MOST_S = 120.0  # of the tests for one line
CONFIG = "[run]\nsource = mazeplan\nrelative_files = true\nparallel = true\nconcurrency = multiprocessing,thread\n"
MEASURED = re.compile(r"^([\d.]+)s (?:setup|call) +(\S+.*)$", re.MULTILINE)


def record(stage: str, output: Path, root: Path = ROOT, workers: int = 2) -> None:
    """Run the tests of a stage, and write which lines each one runs, and for how long."""
    output.parent.mkdir(parents=True, exist_ok=True)
    config = output.with_name("coverage.ini")  # not NAME.ini: coverage.py deletes all NAME.*
    config.write_text(CONFIG)
    where = {**os.environ, "PYTHONPATH": str(root), "OMP_NUM_THREADS": "1", "COVERAGE_FILE": str(output)}
    command = [sys.executable, "-m", "pytest", "-vv", "-n", str(workers), "-m", stage, "--durations=0"]
    command += ["--durations-min=0", "--cov", f"--cov-config={config}", "--cov-context=test", "--cov-report="]
    ran = subprocess.run(command, cwd=root, env=where, capture_output=True, text=True, check=False)
    seconds = dict[str, float]()
    for spent, name in MEASURED.findall(ran.stdout):
        seconds[name] = seconds.get(name, 0.0) + float(spent)
    if not seconds:
        raise RuntimeError(f"no test ran: {ran.stdout[-2000:]}{ran.stderr[-2000:]}")
    output.with_suffix(".s").write_text("".join(f"{spent:.2f} {name}\n" for name, spent in seconds.items()))


class Reached:
    """What `record` wrote."""

    def __init__(self, path: Path) -> None:
        self.data = CoverageData(str(path))
        self.data.read()
        lines = path.with_suffix(".s").read_text().splitlines()
        self.seconds = {name: float(spent) for spent, _, name in (line.partition(" ") for line in lines)}

    @classmethod
    @cache
    def of(cls, path: Path) -> Reached:
        """The one of a file, read once."""
        return cls(path)

    def tests(self, file: str, first: int, last: int) -> list[str]:
        """Tests that run one of these lines, file by file, those files first that take the shortest time."""
        contexts = self.data.contexts_by_lineno(file)
        names = {context.partition("|")[0] for line in range(first, last + 1) for context in contexts.get(line, [])}
        files = dict[str, list[str]]()
        for name in sorted(names & self.seconds.keys()):
            files.setdefault(name.partition("::")[0], []).append(name)
        for tests in files.values():
            tests.sort(key=self.seconds.__getitem__)
        chosen, spent = list[str](), 0.0
        for name in sorted(files, key=lambda name: sum(map(self.seconds.__getitem__, files[name]))):
            for test in files[name]:
                if spent <= MOST_S:
                    chosen.append(test)
                spent += self.seconds[test]
        return chosen


def statement(source: str, line: int) -> tuple[int, int]:
    """First and last line of what runs as one with a line: the innermost statement, up to this line."""
    found = [node.lineno for node in ast.walk(ast.parse(source))
             if isinstance(node, ast.stmt) and node.lineno <= line <= (node.end_lineno or 0)]  # fmt: skip
    return max(found, default=line), line


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--slow", action="store_true", help="the slow tests, not those of make test")
    slow = parser.parse_args().slow
    record(SLOW if slow else FAST, OUTPUT_SLOW if slow else OUTPUT)


if __name__ == "__main__":
    main()
