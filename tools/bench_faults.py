"""Section `faults`: what is noticed and survived when things go wrong."""

from __future__ import annotations

from typing import Any

from bench_kit import Section, Table, mazeplan

from mazeplan.rigs.faults.kinds import KINDS

SEED, RUNS = 7000, 10  # seeds 100, 101 and 200 to 209 were looked at while the program was written
NOTICED = ("noticed", "after s: p50, worst", "as")


def faults_section(quick: bool) -> Section:
    """Totals, faults that can be survived, and those that cannot, with the reason."""
    words = ("evaluate", "--rig", "toy", "--faults", "all", "--runs", str(2 if quick else RUNS))
    words += ("--seed", str(SEED), "--workers", "2")
    document = mazeplan(*words)
    rows, runs = document["faults"], document["runs"]
    survivable, hopeless = ([row for row in rows if row["survivable"] is can] for can in (True, False))
    wrong = [what for row in rows for what in row["wrong"]]
    arrived, possible = (sum(row[key] for row in survivable) for key in ("arrived", "runs"))
    total = Table(("what", "figure"))
    named = runs - sum("ended with" in what for what in wrong)
    total.add("runs that ended with a reason by name", f"{named} of {runs}, {len(rows)} kinds of fault")
    total.add("faults that can be survived: arrived", f"{arrived} of {possible}")
    expected = f"{sum(row['as_expected'] for row in hopeless)} of {sum(row['runs'] for row in hopeless)}"
    total.add("other faults: ended with the reason that goes with the fault, or before it mattered", expected)
    total.add("commands beyond the limits", sum("command" in what for what in wrong))
    total.add("plates not level within 1 s of the end", sum("plate" in what for what in wrong))
    survived = Table(
        ("fault", "what", "arrived", "mean s", *NOTICED, "recoveries"), caption="Faults that can be survived"
    )
    for row in survivable:
        mean = "-" if row["time_s"] is None else f"{row['time_s']:.2f}"
        stopped = f"; ended: {_counts(row['stopped'])}" if row["stopped"] else ""
        come = f"{row['arrived']}/{row['runs']}{stopped}"
        recoveries = ", ".join(row["recoveries"]) or "none"
        survived.add(row["fault"], KINDS[row["fault"]].what, come, mean, *_noticed(row), recoveries)
    ended = Table(("fault", "what", "because", "arrived", "ended", *NOTICED), caption="Faults that cannot")
    for row in hopeless:
        come = f"{row['arrived']}/{row['runs']}"
        what = KINDS[row["fault"]].what
        ended.add(row["fault"], what, row["because"], come, _counts(row["stopped"]), *_noticed(row))
    notes = (
        f"`mazeplan {' '.join(words)}`: the seed draws moment (0.3 to 1.5 s after the start), length and size.",
        "Noticed: the first failure, doubt or end at or after the fault's beginning.",
        "Faults that are not noticed made no difference, or ended before they were large enough.",
    )
    return Section("When things go wrong (simulated)", notes, (total, survived, ended))


def _noticed(row: dict[str, Any]) -> tuple[str, str, str]:
    after = row["noticed_s"]
    told = "-" if after is None else f"{after['p50']:.2f}, {after['worst']:.2f}"
    return f"{row['noticed']}/{row['faulted']}", told, _counts(row["noticed_as"])


def _counts(counts: dict[str, int]) -> str:
    return ", ".join(f"{what} {count}" for what, count in counts.items()) or "-"
