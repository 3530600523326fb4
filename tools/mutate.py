"""Faults put into the core on purpose: which of them does no test notice?

    python tools/mutate.py --count 100 --seed 1 [--slow] [--workers 2] [--only mazeplan/behavior]

Each fault is one small change of the code: < for <=, + for -, and for or, another number. The tests of `make test` that
run the changed line try to notice it, on a copy of the repository; `python tools/reached.py` finds these tests first.
Where no test is known to run the line, those in the files nearest to the module by imports do. With --slow, slow tests
then try what has survived. A fault that no test notices is a survivor: a test is missing, or the change means nothing.
The file has one line for each fault; a second call goes on where the first one stopped.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from queue import SimpleQueue

import reached
from reached import FAST, SLOW, Reached, statement

ROOT = Path(__file__).resolve().parents[1]
CORE = ("behavior", "control", "core", "diagnosis", "learning", "maze", "physics", "run")
TESTS = {
    "core": ("core", "logs", "maths"),
    "control": ("control", "estimation"),
    "run": ("run",),
}  # rooms of other names
OUTPUT = ROOT / "build" / "mutants.jsonl"
LIMIT_S = 420.0  # of the tests of one fault
TOO_LONG = ["a test that took too long"]
MOST_FILES = 12  # files of tests for one fault
LEFT_OUT = ("test_pages.py",)  # it runs the whole program, for minutes
COMPARED = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq}
COMBINED = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult}
SIGNS = {
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=", ast.Add: "+", ast.Sub: "-",
    ast.Mult: "*", ast.Div: "/", ast.And: "and", ast.Or: "or",
}  # fmt: skip


@dataclass(frozen=True)
class Fault:
    """A change of a file: line (from 1), the text there before and after, and where in the file it stands."""

    file: str
    line: int
    before: str
    after: str
    start: int
    end: int


def faults_in(path: Path) -> Iterator[Fault]:
    """All faults that a file may have."""
    source = path.read_text(encoding="utf-8")
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line.encode()))
    data, name = source.encode(), path.relative_to(ROOT).as_posix()

    def place(node: ast.expr) -> tuple[int, int]:
        return (
            starts[node.lineno - 1] + node.col_offset,
            starts[(node.end_lineno or 0) - 1] + (node.end_col_offset or 0),
        )

    def fault(start: int, end: int, after: str) -> Fault:
        return Fault(name, data[:start].count(b"\n") + 1, data[start:end].decode(), after, start, end)

    def between(left: ast.expr, right: ast.expr, old: type, new: type) -> Iterator[Fault]:
        start, end = place(left)[1], place(right)[0]
        sign = re.escape(SIGNS[old])
        alone = rf"\b{sign}\b" if sign.isalpha() else rf"(?<![*/<>=!]){sign}(?![*/<>=])"
        found = re.search(alone, data[start:end].decode())
        if found:
            yield fault(start + found.start(), start + found.end(), SIGNS[new])

    for node in _code(ast.parse(source)):
        if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in COMPARED:
            yield from between(node.left, node.comparators[0], type(node.ops[0]), COMPARED[type(node.ops[0])])
        elif isinstance(node, ast.BinOp) and type(node.op) in COMBINED and not _text(node):
            yield from between(node.left, node.right, type(node.op), COMBINED[type(node.op)])
        elif isinstance(node, ast.BoolOp):
            old = type(node.op)
            yield from between(node.values[0], node.values[1], old, ast.Or if old is ast.And else ast.And)
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            yield fault(place(node)[0], place(node)[0] + len("not"), "not not")
        elif isinstance(node, ast.Constant) and isinstance(node.value, bool | int | float):
            yield fault(*place(node), _other(node.value))


def _other(value: float) -> str:
    """Another constant of its kind."""
    if isinstance(value, bool):
        return str(not value)
    return (
        str(value + 1) if isinstance(value, int) else f"({value!r} * 1.5 + 0.1)" if value == 0.0 else repr(value * 1.5)
    )


def _text(node: ast.BinOp) -> bool:
    return any(isinstance(side, ast.JoinedStr | ast.Constant) and not isinstance(getattr(side, "value", 0), int | float)
               for side in (node.left, node.right))  # fmt: skip


def _code(tree: ast.AST) -> Iterator[ast.AST]:
    """Nodes that do something: no annotations, no messages of errors, no texts."""
    for name, value in ast.iter_fields(tree):
        if name in ("annotation", "returns", "decorator_list") or isinstance(tree, ast.Raise | ast.JoinedStr):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield child
                yield from _code(child)


def files_for(file: str) -> list[str]:
    """Files of tests for a module: the one of its name and those that import it, then those that import what imports
    it, and so on; among equals those of its room first, then those that name most of what it defines."""
    module, room = _module(ROOT / file), file.split("/")[1]
    body = ast.parse((ROOT / file).read_text(encoding="utf-8")).body
    names = [n.name for n in body if isinstance(n, ast.ClassDef | ast.FunctionDef) and not n.name.startswith("_")]
    words = re.compile(rf"\b({'|'.join(map(re.escape, [module, *names]))})\b")
    rooms = [ROOT / "tests" / name for name in TESTS.get(room, (room,))]
    steps = _steps(module)
    found = dict[Path, tuple[int, bool, int]]()
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        if path.name in LEFT_OUT:
            continue
        own = path.stem == f"test_{module.rpartition('.')[2]}"
        far = 0 if own else min((steps[name] for name in _imports(path) if name in steps), default=None)
        if far is not None:
            near = any(folder in path.parents for folder in rooms)
            found[path] = (far, not near, -len(words.findall(path.read_text(encoding="utf-8"))))
    return [path.relative_to(ROOT).as_posix() for path in sorted(found, key=found.__getitem__)[:MOST_FILES]]


def _steps(module: str) -> dict[str, int]:
    """How many imports lie between a module and each one that needs it, by name; 0 for itself."""
    users = dict[str, list[str]]()
    for path in (ROOT / "mazeplan").rglob("*.py"):
        for name in _imports(path):
            users.setdefault(name, []).append(_module(path))
    steps, next_ones = {module: 0}, [module]
    while next_ones:
        name = next_ones.pop(0)
        for user in users.get(name, []):
            if user not in steps:
                steps[user] = steps[name] + 1
                next_ones.append(user)
    return steps


def _module(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


@cache
def _imports(path: Path) -> frozenset[str]:
    """All that a file imports from mazeplan, also inside functions; of `from a import b` both a and a.b."""
    found = set[str]()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.update([node.module, *(f"{node.module}.{alias.name}" for alias in node.names)])
    return frozenset(name for name in found if name.split(".")[0] == "mazeplan")


def chosen_tests(fault: Fault, stage: str) -> list[str]:
    """Tests that may notice a fault: those that run its line, where this is known, else files near to the module."""
    path = reached.OUTPUT if stage == FAST else reached.OUTPUT_SLOW
    lines = statement((ROOT / fault.file).read_text(encoding="utf-8"), fault.line)
    return (Reached.of(path).tests(fault.file, *lines) if path.exists() else []) or files_for(fault.file)


def noticed(fault: Fault, copy: Path, broken: set[str], stage: str = FAST) -> str:
    """What became of a fault in a copy of the repository: noticed, survived, out of time, or no tests. broken: tests
    that fail without any fault too; they are left out, and those that are found are added."""
    tests = chosen_tests(fault, stage)
    if not tests:
        return "no tests"
    with tempfile.TemporaryDirectory() as compiled:
        while True:
            with _put_in(fault, copy) as data:
                # Numba looks at the file of a function, but not at the functions that it calls: these would stay old.
                failed = _failed(copy, tests, stage, broken, compiled if b"njit" in data else "")
            if not failed:
                return "survived"
            if failed == TOO_LONG:
                return "out of time"
            if not _failed(copy, failed, stage, broken):
                return "noticed"
            if broken.issuperset(failed):  # a file that cannot be collected
                return "no tests"
            broken.update(failed)


@contextmanager
def _put_in(fault: Fault, copy: Path) -> Iterator[bytes]:
    """The copy with a fault in it; gives the file without the fault."""
    path = copy / fault.file
    data = path.read_bytes()
    path.write_bytes(data[: fault.start] + fault.after.encode() + data[fault.end :])
    try:
        yield data
    finally:
        path.write_bytes(data)


def _failed(copy: Path, tests: list[str], stage: str, broken: set[str], compiled: str = "") -> list[str]:
    """The first test of a stage that fails, or TOO_LONG; none if all pass. compiled: folder for compiled functions."""
    # Bytecode knows its source by size and second: a fault put in and taken out within one second would stay in it.
    where = {**os.environ, "PYTHONPATH": str(copy), "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    where |= {"NUMBA_CACHE_DIR": compiled} if compiled else {}
    without = [f"--deselect={name}" for name in sorted(broken)]
    command = [sys.executable, "-m", "pytest", "-x", "-vv", "-n0", "-p", "no:cacheprovider", "--rootdir=.", "-m", stage]
    try:
        ran = subprocess.run(
            [*command, *without, *tests], cwd=copy, env=where, capture_output=True, text=True, timeout=LIMIT_S,
            check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return TOO_LONG
    names = re.findall(r"^(\S+::.*) (?:FAILED|ERROR) +\[", ran.stdout, re.MULTILINE)  # a name may have spaces
    nothing_ran = 5  # pytest's status
    return [] if ran.returncode in (0, nothing_ran) else names[:1] or tests[:1]


def drawn(count: int, seed: int, only: list[str]) -> list[Fault]:
    """Faults drawn at random: a file first, so that long files do not have them all."""
    rng, files = random.Random(seed), list[Path]()
    for folder in only or [f"mazeplan/{room}" for room in CORE]:
        path = ROOT / folder
        files += [path] if path.is_file() else sorted(f for f in path.rglob("*.py") if "__pycache__" not in f.parts)
    found: list[Fault] = []
    while len(found) < count:
        choices = [fault for fault in faults_in(rng.choice(files)) if fault not in found]
        if choices:
            found.append(rng.choice(choices))
    return found


def results(
    count: int, seed: int, only: list[str], output: Path, slow: bool = False, workers: int = 1
) -> tuple[list[tuple[Fault, str]], set[str]]:
    """What became of each fault that is drawn, and the tests that fail without a fault. Each result is a line of
    `output`. slow: the slow tests try what the others let survive"""
    output.parent.mkdir(parents=True, exist_ok=True)
    lines = output.read_text().splitlines() if output.exists() else []
    known = {(d["file"], d["start"], d["after"], d["stage"]): d["became"] for d in map(json.loads, lines)}
    faults, broken, copies = drawn(count, seed, only), set[str](), SimpleQueue[Path]()

    def became(fault: Fault) -> str:
        what, copy = "survived", copies.get()
        for stage in (FAST, SLOW) if slow else (FAST,):
            key = (fault.file, fault.start, fault.after, stage)
            if what == "survived" and key not in known:
                known[key] = noticed(fault, copy, broken, stage)
                with output.open("a") as stream:
                    stream.write(json.dumps({**asdict(fault), "stage": stage, "became": known[key]}) + "\n")
            what = known.get(key, what)
        copies.put(copy)
        if what != "noticed":
            print(f"{what}: {described(fault)}", file=sys.stderr)
        return what

    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(workers) as pool:
        for n in range(workers):
            ignored = shutil.ignore_patterns(".git", ".venv", "build", "runs", "dist")
            shutil.copytree(ROOT, Path(folder) / str(n), ignore=ignored)
            copies.put(Path(folder) / str(n))
        found = list(zip(faults, pool.map(became, faults), strict=True))
    return found, broken


def described(fault: Fault) -> str:
    """Where a fault is, and what it changes."""
    return f"{fault.file}:{fault.line}: {fault.before!r} -> {fault.after!r}"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=100, help="number of faults (default 100)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the draw (default 1)")
    parser.add_argument("--slow", action="store_true", help="let slow tests try what has survived, too")
    parser.add_argument("--only", nargs="+", default=[], help="folders or files to change (default: the core)")
    parser.add_argument("--workers", type=int, default=1, help="faults at a time (default 1)")
    parser.add_argument("-o", "--output", type=Path, default=OUTPUT)
    options = parser.parse_args()
    found, broken = results(options.count, options.seed, options.only, options.output, options.slow, options.workers)
    for fault, became in found:
        if became != "noticed":
            print(f"{became}: {described(fault)}")
    print(", ".join(f"{name} {n}" for name, n in Counter(became for _, became in found).items()))
    if broken:
        print("fail without a fault, too:", *sorted(broken))


if __name__ == "__main__":
    main()
