"""Sections `strange` and `drawn`: learning on rigs of other kinds: collect, learn, and runs before and after.

The rigs are those of tests/strange_rigs.py: six named ones, and any number drawn at random; further ones are classes in
the folder that MAZEPLAN_RIGS names. Each gets 300 s of `collect --rings --place`, `learn --kind pi` of them, and the
same starts and seeds without a model and with the model just learned. Alone, for a look at some rigs:

    python tools/bench_strange.py [--drawn N] [--first SEED] [--runs R] [--workers K] [--seed S] [--logs N]
        [--seconds S] [--truth] [--short] [RIG ...]

RIG: MODULE:CLASS. --truth: drawn rigs run without a model, with the model just learned, with the true numbers of
the rig, and with these and perfect sensors. --short: runs with models of SHORT s of record, --logs of them, beside
those of LONG s.
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
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml
from bench_kit import Section, Table

SECONDS = 300.0
SHORT, LONG, NEARLY = 120.0, 600.0, 1.05  # s; mean time over that with long records that counts as the same
SIX = tuple(f"strange_rigs:{name}" for name in ("Stepper", "Prompt", "Late", "Springy", "Blind", "Slow"))
FIRST = 8000  # seed of the first drawn rig of the table; none of these had a part in the work on the program
SIGMAS = 3.0  # standard errors of a difference of mean times from which learning made a rig slower


PERFECT = {"noise_mm": 0.0, "pixel_mm": 0.0, "late_ms": 0.0, "lost": 0.0, "turned_deg": 0.0, "measured": True,
           "tilt_noise_deg": 0.0, "tilt_step_deg": 0.0, "tilt_late_ms": 0.0}  # fmt: skip


def make(name: str, maze: Any, more: dict[str, Any] | None = None) -> Any:
    """The rig MODULE:CLASS, or `drawn SEED`. more: settings that differ"""
    strange = importlib.import_module("strange_rigs")
    if name.startswith("drawn "):
        return strange.StrangeRig(maze, strange.drawn(int(name.split()[1])) | (more or {}))
    module, _, cls = name.partition(":")
    return getattr(importlib.import_module(module), cls)(maze, {})


def true_model(s: dict[str, Any], maze: Any) -> Any:
    """The model with the numbers of a strange rig (settings s), as far as a model has them."""
    from mazeplan.control.estimation.rigid_body_filter import BodyModel
    from mazeplan.control.estimation.rigid_body_fit import with_body, with_values
    from mazeplan.learning.rig_model import RigModel
    from mazeplan.physics.ball_model import BallModel
    from mazeplan.physics.effects.ball import (
        dry_friction,
        rolling_inertia,
        tilt_offset,
        viscous_friction,
        wall_friction,
    )
    from mazeplan.physics.rig.stage import StageAxis, StageModel

    tilt_late = s["tilt_late_ms"] if s["measured"] else 0.0
    late = 1e-3 * (tilt_late + (s["servo_ms"] if s["servo"] != "none" else 0.0))  # the model has measured tilts
    w = 2.0 * math.pi * s["servo_hz"]
    axis = {
        "first": StageAxis(1.0, w, 1.0, late, order=1),
        "rate": StageAxis(1.0, w, 1.0, late, order=1),
        "second": StageAxis(1.0, w, s["damping"], late),
    }.get(s["servo"], StageAxis.prompt(dead_time=late))
    limit, step = math.radians(s["slew_deg_s"]) or math.inf, math.radians(s["step_deg"])
    axis = replace(axis, rate_limit=limit, resolution=step, behind=True)
    stage = StageModel(*(replace(axis, backlash=math.radians(s[f"play_{name}_deg"])) for name in ("beta", "gamma")))
    lean = {"beta": math.radians(s["lean_x_deg"]), "gamma": math.radians(s["lean_y_deg"])}
    balls = {
        ring.number: BallModel((
            rolling_inertia(s["share"]), viscous_friction(s["viscous"]), tilt_offset(**lean),
            dry_friction(s["mu"] / max(ring.track_radius, 0.5 * ring.outer_radius)), wall_friction(s["wall_mu"]),
        )) for ring in maze.rings
    }  # fmt: skip
    delay = 1e-3 * (s["late_ms"] - tilt_late)
    model = RigModel(stage, balls, max(delay, -stage.dead_time), 1e-4, "pi", s["rate_hz"])
    noise = 1e-3 * math.hypot(s["noise_mm"], s["pixel_mm"] / math.sqrt(12.0))
    ball = with_values(BodyModel(), {
        "inertia": max(1.0 / s["share"] - 1.0, 0.05), "rolling": s["mu"] / s["share"],
        "viscous": s["viscous"] / s["share"], "wall": s["wall_mu"], "restitution": 0.4 if s["soft"] else s["rest"],
        "hold": 0.01, "spin": 2.0, "tilt_beta": lean["beta"], "tilt_gamma": lean["gamma"],
        "delay": model.camera_delay, "noise": max(noise, 5e-5), "plane": 1e-5 + 0.05 * s["heavy"] ** 2,
    })  # fmt: skip
    return with_body(model, ball, {})


def against_truth(name: str, model: Any, maze: Any, runs: int) -> dict[str, Any]:
    """Runs of a drawn rig: without a model, learned, with the true model, and with that and perfect sensors."""
    from mazeplan.learning.rig_model import RigModel

    strange = importlib.import_module("strange_rigs")
    s = strange.USUAL | strange.drawn(int(name.split()[1]))
    seen, textbook = true_model(s | PERFECT, maze), RigModel.nominal(maze)
    models = {"before": textbook, "after": model, "true": true_model(s, maze)}
    out = {word: summary(drive(name, one, maze, runs)) for word, one in models.items()}
    return out | {"perfect": summary(drive(name, seen, maze, runs, more=PERFECT))}


def trial(
    name: str, runs: int, seed: int, seconds: float = SECONDS, truth: bool = False, before: bool = True
) -> dict[str, Any]:
    """What one rig showed.

    runs: with and without the model; 0: only what `learn` writes
    truth: beside the true model, too (`against_truth`)
    before: whether to run without the model"""
    from mazeplan.core.errors import MazeplanError
    from mazeplan.core.logs.table import read_table
    from mazeplan.diagnosis.rig.reference import load_reference, save_reference
    from mazeplan.learning.modelfile import load_model, save_model
    from mazeplan.learning.rig_model import RigModel
    from mazeplan.maze.mapfile import load_map
    from mazeplan.run.collect import Collection, run_collection
    from mazeplan.run.commands.learn import learn_model

    maze, out = load_map("cme"), {"rig": name, "seed": seed}
    with TemporaryDirectory() as folder:
        log, written = Path(folder) / "log.mcap", Path(folder) / "model"
        plan = Collection(seconds, tuple(ring.number for ring in maze.rings), seed)
        run_collection(make(name, maze), maze, plan, log)
        began = time.process_time()
        try:
            done = learn_model([read_table(log)], maze, "pi")
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
    if truth:
        return out | against_truth(name, model, maze, runs)
    models = {"before": RigModel.nominal(maze), "after": model} if before else {"after": model}
    for word, one in models.items() if runs else ():
        out[word] = summary(drive(name, one, maze, runs))
    return out


def drive(name: str, model: Any, maze: Any, runs: int, seed: int = 0, more: dict[str, Any] | None = None) -> list[Any]:
    """Runs with the starts and seeds of `evaluate`. more: settings of the rig"""
    from mazeplan.run.campaign.one_run import start_angle
    from mazeplan.run.execution import run_job
    from mazeplan.run.settings import load_settings
    from mazeplan.run.specification import Job, Setup

    setup = Setup(maze, model, "navigate", name, settings=load_settings())
    return [run_job(make(name, maze, more), setup, Job(1, 5, start_angle(i), seed + i, 20.0)) for i in range(runs)]


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
    """The six, and the rigs of others; and the six with short records beside long ones."""
    columns = ("rig", "servo, as found", "fit: stage, ball (times the noise)", "without a model", "learned")
    table = Table((*columns, "CPU s of `learn`"))
    for row in measured([(name, 2 if quick else 24, 0) for name in (*others(), *SIX)]):
        table.add(*cells(row))
    notes = (
        "`MAZEPLAN_RIGS=FOLDER`: 300 s of `collect --rings --place`, `learn --kind pi`, then the same starts and seeds",
        "without a model and with the model just learned.",
    )
    short = short_table(SIX, 1 if quick else 20, 2 if quick else 32)
    return Section("Learning on rigs of other kinds, and from short records (simulated)", notes, (table, short))


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


def short_table(names: Sequence[str], logs: int, runs: int, workers: int = 2) -> Table:
    """Mean times with models of short records beside those with long ones."""
    table = Table(("rig", f"s after {LONG:g} s", f"s after {SHORT:g} s", f"within {NEARLY:g}", "arrived"))
    for name in names:
        tasks = [(name, runs, 500 + i, LONG, False, False) for i in range(2)]
        long = float(np.mean([row["after"]["mean"] for row in measured(tasks, workers)]))
        none = {"mean": None, "success": 0}  # of a record that cannot be learned from
        learned = measured([(name, runs, i, SHORT, False, False) for i in range(logs)], workers)
        rows = [row.get("after", none) for row in learned]
        times = [row["mean"] or math.inf for row in rows]
        same = sum(mean <= NEARLY * long and row["success"] == runs for mean, row in zip(times, rows, strict=True))
        arrived = f"{sum(row['success'] for row in rows)}/{runs * len(rows)}"
        spread = f"{min(times):.2f} to {max(times):.2f}"
        table.add(f"`{name}`", f"{long:.2f}", spread, f"{same} of {len(rows)} records", arrived)
    return table


def beside_truth(rows: Sequence[dict[str, Any]]) -> str:
    """How many runs arrive, and mean times: of all rigs, and of those on which all runs of all kinds arrive."""
    kinds = ("before", "after", "true", "perfect")
    good = [row for row in rows if "error" not in row]
    runs = sum(row["after"]["runs"] for row in good)
    whole = [row for row in good if all(row[kind]["success"] == row[kind]["runs"] for kind in kinds)]
    arrive = ", ".join(f"{kind} {sum(row[kind]['success'] for row in good)}" for kind in kinds)
    times = {kind: float(np.mean([row[kind]["mean"] for row in whole if row[kind]["mean"]])) for kind in kinds}
    ratio = float(np.mean([row["after"]["mean"] for row in whole])) / times["true"]
    return (
        f"{len(rows)} rigs, {len(rows) - len(good)} not learned, {runs} runs: {arrive} arrive; "
        f"{len(whole)} rigs on which all do: {', '.join(f'{kind} {t:.3f} s' for kind, t in times.items())}; "
        f"learned over true {ratio:.3f}"
    )


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
    p.add_argument("--truth", action="store_true", help="beside the true model")
    p.add_argument("--short", action="store_true", help="short records beside long ones")
    p.add_argument("rigs", nargs="*")
    o = p.parse_args()
    names = [*o.rigs, *(f"drawn {o.first + i}" for i in range(o.drawn))]
    tasks = [(name, o.runs, o.seed + i, o.seconds, o.truth) for name in names for i in range(o.logs)]
    if o.short:
        for figures in short_table(names, o.logs, o.runs, o.workers).rows:
            print(" | ".join(figures))
        return
    rows = measured(tasks, o.workers)
    if o.truth:
        print(beside_truth(rows))
        return
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
