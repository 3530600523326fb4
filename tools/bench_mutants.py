"""Faults put into the code on purpose, for BENCHMARKS.md: those that no test notices (tools/mutate.py)."""

from __future__ import annotations

from collections import Counter

from mutate import LIMIT_S, OUTPUT, described, results

SEED = 1
WORKERS = 2


def mutants_section(quick: bool) -> list[str]:
    """Rows in Markdown: what became of the faults, then each one that no test noticed."""
    count = 3 if quick else 100
    found, _ = results(count, SEED, [], OUTPUT, workers=WORKERS)
    became = Counter(what for _, what in found)
    rows = [
        "## Faults put into the code on purpose",
        "",
        f"`python tools/reached.py`, then `python tools/mutate.py --count {count} --seed {SEED}`: {count} small",
        "changes of the code, drawn at random. The tests of `make test` that run the changed line try to notice",
        "it; the slow tests of `make test-all` do not.",
        "",
    ]
    rows += [f"| faults | noticed by a test | not noticed | tests over {LIMIT_S:g} s | no test imports the file |"]
    rows += ["|---|---|---|---|---|"]
    numbers = [len(found), *(became[what] for what in ("noticed", "survived", "out of time", "no tests"))]
    rows.append(f"| {' | '.join(map(str, numbers))} |")
    missed = [described(fault) for fault, what in found if what != "noticed"]
    if missed:
        rows += ["", "Not noticed:", "", *(f"- `{line}`" for line in missed)]
    return rows
