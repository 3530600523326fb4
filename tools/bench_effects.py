"""The loop closed effect by effect: `mazeplan improve` on a simulated rig that has each effect there is a name for.

Usage: python tools/bench_effects.py [--quick] [KIND ...]. Used by tools/bench.py.

Outcomes go to build/effects.jsonl, one a line, and what is there already is not done again: an interrupted run goes on.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from bench_improve import better

from mazeplan.learning.modelfile import RigModel, load_model
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.registry import PACKAGED
from mazeplan.rigs.registry import make_rig
from mazeplan.rigs.sim.surprise import KINDS, SurpriseTruth
from mazeplan.run.campaign.evaluate import Campaign, evaluate, summary
from mazeplan.run.campaign.improve import Options, improve

KEPT = Path(__file__).resolve().parent.parent / "build" / "effects.jsonl"
AT_ONCE = 2
HEALTHY, HEALTHY_RUNS = 10, 4  # rigs without a change, and runs of each before and after
NEAR = 1.1  # times the healthy rig's time, within which navigation is as good as without the effect


@dataclass(frozen=True)
class Row:
    """One kind: its line; whether its own name was found, and no other; whether error and navigation became better;
    whether it can be planned with; mean time of the runs afterwards, s, None unless all arrived."""

    line: str
    named: bool
    alone: bool
    closer: bool
    faster: bool
    planned: bool
    mean_s: float | None


def row(kind: str, options: Options) -> Row:
    """What became of one kind."""
    rig = f"surprise@{kind}"
    truth: SurpriseTruth = make_rig(rig, load_map(options.map)).surprise  # type: ignore[attr-defined]
    with tempfile.TemporaryDirectory() as folder:
        (entry,) = improve(rig, Path(folder), options)
        done, navigation = entry["diagnosis"], entry["navigation"]
        model = load_model(done["model"]) if done["model"] else None
    names = list(dict.fromkeys(e["name"] for e in done["effects"]))
    where = next((e["rings"] for e in done["effects"] if e["name"] == truth.effect), list(truth.by_ring))
    ring = next((n for n in truth.by_ring if n in where), next(iter(truth.by_ring), 1))
    found = "; ".join(_found(e, ring, model) for e in done["effects"]) or done["verdict"].replace("_", " ")
    planned = PACKAGED[truth.effect].planned
    cells = [
        kind,
        truth.effect,
        "yes" if planned else "no",
        f"{_numbers(truth.by_ring.get(ring, {}))} (ring {ring})",
        found,
    ]
    cells.append(" -> ".join(f"{done[when]['rollout40']:.3f}" for when in ("before", "after")))
    for when in ("before", "after"):
        n, mean = navigation[when], navigation[when]["time_s"]["mean"]
        cells.append(f"{n['success']}/{n['runs']}, " + (f"{mean:.2f} s" if mean is not None else "-"))
    closer = done["after"]["rollout40"] < done["before"]["rollout40"]
    faster = better(navigation["before"], navigation["after"])
    after = navigation["after"]
    mean = after["time_s"]["mean"] if after["success"] == after["runs"] else None
    line = f"| {' | '.join(cells)} |"
    print(line, file=sys.stderr, flush=True)
    return Row(line, truth.effect in names, names == [truth.effect], closer, faster, planned, mean)


def left_alone(seed: int, options: Options) -> bool:
    """Whether nothing is found on a healthy rig."""
    with tempfile.TemporaryDirectory() as folder:
        (entry,) = improve("toy", Path(folder), replace(options, seed=seed, runs=min(options.runs, HEALTHY_RUNS)))
    verdict = entry["diagnosis"]["verdict"]
    print(f"healthy, seed {seed}: {verdict}", file=sys.stderr, flush=True)
    return bool(verdict == "nothing_missing")


def _numbers(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {value:.4g}" for name, value in values.items() if name != "ring")


def _found(effect: dict[str, Any], ring: int, model: RigModel | None) -> str:
    """An effect with its values in a ring as the new model has them, and the errors with which they were found."""
    name, parameters = effect["name"], effect["parameters"]
    values = {} if model is None or ring not in effect["rings"] else model.declared(ring).get(name, {})
    if model is None:  # a report has the values of the first ring
        values = effect["rings"].get(str(ring), {}).get("after", {})
    numbers = ", ".join(
        f"{key} {(value := values.get(key, p['value'])):.4g}"
        + (f" ± {abs(value / p['value']) * p['stderr']:.2g}" if p["stderr"] and p["value"] else "")
        for key, p in parameters.items()
        if abs(p["value"]) > (p["stderr"] or 0.0)
    )
    where = "" if len(effect["rings"]) > 3 else f" in ring {', '.join(map(str, effect['rings']))}"
    return f"{name}{where} ({numbers})"


def _all(name: str, what: Callable[..., Any], cases: Sequence[Any], *more: Any) -> list[Any]:
    """What each case gives, (case, *more) being the arguments; a line of KEPT each. name: of this kind of outcome"""
    lines = KEPT.read_text().splitlines() if KEPT.exists() else []
    known = {d["case"]: d["outcome"] for d in map(json.loads, lines) if [d["name"], d["more"]] == [name, repr(more)]}
    left = [case for case in cases if case not in known]
    KEPT.parent.mkdir(exist_ok=True)
    with ProcessPoolExecutor(AT_ONCE) as pool, KEPT.open("a") as file:
        for case, outcome in zip(left, pool.map(what, left, *([one] * len(left) for one in more)), strict=True):
            known[case] = asdict(outcome) if isinstance(outcome, Row) else outcome
            line = {"name": name, "case": case, "more": repr(more), "outcome": known[case]}
            print(json.dumps(line), file=file, flush=True)
    return [known[case] for case in cases]


def effects_section(quick: bool, kinds: list[str] | None = None) -> list[str]:
    """Everything, as lines of Markdown."""
    options = Options(runs=2 if quick else 16, seconds=100.0 if quick else 400.0)
    chosen = kinds or list(KINDS)[: 2 if quick else None]
    toy = summary(evaluate(Campaign(options.runs)))
    healthy = float(toy["time_s"]["mean"])
    count = 0 if kinds else 1 if quick else HEALTHY
    rows = [Row(**done) for done in _all("kind", row, chosen, options)]
    silent = sum(_all("healthy", left_alone, range(1, count + 1), options))
    planned = [r for r in rows if r.planned]
    well = sum(r.mean_s is not None and r.mean_s <= NEAR * healthy for r in planned)
    head = "| kind | effect | planned | true | found | 40-step error, rad | navigation before | after |"
    return [
        "## Closing the loop, effect by effect (simulated)",
        "",
        f"`mazeplan improve --rig surprise@KIND --seconds {options.seconds:g} --runs {options.runs}`: the toy with one "
        "hidden change for every effect that has a name;",
        "one record, one round, the same starts before and after, seed 0. Errors: each half by "
        "what the other half tells. True values are",
        "those of a ball that rolls on the floor alone: along a wall, gravity and the floor's friction count for 7/9.",
        "",
        head, "|---" * 8 + "|", *(done.line for done in rows),
        "",
        f"The right name is among those found in {sum(r.named for r in rows)} of {len(rows)}, alone in "
        f"{sum(r.alone for r in rows)}. The error is lower in {sum(r.closer for r in rows)}, navigation better (more "
        f"arrived, or as many and sooner) in {sum(r.faster for r in rows)}.",
        "",
        f"Without a change (`--rig toy`, seeds 1 to {count}) nothing was found in {silent} of {count}. On that rig "
        f"{toy['success']} of {toy['runs']} runs arrive, after {healthy:.2f} s. Of the {len(planned)} kinds that "
        f"can be planned with, {well} arrive every time afterwards and take at most "
        f"{NEAR:.1f} times as long.",
    ]  # fmt: skip


if __name__ == "__main__":
    named = [argument for argument in sys.argv[1:] if argument != "--quick"]
    print("\n".join(effects_section("--quick" in sys.argv, named or None)))
