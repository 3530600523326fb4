"""What is noticed and got over when things go wrong: the section `faults` of BENCHMARKS.md."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mazeplan.rigs.faults.kinds import KINDS

SEED = 7000  # while this was made, seeds 100, 101 and 200 to 209 were looked at
RUNS = 10


def faults_section(mazeplan: Callable[..., dict], quick: bool) -> list[str]:
    """Two tables: faults that can be survived, and those that cannot, with the reason."""
    arguments = ["evaluate", "--rig", "toy", "--faults", "all", "--runs", str(2 if quick else RUNS)]
    arguments += ["--seed", str(SEED), "--workers", "2"]
    return tables(mazeplan(*arguments), "mazeplan " + " ".join(arguments))


def tables(document: dict[str, Any], command: str) -> list[str]:
    """The section, from what the command printed."""
    rows = document["faults"]
    survivable = [row for row in rows if row["survivable"]]
    hopeless = [row for row in rows if not row["survivable"]]
    runs, wrong = document["runs"], [what for row in rows for what in row["wrong"]]
    arrived, possible = (sum(row[key] for row in survivable) for key in ("arrived", "runs"))
    expected = sum(row["as_expected"] for row in hopeless)
    least = min(row["arrived"] / row["runs"] for row in survivable)
    return [
        "## When things go wrong (simulated)",
        "",
        f"`{command}`: moment (between 0.3 and 1.5 s after the start), length and size of each fault are drawn by the "
        "seed. Looked",
        "at while it was made: seeds 100, 101 and 200 to 209, with other moments, lengths and sizes.",
        "",
        f"- {runs} runs of {len(rows)} kinds; ended with a reason by name: "
        f"{runs - sum('ended with' in what for what in wrong)}",
        f"- arrived, of the kinds that can be survived: {arrived} of {possible}; of the kind with the fewest: "
        f"{100 * least:.0f} %",
        f"- ended with a reason that goes with the fault, or before it mattered, of the others: {expected} of "
        f"{sum(row['runs'] for row in hopeless)}",
        f"- commands beyond the limits or no numbers: {sum('command' in what for what in wrong)}; plates not level "
        f"within 1 s of the end (or of the fault's): {sum('plate' in what for what in wrong)}",
        "",
        "Noticed: the first failure, doubt or end at or after the fault's beginning. Not noticed are faults that made "
        "no difference",
        "to what is measured, and those that ended before it was large enough.",
        "",
        "### Faults that can be survived",
        "",
        "| fault | what | arrived | mean s | noticed | after s: p50, worst | as | recoveries |",
        "|---|---|---|---|---|---|---|---|",
        *(_survived(row) for row in survivable),
        "",
        "### Faults that cannot",
        "",
        "| fault | what | because | arrived | ended | noticed | after s: p50, worst | as |",
        "|---|---|---|---|---|---|---|---|",
        *(_ended(row) for row in hopeless),
    ]


def _survived(row: dict[str, Any]) -> str:
    mean = "-" if row["time_s"] is None else f"{row['time_s']:.2f}"
    recoveries = ", ".join(row["recoveries"]) or "none"
    stopped = f"; ended: {_counts(row['stopped'])}" if row["stopped"] else ""
    return (
        f"| {row['fault']} | {KINDS[row['fault']].what} | {row['arrived']}/{row['runs']}{stopped} | {mean} | "
        f"{_noticed(row)} | {recoveries} |"
    )


def _ended(row: dict[str, Any]) -> str:
    return (
        f"| {row['fault']} | {KINDS[row['fault']].what} | {row['because']} | {row['arrived']}/{row['runs']} | "
        f"{_counts(row['stopped'])} | {_noticed(row)} |"
    )


def _noticed(row: dict[str, Any]) -> str:
    after = row["noticed_s"]
    told = "-" if after is None else f"{after['p50']:.2f}, {after['worst']:.2f}"
    return f"{row['noticed']}/{row['faulted']} | {told} | {_counts(row['noticed_as'])}"


def _counts(counts: dict[str, int]) -> str:
    return ", ".join(f"{what} {count}" for what, count in counts.items()) or "-"
