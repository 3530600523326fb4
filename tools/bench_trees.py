"""Section `trees`: random behaviour trees, and damaged trees and maps, by the thousand."""

from __future__ import annotations

import tempfile
from pathlib import Path

from bench_kit import Section, Table, counts
from fuzz_files import TICKS, damaged_maps, damaged_trees, ticked_trees


def trees_section(quick: bool) -> Section:
    """Random trees, damaged files, and what went wrong with them."""
    trees, files = (100, 300) if quick else (1000, 10_000)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        ended, started, wrong = ticked_trees(trees, folder)
        outcomes = {"trees (XML)": damaged_trees(files, folder), "maps (YAML)": damaged_maps(files, folder)}
    ticked = Table(("random trees", "ticks each", "went wrong", "leaves started", "result of the last tick"))
    ticked.add(trees, TICKS, len(wrong), started, counts(ended))
    damaged = Table(("damaged", "how", "loads", "error at a line", "anything else", "longest, ms"))
    for what, outcome in outcomes.items():
        for kind in sorted({*outcome.loaded, *outcome.refused}):
            how = kind.replace("damaged_", "")
            damaged.add(what, how, outcome.loaded[kind], outcome.refused[kind], "-", "-")
        loads, errors = outcome.loaded.total(), outcome.refused.total()
        damaged.add(what, "all", loads, errors, len(outcome.wrong), f"{1e3 * outcome.longest:.0f}")
    findings = [*wrong, *(text for outcome in outcomes.values() for text in outcome.wrong)]
    notes = (
        "Leaves of random trees draw their result. `error`: an expression or port without a value, named with a line.",
        "Damaged: packaged files, seeds from 0. Error at a line: one line of text that names file and line.",
        *(f"Finding: {text}" for text in findings[:20]),
    )
    return Section("Behaviour trees and maps, random and damaged", notes, (ticked, damaged))
