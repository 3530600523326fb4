"""Sections `strange` and `drawn`: learning on rigs of other kinds: collect, learn, and runs before and after.

The rigs are those of tests/strange_rigs.py: six named ones, and any number drawn at random; further ones are classes in
the folder that MAZEPLAN_RIGS names. Each gets 300 s of `collect --rings --place`, `learn --kind pi` of them, and the
same starts and seeds without a model and with the model just learned. Alone, for a look at some rigs:

    python tools/bench_strange.py [--drawn N] [--first SEED] [--runs R] [--workers K] [--seed S] [--logs N]
        [--seconds S] [RIG ...]

RIG: MODULE:CLASS
"""

from __future__ import annotations

import argparse
import importlib
import json
import math
import os
import sys
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml
from bench_kit import Section, Table

SECONDS = 300.0
SIX = tuple(f"strange_rigs:{name}" for name in ("Stepper", "Prompt", "Late", "Springy", "Blind", "Slow"))
FIRST = 8000  # seed of the first drawn rig of the table; none of these had a part in the work on the program
SIGMAS = 3.0  # standard errors of a difference of mean times from which learning made a rig slower


def make(name: str, maze: Any) -> Any:
    """The rig MODULE:CLASS, or `drawn SEED`."""
    strange = importlib.import_module("strange_rigs")
    if name.startswith("drawn "):
        return strange.StrangeRig(maze, strange.drawn(int(name.split()[1])))
    module, _, cls = name.partition(":")
    return getattr(importlib.import_module(module), cls)(maze, {})


def trial(name: str, runs: int, seed: int, seconds: float = SECONDS) -> dict[str, Any]:
    """What one rig showed.

    runs: with and without the model; 0: only what `learn` writes"""
    from mazeplan.core.errors import MazeplanError
    from mazeplan.core.logs.table import read_table
    from mazeplan.diagnosis.rig.reference_file import load_reference, save_reference
    from mazeplan.learning.modelfile import load_model, save_model
    from mazeplan.learning.rig_model import RigModel
    from mazeplan.maze.mapfile import load_map
    from mazeplan.run.collect import Collection, run_collection
    from mazeplan.run.learn import learn

    maze, out = load_map("cme"), {"rig": name, "seed": seed}
    with TemporaryDirectory() as folder:
        log, written = Path(folder) / "log.mcap", Path(folder) / "model"
        plan = Collection(seconds, tuple(ring.number for ring in maze.rings), seed)
        run_collection(make(name, maze), maze, plan, log)
        began = time.process_time()
        try:
            done = learn([read_table(log)], maze, "pi")
            out["learn_s"] = round(time.process_time() - began, 1)
            model = load_model(save_model(done.model, written))
            if done.reference is not None:
                save_reference(done.reference, done.model, written)
                load_reference(written, model)
        except (MazeplanError, ValueError, ArithmeticError) as problem:
            return {**out, "error": f"{type(problem).__name__}: {problem}"}
        out["open"] = [name for path in written.glob("*.yaml") for name in left_open(yaml.safe_load(path.read_text()))]
    out |= {"fits": done.fits(), "judged": done.judgement.document(), "delay_s": round(model.camera_delay, 4)}
    axes = model.stage.beta, model.stage.gamma
    out["stage"] = [(a.order, round(a.natural_frequency, 1), round(a.dead_time, 4)) for a in axes]
    for word, one in (("before", RigModel.nominal(maze)), ("after", model)) if runs else ():
        out[word] = summary(drive(name, one, maze, runs))
    return out


def drive(name: str, model: Any, maze: Any, runs: int, seed: int = 0) -> list[Any]:
    """Runs with the starts and seeds of `evaluate`."""
    from mazeplan.run.campaign.one_run import start_angle
    from mazeplan.run.execution import run_job
    from mazeplan.run.settings import load_settings
    from mazeplan.run.specification import Job, Setup

    setup = Setup(maze, model, "navigate", name, settings=load_settings())
    return [run_job(make(name, maze), setup, Job(1, 5, start_angle(i), seed + i, 20.0)) for i in range(runs)]


def summary(done: Sequence[Any]) -> dict[str, Any]:
    """Arrivals, times, and how many of the others named within 2 s what does not fit."""
    times = [result.time_s for result in done if result.success]
    named = sum(not result.success and any(m.t <= 2.0 for m in result.misfits) for result in done)
    return {
        "success": len(times), "runs": len(done), "named": named,
        "mean": round(float(np.mean(times)), 3) if times else None,
        "stderr": round(float(np.std(times)) / math.sqrt(len(times)), 3) if times else None,
    }  # fmt: skip


def left_open(node: Any, key: str = "") -> Iterable[str]:
    """Names of the numbers in a model file that its record does not determine: the standard error is as large as the
    range, or the number is at a bound."""
    from mazeplan.learning.rigid_body_entries import PARAMETERS

    if not isinstance(node, dict):
        return
    name = key.rpartition(".")[2]
    if "value" in node:
        number = PARAMETERS.get(name)
        low, high = (-math.inf, math.inf) if number is None else (number.low, number.high)
        if node["value"] in (low, high) or node.get("stderr", 0.0) > min(high - low, 100.0):
            yield key
        return
    for k, v in node.items():
        yield from left_open(v, f"{key}.{k}".strip("."))


def slower(row: dict[str, Any]) -> bool:
    """Whether learning made a rig worse: fewer arrivals, or a longer mean time beyond doubt."""
    a, b = row["before"], row["after"]
    if b["success"] < a["success"]:
        return True
    return a["success"] == a["runs"] and b["mean"] > a["mean"] + SIGMAS * math.hypot(a["stderr"], b["stderr"])


def measured(tasks: Sequence[tuple[Any, ...]], workers: int = 2) -> list[dict[str, Any]]:
    """All rows; each is printed as it comes. tasks: arguments of `trial`"""
    rows = []
    with ProcessPoolExecutor(workers) as pool:
        for row in pool.map(trial, *zip(*tasks, strict=True)) if tasks else ():
            print(json.dumps(row), file=sys.stderr, flush=True)
            rows.append(row)
    return rows


def others() -> tuple[str, ...]:
    """Rigs of other people, from the folder in MAZEPLAN_RIGS."""
    folder = os.environ.get("MAZEPLAN_RIGS")
    if not folder:
        return ()
    sys.path.insert(0, folder)
    return ("euler_rig:StickyRig", "delay_rig:Delayed")


def strange_section(quick: bool) -> Section:
    """The six, and the rigs of others."""
    columns = ("rig", "servo, as found", "fit: stage, ball (times the noise)", "without a model", "learned")
    table = Table((*columns, "CPU s of `learn`"))
    for row in measured([(name, 2 if quick else 24, 0) for name in (*others(), *SIX)]):
        table.add(*cells(row))
    notes = (
        "`MAZEPLAN_RIGS=FOLDER`: 300 s of `collect --rings --place`, `learn --kind pi`, then the same starts and seeds",
        "without a model and with the model just learned.",
    )
    return Section("Learning on rigs of other kinds (simulated)", notes, (table,))


def drawn_section(quick: bool) -> Section:
    """Rigs drawn at random, and ten records of each named rig."""
    drawn, logs = (2, 1) if quick else (100, 10)
    many = [row for row in measured([(f"drawn {FIRST + i}", 8, 0) for i in range(drawn)]) if "error" not in row]
    arrive = [sum(row[when]["success"] == row[when]["runs"] for row in many) for when in ("before", "after")]
    worse = [row["rig"] for row in many if slower(row)]
    written = measured([(name, 0, seed) for name in (*others(), *SIX) for seed in range(logs)])
    failed, open_ = [r for r in written if "error" in r], [n for r in written if "error" not in r for n in r["open"]]
    table = Table(("what", "figure"))
    table.add(f"rigs (seeds {FIRST} on)", drawn)
    table.add("arrive in all runs without a model", arrive[0])
    table.add("arrive in all runs with the model that they learned", arrive[1])
    table.add(f"made worse by learning: fewer arrivals, or longer by {SIGMAS:g} standard errors", listed(worse))
    table.add("records that could not be learned from", drawn - len(many))
    table.add(f"records of the named rigs, {logs} each: unreadable files", f"{len(failed)} of {len(written)}")
    table.add("numbers in them at a bound or as uncertain as their range", len(open_))
    longest = max(row.get("learn_s", 0.0) for row in (*many, *written))
    table.add("CPU s of `learn --kind pi` with any of all these records, at most", f"{longest:.1f}")
    notes = (
        "`MAZEPLAN_RIGS=FOLDER`: servos, balls, walls, tilt sensors and cameras of all kinds of tests/strange_rigs.py,",
        "300 s of record each, 8 runs before and after.",
    )
    return Section("Learning on rigs drawn at random (simulated)", notes, (table,))


def listed(names: Sequence[str]) -> str:
    """How many, and which."""
    return f"{len(names)}{f' ({names[0]} ...)' if names else ''}"


def cells(row: dict[str, Any]) -> tuple[str, ...]:
    """The row of a named rig."""
    if "error" in row:
        return f"`{row['rig']}`", row["error"], "", "", "", ""
    order, frequency, dead = row["stage"][0]
    kind = ("at once", f"first order, {frequency:.0f} rad/s", f"second order, {frequency:.0f} rad/s")[order]
    fits = ", ".join(f"{name} {times:.1f}" for name, times in row["fits"].items())
    runs = [
        f"{row[when]['success']}/{row[when]['runs']}"
        + (f", {row[when]['mean']:.2f} ± {row[when]['stderr']:.2f} s" if row[when]["mean"] else "")
        + (f", {row[when]['named']} named within 2 s" if row[when]["named"] else "")
        for when in ("before", "after")
    ]
    late = f" after {1e3 * dead:.0f} ms" if dead > 5e-3 else ""
    return f"`{row['rig']}`", kind + late, fits, *runs, f"{row['learn_s']:.0f}"


def main() -> None:
    p = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    p.add_argument("--drawn", type=int, default=0)
    p.add_argument("--first", type=int, default=0, help="seed of the first drawn rig")
    p.add_argument("--runs", type=int, default=8)
    p.add_argument("--workers", type=int, default=2)
    p.add_argument("--seed", type=int, default=0, help="of the records")
    p.add_argument("--logs", type=int, default=1, help="records of each rig, with this seed and the next ones")
    p.add_argument("--seconds", type=float, default=SECONDS, help="of each record")
    p.add_argument("rigs", nargs="*")
    o = p.parse_args()
    names = [*o.rigs, *(f"drawn {o.first + i}" for i in range(o.drawn))]
    rows = measured([(name, o.runs, o.seed + i, o.seconds) for name in names for i in range(o.logs)], o.workers)
    good = [row for row in rows if "after" in row]
    after, before = (sum(row[when]["success"] == o.runs for row in good) for when in ("after", "before"))
    bad, failed = [row["rig"] for row in good if slower(row)], [row["rig"] for row in rows if "error" in row]
    print(
        f"{len(rows)} records: {after} arrive in all runs when learned, {before} before; worse: {bad}; errors: {failed}"
    )
    most, left = max(row.get("learn_s", 0.0) for row in rows), sum(len(row.get("open", ())) for row in rows)
    print(f"learn: at most {most:.1f} CPU s; numbers at a bound or as uncertain as their range: {left}")


if __name__ == "__main__":
    main()
