"""Diagnosis of rigs that nobody here made: healthy records against themselves and each other, and changed ones.

    python tools/bench_strangers.py PART [--first I] [--count N] [--folder FOLDER]

PART: euler, delay (healthy, rigs of the folder MAZEPLAN_RIGS), sticky (same folder), healthy, effects (the six of
tests/strange_rigs.py), drawn (at random, healthy), changed (others, drawn at random, with a change). Case I of a part
is always the same rig with the same seeds. FOLDER keeps records and models, so that a part goes on where it stopped.
One line of JSON for each diagnosis, then a summary.
"""

from __future__ import annotations

import argparse
import importlib
import itertools
import json
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "tests"), os.environ.get("MAZEPLAN_RIGS", ".")]
SECONDS = 300.0
EULER, DELAY = "euler_rig:StickyRig", "delay_rig:Delayed"
SIX = tuple(f"strange_rigs:{name}" for name in ("Stepper", "Prompt", "Late", "Springy", "Blind", "Slow"))
Rig = tuple[str, dict[str, Any]]
CHANGES = (  # of a strange rig: settings, and right names
    ({"sticky": 0.3}, {"local_friction"}), ({"gain": 0.85}, {"servo_gain", "tilt_gain"}),
    ({"lean_x_deg": 0.9}, {"tilt_offset"}), ({"turned_deg": 3.0}, {"axis_misalignment"}),
    ({"mu": 0.12}, {"dry_friction"}), ({"late_ms": 75.0}, {"sensor_delay"}),
)  # fmt: skip


def cases(part: str) -> Iterator[tuple[Rig, dict[str, Any], set[str], int]]:
    """(rig, change, right names, seed) of each case; seed 0: the record from which the model was learned."""
    if part == "euler":
        grid = itertools.product((2.0, 4.0, 8.0), (0.0, 0.3, 0.6), (0.0, 0.2, 0.5), (0.005, 0.02, 0.1))
        rigs = [{"servo_hz": a, "rest": b, "noise_mm": c, "mu": d} for a, b, c, d in grid]
        for i in (i * 23 % 81 for i in range(60)):  # all values of all settings come early
            yield from (((EULER, rigs[i]), {}, set(), seed) for seed in (0, 1))
    elif part == "delay":
        for i in range(10):
            settings = {"servo_ms": 40.0 + 20.0 * (i % 4), "rest": 0.2 * (i % 3 + 1), "noise_mm": 0.1 * (i % 2 + 1)}
            yield from (((DELAY, settings), {}, set(), seed) for seed in (0, 1))
    elif part == "sticky":
        for seed, size in itertools.product(range(1, 11), (0.3, 0.1, 0.6)):
            yield (EULER, {}), {"sticky": size}, {"local_friction"}, seed
    elif part == "healthy":
        yield from (((name, {}), {}, set(), seed) for seed, name in itertools.product(range(34), SIX))
    elif part == "effects":
        for seed, (change, right), name in itertools.product(range(1, 6), CHANGES, SIX):
            yield (name, {}), change, right, seed
    elif part == "changed":
        for i, (change, right) in zip(range(102), itertools.cycle(CHANGES)):
            drawn = importlib.import_module("strange_rigs").drawn(9000 + i)
            more = {key: drawn.get(key, 0.0) for key in ("lean_x_deg", "late_ms")}
            change = {key: size + more.get(key, 0.0) for key, size in change.items()}
            yield ("strange_rigs:StrangeRig", drawn), change, right, 1
    else:
        for i, seed in itertools.product(range(100), (0, 1)):
            drawn = importlib.import_module("strange_rigs").drawn(8000 + i)
            yield ("strange_rigs:StrangeRig", drawn), {}, set(), seed


def record(rig: Rig, change: dict[str, Any], seed: int, folder: Path, maze: Any) -> Path:
    """300 s of `collect --rings --place`, kept in the folder."""
    from mazeplan.run.collect import Collection, run_collection

    words = "-".join(f"{key}{value:.4g}" for key, value in (rig[1] | change).items() if isinstance(value, float))
    log = folder / f"{rig[0].replace(':', '-')}-{words[:150]}-{seed}.mcap"
    if not log.exists():
        rings = tuple(ring.number for ring in maze.rings)
        module, _, cls = rig[0].partition(":")
        machine = getattr(importlib.import_module(module), cls)(maze, rig[1] | change)
        run_collection(machine, maze, Collection(SECONDS, rings, 100 + seed), log)
    return log


def diagnosed(rig: Rig, change: dict[str, Any], right: set[str], seed: int, folder: Path) -> dict[str, Any]:
    """The verdict on one record with the model that was learned from another one, or from this one."""
    from mazeplan.core.logs.table import read_table
    from mazeplan.diagnosis.rig.reference import known_reference, save_reference
    from mazeplan.diagnosis.rig.verdict import verdict_on
    from mazeplan.learning.modelfile import load_model, save_model
    from mazeplan.maze.mapfile import load_map
    from mazeplan.run.commands.learn import learn_model

    maze, out = load_map("cme"), {"rig": rig, "change": change, "seed": seed}
    first = record(rig, {}, 0, folder, maze)
    model = first.with_suffix(".model")
    if not model.exists():
        began = time.process_time()
        done = learn_model([read_table(first)], maze, "pi")
        save_model(done.model, model)
        if done.reference is not None:
            save_reference(done.reference, done.model, model)
        out["learn_s"] = round(time.process_time() - began, 1)
    known = load_model(model)
    table = read_table(record(rig, change, seed, folder, maze))
    began = time.process_time()
    done = verdict_on(table, maze, known_reference(model, known, maze), lambda text: None)
    names = [effect["name"] for effect in done.effects]
    out |= {"s": round(time.process_time() - began, 1), "verdict": done.verdict, "names": names}
    out["gains"] = [round(one.gain) for one in done.searched.found]
    out |= {"first": bool(names) and names[0] in right, "wrong": [name for name in names if name not in right]}
    out["unknown"] = done.unknown.document() if done.unknown else None
    return out | {"sentence": done.sentences()[0], "remaining": round(done.remaining, 2)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", choices=("euler", "delay", "sticky", "healthy", "effects", "drawn", "changed"))
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--folder", type=Path, default=Path("runs/strangers"))
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for case in itertools.islice(cases(args.part), args.first, args.first + args.count):
        try:
            rows.append(diagnosed(*case, args.folder))
        except Exception as problem:  # a traceback is a result, too
            what = f"{type(problem).__name__}: {problem}"
            rows.append({"rig": case[0], "change": case[1], "seed": case[3], "error": what, "wrong": []})
        print(json.dumps(rows[-1]), flush=True)
    found = sum(row.get("verdict") != "nothing_missing" for row in rows)
    right, wrong = sum(row.get("first", False) for row in rows), sum(bool(row["wrong"]) for row in rows)
    print(f"{len(rows)} records: {found} with a finding, {right} right first, {wrong} with a wrong name")


if __name__ == "__main__":
    main()
