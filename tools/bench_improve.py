"""What `mazeplan improve` does with ten surprises of the simulated rig. Used by tools/bench.py.

Usage: python tools/bench_improve.py [--quick]
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.registry import make_rig
from mazeplan.run.campaign.evaluate import Campaign, evaluate, summary
from mazeplan.run.campaign.improve import Options, improve

SEEDS = range(10)  # the rule of the verdict was found on others, from 98 on


def row(seed: int, options: Options) -> tuple[str, bool, dict[str, Any]]:
    """Line of the table of one seed, whether the name is right, navigation before and after."""
    rig = f"surprise@{seed}"
    with tempfile.TemporaryDirectory() as folder:
        (entry,) = improve(rig, Path(folder), options, tell=lambda text: print(text, file=sys.stderr))
    done, navigation = entry["diagnosis"], entry["navigation"]
    # only simulated rigs have one, which the protocol of rigs does not know
    truth = make_rig(rig, load_map("cme")).surprise  # type: ignore[attr-defined]
    names = list(dict.fromkeys(e["name"] for e in done["effects"]))
    right = names == [truth.effect]
    cells = [str(seed), f"{truth.kind}: {truth.effect}", ", ".join(names) or done["verdict"], "yes" if right else "no"]
    cells += [f"{done[when]['rollout40']:.3f}" for when in ("before", "after")]
    for when in ("before", "after"):
        n = navigation[when]
        mean = n["time_s"]["mean"]
        cells.append(f"{n['success']}/{n['runs']}, " + (f"{mean:.2f} s" if mean is not None else "-"))
    return f"| {' | '.join(cells)} |", right, navigation


def better(before: dict[str, Any], after: dict[str, Any]) -> bool:
    """More arrived, or as many and sooner."""
    if after["success"] != before["success"]:
        return after["success"] > before["success"]
    return after["success"] == 0 or after["time_s"]["mean"] < before["time_s"]["mean"]


def improve_section(quick: bool) -> list[str]:
    """Everything, as lines of Markdown."""
    options = Options(runs=2 if quick else 16, seconds=100.0 if quick else 400.0)
    toy = summary(evaluate(Campaign(options.runs)))
    head = (
        "| seed | what was changed | found | right | 40-step error before, rad | after "
        "| arrived and mean time before | after |"
    )
    rows, right, worse, improved = [head, "|---" * 8 + "|"], 0, 0, 0
    for seed in list(SEEDS)[: 1 if quick else None]:
        line, named, navigation = row(seed, options)
        rows.append(line)
        print(line, file=sys.stderr)
        right += named
        if better(navigation["before"], toy):  # worse than on the toy
            worse += 1
            improved += better(navigation["before"], navigation["after"])
    return [
        "## Closing the loop (simulated)",
        "",
        "`mazeplan improve --rig surprise@SEED`: the toy rig with one thing that the planner's model does not know; "
        f"{options.seconds:g} s",
        f"of record, one round, {options.runs} navigations before and after from the same starts, seed {options.seed}. "
        "Errors are on the last 30 % of the record.",
        f"The toy itself, with its own model: {toy['success']}/{toy['runs']}, mean {toy['time_s']['mean']:.2f} s.",
        "",
        *rows,
        "",
        f"Right name: {right} of {len(rows) - 2}. Navigation was worse than on the toy in {worse}; of these it is "
        f"better afterwards in {improved}.",
    ]


if __name__ == "__main__":
    print("\n".join(improve_section("--quick" in sys.argv)))
