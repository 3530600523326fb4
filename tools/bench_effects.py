"""The loop closed effect by effect: `mazeplan improve` on a simulated rig that has each effect there is a name for.

Usage: python tools/bench_effects.py [--quick] [KIND ...]. Used by tools/bench.py.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench_improve import better

from mazeplan.improve import Options, improve
from mazeplan.maze.mapfile import load_map
from mazeplan.models.modelfile import RigModel, load_model
from mazeplan.physics.registry import PACKAGED
from mazeplan.rigs.registry import make_rig
from mazeplan.rigs.surprise import KINDS, Answer

AT_ONCE = 2


@dataclass(frozen=True)
class Row:
    """One kind: its line; whether its own name was found, and no other; whether error and navigation became better."""

    line: str
    named: bool
    alone: bool
    closer: bool
    faster: bool


def row(kind: str, options: Options) -> Row:
    """What became of one kind."""
    rig = f"surprise@{kind}"
    truth: Answer = make_rig(rig, load_map(options.map)).surprise  # type: ignore[attr-defined]
    with tempfile.TemporaryDirectory() as folder:
        (entry,) = improve(rig, Path(folder), options)
        done, navigation = entry["diagnosis"], entry["navigation"]
        model = load_model(done["model"]) if done["model"] else None
    names = list(dict.fromkeys(e["name"] for e in done["effects"]))
    where = next((e["rings"] for e in done["effects"] if e["name"] == truth.effect), list(truth.by_ring))
    ring = next((n for n in truth.by_ring if n in where), next(iter(truth.by_ring), 1))
    found = "; ".join(_found(e, ring, model) for e in done["effects"]) or done["verdict"].replace("_", " ")
    planned = "yes" if PACKAGED[truth.effect].planned else "no"
    cells = [kind, truth.effect, planned, f"{_numbers(truth.by_ring.get(ring, {}))} (ring {ring})", found]
    cells.append(" -> ".join(f"{done[when]['rollout40']:.3f}" for when in ("before", "after")))
    for when in ("before", "after"):
        n, mean = navigation[when], navigation[when]["time_s"]["mean"]
        cells.append(f"{n['success']}/{n['runs']}, " + (f"{mean:.2f} s" if mean is not None else "-"))
    closer = done["after"]["rollout40"] < done["before"]["rollout40"]
    faster = better(navigation["before"], navigation["after"])
    return Row(f"| {' | '.join(cells)} |", truth.effect in names, names == [truth.effect], closer, faster)


def _numbers(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {value:.4g}" for name, value in values.items() if name != "ring")


def _found(effect: dict[str, Any], ring: int, model: RigModel | None) -> str:
    """An effect with its values in a ring as the new model has them, and the errors with which they were found."""
    name, parameters = effect["name"], effect["parameters"]
    values = {} if model is None or ring not in effect["rings"] else model.declared(ring).get(name, {})
    numbers = ", ".join(
        f"{key} {values.get(key, p['value']):.4g}" + (f" ± {p['stderr']:.2g}" if p["stderr"] else "")
        for key, p in parameters.items()
        if abs(p["value"]) > (p["stderr"] or 0.0)
    )
    where = "" if len(effect["rings"]) > 3 else f" in ring {', '.join(map(str, effect['rings']))}"
    return f"{name}{where} ({numbers})"


def effects_section(quick: bool, kinds: list[str] | None = None) -> list[str]:
    """Everything, as lines of Markdown."""
    options = Options(runs=2 if quick else 16, seconds=100.0 if quick else 400.0)
    chosen = kinds or list(KINDS)[: 2 if quick else None]
    rows = []
    with ProcessPoolExecutor(AT_ONCE) as pool:
        for done in pool.map(row, chosen, [options] * len(chosen)):
            rows.append(done)
            print(done.line, file=sys.stderr, flush=True)
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
    ]  # fmt: skip


if __name__ == "__main__":
    named = [argument for argument in sys.argv[1:] if argument != "--quick"]
    print("\n".join(effects_section("--quick" in sys.argv, named or None)))
