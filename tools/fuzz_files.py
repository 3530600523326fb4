"""Random trees that are ticked, and damaged trees and maps: for tools/bench_trees.py and tests/test_fuzzing.py.

A random tree loads, is ticked 200 times and halted: afterwards nothing runs, and every leaf that was started has
finished or was halted exactly once. A damaged file loads, or is an error with file and line in one line of text, within
a second of processor time.
"""

from __future__ import annotations

import gc
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from time import process_time

from fuzzing import DAMAGE_TO_XML, DAMAGE_TO_YAML, LEAVES, DiceRun, random_tree, run_tree

from mazeplan.behavior.registry import REGISTRY
from mazeplan.behavior.trees import load_tree
from mazeplan.btree.tree import tree_text
from mazeplan.core import resources
from mazeplan.core.errors import MapError, TreeError
from mazeplan.maze.mapfile import check_text, dump_map, load_map

TICKS = 200
LIMIT = 1.0  # s of processor time for one file
LONGEST = 1500  # characters of an error


@dataclass
class Outcome:
    """Of damaged files, by the kind of damage: how many loaded and how many were refused; the longest time, s; and what
    came out that should not have."""

    loaded: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    longest: float = 0.0
    wrong: list[str] = field(default_factory=list)


def ticked_trees(count: int, folder: Path) -> tuple[Counter[str], int, list[str]]:
    """How the random trees of seeds 0 to count - 1 ended, how many leaves were started, and what went wrong."""
    ended, started, wrong, path = Counter[str](), 0, [], folder / "random.xml"
    for seed in range(count):
        rng = Random(seed)
        path.write_text(random_tree(rng), encoding="utf-8")
        try:
            how, leaves = run_tree(path, rng, TICKS)
        except Exception as problem:  # whatever it is, it is a finding
            wrong.append(f"seed {seed}: {type(problem).__name__}: {problem}")
        else:
            ended[how] += 1
            started += leaves
    return ended, started, wrong


def damaged_trees(count: int, folder: Path) -> Outcome:
    """Mutants of the packaged trees and of random ones, of seeds 0 to count - 1."""

    def load(path: Path) -> None:
        tree_text(load_tree(path, {**REGISTRY, **LEAVES}, DiceRun(Random(0))))

    sources = [path.read_bytes() for path in sorted(resources.share("behaviors").glob("*.xml"))]
    sources += [random_tree(Random(seed)).encode() for seed in range(20)]  # of all kinds of nodes
    return _damaged(count, folder / "mutant.xml", sources, DAMAGE_TO_XML, load, TreeError)


def damaged_maps(count: int, folder: Path) -> Outcome:
    """Mutants of the packaged maps, of seeds 0 to count - 1; one that loads must be the same when written and read."""

    def load(path: Path) -> None:
        maze = load_map(path)
        if check_text(dump_map(maze)).maze != maze:
            raise ValueError("written and read again it is another maze")

    sources = [path.read_bytes() for path in sorted(resources.share("maps").glob("*.yaml"))]
    return _damaged(count, folder / "mutant.yaml", sources, DAMAGE_TO_YAML, load, MapError)


def _damaged(
    count: int,
    path: Path,
    sources: list[bytes],
    damages: tuple[Callable[[bytes, Random], bytes], ...],
    load: Callable[[Path], None],
    expected: type[TreeError] | type[MapError],
) -> Outcome:
    outcome = Outcome()
    gc.disable()  # all that a test process holds would be looked through, for seconds, in the time of one file
    for seed in range(count):
        rng = Random(seed)
        damage = rng.choice(damages)
        path.write_bytes(damage(rng.choice(sources), rng))
        began = process_time()
        try:
            load(path)
            outcome.loaded[damage.__name__] += 1
        except expected as error:
            outcome.refused[damage.__name__] += 1
            text = str(error)
            place = (
                f"{error.file}:{error.line}: "  # a value that a packaged tree does not take is told at its line there
            )
            there = error.file is not None and Path(error.file).is_file()
            if not (error.line and there and text.startswith(place) and text.isprintable()):
                outcome.wrong.append(f"seed {seed}: no line, or more than one: {text[:200]!r}")
            if len(text) > LONGEST:
                outcome.wrong.append(f"seed {seed}: an error of {len(text)} characters")
        except Exception as problem:  # whatever it is, it is a finding
            outcome.wrong.append(f"seed {seed}: {type(problem).__name__}: {str(problem)[:200]}")
        took = process_time() - began
        outcome.longest = max(outcome.longest, took)
        if took > LIMIT:
            outcome.wrong.append(f"seed {seed}: took {took:.1f} s")
    gc.enable()
    return outcome
