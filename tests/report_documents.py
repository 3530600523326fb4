"""Small documents of each kind, as the commands print them, with values that a test can know; and a small log."""

from __future__ import annotations

import math

import numpy as np

from mazeplan.apps.report.page import PagePicture
from mazeplan.core.events import FailureReported, RecoveryChosen, RingEntered
from mazeplan.core.logs.run_log import RunLogWriter
from mazeplan.core.records import Plan, StopReason, TreeOutline
from mazeplan.maze.mapfile import dump_map, load_map

MAZE = load_map("cme")
EVIL = "<script>alert('x')</script>"
STEP = 1.0 / 30.0
LEAVES = ("Root/Go/Track", "Root/Go/PassOpening", "Root/Recover/Dither")


def a_log(path, *, trees=True, rig="toy", detail="it does not move", result=True):
    """90 ticks at 30 Hz: a ball that goes around ring 1 at 1 rad/s, into ring 2 after 2 s, stuck at 1 s. Plans at each
    tenth tick say that it goes 1.5 rad/s. Track runs until 1 s and from 2 s on, Dither between, which ends well."""
    header = {"rig": rig, "version": "9.9", "map": dump_map(MAZE), "map_name": "cme", "model": "sp", "seed": 3,
              "start_ring": 1, "goal_ring": 2, "behavior": "navigate"}  # fmt: skip
    with RunLogWriter(path, header) as log:
        if trees:
            parents = [-1, 0, 1, 1, 0, 4]
            paths = ["Root", "Root/Go", *LEAVES[:2], "Root/Recover", LEAVES[2]]
            names = tuple(p.split("/")[-1] for p in paths)
            log.tree(0.0, TreeOutline(tuple(paths), ("Sequence",) * 6, names, tuple(parents)))
        log.event(0.0, RingEntered(1))
        for k in range(90):
            t = k * STEP
            _tick(log, k, t)
            if k == 30:
                log.event(t, FailureReported("stuck", "Track", detail))
                log.event(t, RecoveryChosen("dither"))
            if k == 60:
                log.event(t, RingEntered(2))
            if trees and k in (0, 30, 60):
                log.statuses(t, {0: "RRR---", 30: "RFF-RR", 60: "RRR-SS"}[k])
        if result:
            log.result({"success": True, "reason": "arrived", "time_s": 89 * STEP, "replans": 0,
                        "rings": [{"ring": 1, "time_s": 2.0, "opening": "1-2@135"}, {"ring": 2, "time_s": 0.97}],
                        "failures": [{"t": 1.0, "kind": "stuck", "recovery": "dither"}]})  # fmt: skip
    return path


def _tick(log, k, t):
    r = MAZE.track_radius(1 if k < 60 else 2)
    leaf = "Dither" if 30 <= k < 60 else "Track"
    place = {"estimate_x": r * math.cos(t), "estimate_y": r * math.sin(t), "estimate_t": t}
    document = {"t": t, "x": place["estimate_x"], "y": place["estimate_y"], "beta": 0.01, "gamma": 0.0, "u_beta": 0.02,
                "u_gamma": 0.0, "ring": 1 if k < 60 else 2, "leaf": leaf, "tick_ms": 1.0 + k, "goal_theta": t + 1.5,
                **place}  # fmt: skip
    log.write("/tick", t, document)
    if k % 10 == 0:
        states = np.zeros((31, 6))
        states[:, 0] = t + 1.5 * STEP * np.arange(31)
        for aside in (-3.0, 0.0):  # one for another opening, further from the goal of the tick
            states_of = states + np.array([aside, 0, 0, 0, 0, 0])
            controls, gains = np.zeros((30, 2)), np.zeros((30, 2, 6))
            log.plan(Plan(states_of, controls, gains, 1.0, StopReason.CONVERGED, 3, 2.0, t, STEP))


def evaluation(name="toy", arrived=(True, True, False, True)):
    """Four runs: starts at 10, 11, 100 and 200 deg, 2, 3, 4 and 5 s long."""
    results = []
    for i, (good, degrees) in enumerate(zip(arrived, (10.0, 11.0, 100.0, 200.0), strict=True)):
        failures = [{"t": 1.0, "kind": "stuck", "recovery": "dither", "where": "Track", "x": 0.05, "y": -0.01}]
        rings = [
            {"ring": 1, "time_s": 1.0 + i, "opening": "1-2@45"}, {"ring": 2, "time_s": 0.5, "opening": None},
            {"ring": 1, "time_s": 0.25, "opening": None},
        ]  # fmt: skip
        results.append({
            "success": good, "reason": "arrived" if good else "out_of_time", "time_s": 2.0 + i, "rings": rings,
            "failures": failures if i in (0, 2) else [], "start": {"ring": 1, "theta": math.radians(degrees)},
        })  # fmt: skip
    setup = {"rig": name, "map": dump_map(MAZE), "map_name": "cme", "model": "sp", "version": "9.9", "time_limit_s": 20}
    times = [result["time_s"] for result in results if result["success"]] or [math.nan]
    figures = {"mean": np.mean(times), "best": min(times), "p50": np.median(times), "p95": np.percentile(times, 95.0),
               "worst": max(times)}  # fmt: skip
    time_s = {name: float(value) if math.isfinite(value) else None for name, value in figures.items()}
    return {"runs": 4, "success": sum(arrived), "time_s": time_s, "results": results, "setup": setup}


def comparison(rings=(1, 2)):
    """Two kinds in each ring; sp is the best."""
    out = {}
    for ring in rings:
        band = {name: [0.01 * k for k in range(41)] for name in ("mean", "p10", "p50", "p90")}
        out[f"ring{ring}"] = {
            "n_train": 400, "n_test": 100, "rates": "smoothed", "delay_s": 0.05, "windows": 7,
            "windows_chosen": "evenly spaced", "nrmse_train": {"p": 0.91, "sp": 0.2},
            "nrmse_test": {"p": 0.9 + 0.01 * ring, "sp": 0.3451}, "rollout": {"sp": {"20": 0.1234, "40": 0.2468}},
            "interval95": {"nrmse_test": {"sp": [0.31, 0.37]}},
            "bands": {"sp": band},
        }  # fmt: skip
    return out


def diagnosis():
    """Two that cannot be told apart."""
    part = {"value": 0.4123, "stderr": 0.02, "unit": "rad/s^2"}
    return {
        "verdict": "ambiguous", "sentence": "The model lacks dry friction (this record cannot tell).",
        "effects": [{"name": "dry_friction", "parameters": {"coefficient": part}, "evidence": 321.5}],
        "ambiguous_with": [["dry_friction", "viscous_friction"]],
        "before": {"nrmse": 0.7654, "rollout20": 0.1, "rollout40": 0.2929},
        "after": {"nrmse": 0.3, "rollout20": 0.003, "rollout40": 0.0061}, "noise_floor": 0.005, "held_out": 0.3,
        "ring": 2, "radius_m": 0.06892, "declared": {}, "notes": ["Scores are of the last 30 %."],
    }  # fmt: skip


def evidence(title="log, ring 2"):
    """Where speed explains most."""

    def part(by_speed):
        curve = {"at": [-1.0, 0.0, 1.0], "mean": [0.1, 0.0, 0.1], "stderr": [0.1, 0.1, 0.1]}
        steep = {**curve, "mean": [by_speed, 0.0, -by_speed]}
        return {"position": curve, "speed": steep, "time": curve}

    names = ("dry_friction", True), ("placebo: noise", True), ("powers of the speed", False)
    tried = [{"name": name, "gain": 100.0 - 40 * i, "named": named, "placebo": name.startswith("placebo")}
             for i, (name, named) in enumerate(names)]  # fmt: skip
    return {"title": title, "notes": ["Tilt: commands."], "labels": {"nrmse": "nRMSE of theta_dd",
            "rollout40": "theta error after 40 samples, rad"},
            "axes": ["theta, rad", "theta_dot, rad/s"], "candidates": tried, "before": part(0.8),
            "after": part(0.1)}  # fmt: skip


def drawn(parts, name):
    """A picture of a section's parts by its name, drawn as on its page: its figure."""
    return next(part for part in parts if isinstance(part, PagePicture) and part.name == name).figure()


def kept(parts, kind):
    """The parts of one kind."""
    return [part for part in parts if isinstance(part, kind)]
