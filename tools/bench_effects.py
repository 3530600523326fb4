"""Section `effects`: `mazeplan improve` on a simulated rig with each effect that has a name, and on healthy rigs.

Outcomes go to build/effects.jsonl; an interrupted run goes on from there.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bench_kit import BUILD, Section, Table, resumed
from hidden_effects import KINDS, write_hidden_rig

from mazeplan.learning.modelfile import RigModel, load_model
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.registry import PACKAGED
from mazeplan.run.campaign.one_run import Campaign
from mazeplan.run.commands.evaluate import results_of, summary
from mazeplan.run.commands.improve import improve

HEALTHY, HEALTHY_RUNS = 10, 4  # rigs without a change, and runs of each before and after
NEAR = 1.1  # times the healthy rig's time, within which navigation is as good as without the effect


def outcome(kind: str, runs: int, seconds: float) -> dict[str, Any]:
    """What became of one kind of effect."""
    with tempfile.TemporaryDirectory() as folder:
        rig = Path(folder) / "rig.yaml"
        truth = write_hidden_rig(rig, kind, load_map("cme"))
        (entry,) = improve(rig, runs=runs, seconds=seconds, output=Path(folder) / "improved").rounds
        done, navigation = entry["diagnosis"], entry["navigation"]
        model = load_model(done["model"]) if done["model"] else None
    names = list(dict.fromkeys(e["name"] for e in done["effects"]))
    where = next((e["rings"] for e in done["effects"] if e["name"] == truth.effect), list(truth.by_ring))
    ring = next((n for n in truth.by_ring if n in where), next(iter(truth.by_ring), 1))
    before, after = navigation["before"], navigation["after"]
    return {
        "kind": kind, "effect": truth.effect, "planned": PACKAGED[truth.effect].planned,
        "true": f"{_numbers(truth.by_ring.get(ring, {}))} (ring {ring})",
        "found": "; ".join(_found(e, ring, model) for e in done["effects"]) or done["verdict"].replace("_", " "),
        "named": truth.effect in names, "alone": names == [truth.effect],
        "error": [done[when]["rollout40"] for when in ("before", "after")],
        "before": _navigation(before), "after": _navigation(after), "better": better(before, after),
        "mean_s": after["time_s"]["mean"] if after["success"] == after["runs"] else None,
    }  # fmt: skip


def better(before: dict[str, Any], after: dict[str, Any]) -> bool:
    """Whether more runs arrived, or as many and sooner."""
    if after["success"] != before["success"]:
        return after["success"] > before["success"]
    return after["success"] == 0 or after["time_s"]["mean"] < before["time_s"]["mean"]


def healthy(seed: int, runs: int, seconds: float) -> dict[str, Any]:
    """The verdict on a rig without a change."""
    (entry,) = improve("toy", runs=min(runs, HEALTHY_RUNS), seconds=seconds, seed=seed).rounds
    return {"seed": seed, "verdict": entry["diagnosis"]["verdict"]}


def _navigation(document: dict[str, Any]) -> str:
    mean = document["time_s"]["mean"]
    return f"{document['success']}/{document['runs']}, " + ("-" if mean is None else f"{mean:.2f} s")


def _numbers(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {value:.4g}" for name, value in values.items() if name != "ring")


def _found(effect: dict[str, Any], ring: int, model: RigModel | None) -> str:
    """An effect with its values in a ring as the new model has them, and their standard errors."""
    values = {} if model is None or ring not in effect["rings"] else model.declared(ring).get(effect["name"], {})
    if model is None:  # a report has the values of the first ring
        values = effect["rings"].get(str(ring), {}).get("after", {})
    numbers = ", ".join(
        f"{key} {(value := values.get(key, p['value'])):.4g}"
        + (f" ± {abs(value / p['value']) * p['stderr']:.2g}" if p["stderr"] and p["value"] else "")
        for key, p in effect["parameters"].items()
        if abs(p["value"]) > (p["stderr"] or 0.0)
    )
    where = "" if len(effect["rings"]) > 3 else f" in ring {', '.join(map(str, effect['rings']))}"
    return f"{effect['name']}{where} ({numbers})"


def effects_section(quick: bool) -> Section:
    """A row for each kind of effect, and totals."""
    runs, seconds, count = (2, 100.0, 1) if quick else (16, 400.0, HEALTHY)
    kinds = list(KINDS)[: 2 if quick else None]
    toy = summary(results_of(Campaign(runs=runs)))["time_s"]["mean"]
    done = resumed(BUILD / "effects.jsonl", outcome, [(kind, runs, seconds) for kind in kinds])
    nulls = resumed(BUILD / "healthy.jsonl", healthy, [(seed, runs, seconds) for seed in range(1, count + 1)])
    silent = sum(null["verdict"] == "nothing_missing" for null in nulls)
    planned = [row for row in done if row["planned"]]
    well = sum(row["mean_s"] is not None and row["mean_s"] <= NEAR * toy for row in planned)
    total = Table(("what", "figure"))
    total.add("right name among those found", f"{sum(row['named'] for row in done)} of {len(done)}")
    total.add("right name alone", f"{sum(row['alone'] for row in done)} of {len(done)}")
    total.add("prediction better afterwards", f"{sum(r['error'][1] < r['error'][0] for r in done)} of {len(done)}")
    total.add("navigation better afterwards", f"{sum(row['better'] for row in done)} of {len(done)}")
    total.add(f"planned effects: as good as the healthy rig ({toy:.2f} s) afterwards", f"{well} of {len(planned)}")
    total.add("healthy rigs on which nothing is found", f"{silent} of {count}")
    head = ("kind", "effect", "planned", "true", "found", "40-step error, rad", "navigation before", "after")
    table = Table(head)
    for row in done:
        error = " -> ".join(f"{x:.3f}" for x in row["error"])
        can = "yes" if row["planned"] else "no"
        table.add(row["kind"], row["effect"], can, row["true"], row["found"], error, row["before"], row["after"])
    notes = (
        f"`mazeplan improve --rig FILE --seconds {seconds:g} --runs {runs}`: the toy with one hidden change.",
        "One record, one round, the same starts before and after, seed 0. Better: more arrive, or as many and sooner.",
        f"As good: all arrive, in at most {NEAR:g} times the time. Errors: each half by what the other half tells.",
    )
    return Section("Closing the loop, effect by effect (simulated)", notes, (total, table))
