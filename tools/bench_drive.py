"""Section `drive`: navigation on three packaged rigs and on rigs drawn at random, and what each part of the program
brings. All rigs are simulated. All runs use the same packaged settings and one process."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from importlib.resources import files
from typing import Any

import numpy as np
import yaml
from bench_kit import Section, Table, arrivals
from random_rigs import RANGES, draw, drive, packaged_model

from mazeplan.core.records import NavigationResult
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.registry import make_rig
from mazeplan.rigs.sim.simulated import SimulatedRig
from mazeplan.run.campaign.one_run import start_angle
from mazeplan.run.execution import run_job
from mazeplan.run.settings import Settings, load_settings
from mazeplan.run.specification import Job, Setup

HELD_OUT = 500_000_000  # first seed of the drawn rigs; these seeds had no part in tuning
FRESH = 31_000  # first seed of the runs with another camera
SHARP = {"camera_noise_mm": 0.0, "ball_lost_probability": 0.0, "tilt_noise_deg": 0.0}
CAMERAS = (  # what is changed of a rig
    ("as it is", {}), ("no noise, no lost picture", SHARP), ("no delay", {"camera_delay_frames": 0}),
    ("neither", {**SHARP, "camera_delay_frames": 0}),
)  # fmt: skip
COLUMNS = ("arrived", "mean s", "p50", "p95", "worst", "failures on the way")


def cells(outcomes: list[NavigationResult]) -> list[str]:
    """Cells of a row, in the order of COLUMNS."""
    arrived, times, failures = arrivals(outcomes)
    figures = [np.mean(times), *np.percentile(times, [50, 95]), max(times)] if times else []
    return [arrived, *([f"{x:.2f}" for x in figures] or ["-"] * 4), failures]


def runs_on(
    rig: str, runs: int, *, model: RigModel | None = None, settings: Settings | None = None, tree: str = "navigate"
) -> list[NavigationResult]:
    """Runs with the starts and seeds of `evaluate`, and something changed that no option of the command changes."""
    maze, out = load_map("cme"), []
    setup = Setup(maze, model or packaged_model(rig), tree, rig, settings=settings or load_settings())
    for i in range(runs):
        machine = make_rig(rig, maze)
        try:
            out.append(run_job(machine, setup, Job(1, 5, start_angle(i), i, 20.0)))
        finally:
            machine.close()
    return out


def drive_section(quick: bool) -> Section:
    """Packaged rigs, drawn rigs, times of a tick, and one part off at a time."""
    table, ticks = (
        Table(("rig", *COLUMNS)),
        Table(("rig", "p99 ms (worst run)", "longest ms"), caption="Time of a tick"),
    )
    for rig, runs in (("ideal", 32), ("toy", 100), ("rough", 100)):
        outcomes = runs_on(rig, runs // 8 if quick else runs)
        table.add(f"`evaluate --rig {rig} --runs {runs}`", *cells(outcomes))
        ticks.add(rig, *longest(outcomes))
    count = 8 if quick else 200
    drawn = [drive(draw(HELD_OUT + i), load_settings(), HELD_OUT + i) for i in range(count)]
    table.add(f"{count} rigs drawn at random", *cells(drawn))
    ticks.add("drawn rigs", *longest(drawn))
    off = Table(("what", *COLUMNS, "changed"), caption="What each part brings: toy, one part off at a time")
    for name, changed, outcomes in parts(8 if quick else 32):
        off.add(name, *cells(outcomes()), changed)
    seen = camera_table(8 if quick else 100)
    ranges = ", ".join(f"{key} {low:g} to {high:g}" for key, (low, high) in RANGES.items())
    notes = (
        f"Rigs are drawn uniformly from: {ranges}.",
        "Their seeds had no part in tuning. Their models are the truth with errors such as identification makes.",
    )
    return Section("Navigation on three rigs with the same settings (simulated)", notes, (table, ticks, off, seen))


def camera_table(runs: int) -> Table:
    """What noise and delay of the camera cost, ring by ring. With a delay, the arrival is seen that much later."""
    maze = load_map("cme")
    table = Table(
        ("rig", "camera", "arrived", "mean s", *(f"ring {ring.number}, s" for ring in maze.rings)),
        caption="What the camera costs",
    )
    for rig in ("toy", "rough"):
        settings = yaml.safe_load((files("mazeplan.rigs") / f"{rig}.yaml").read_text(encoding="utf-8"))
        for name, changed in CAMERAS:
            model = packaged_model(rig)
            if "camera_delay_frames" in changed:
                model, was = replace(model, camera_delay=0.0), settings["camera_delay_frames"]
                name += f" (instead of {1e3 * was / model.rate_hz:.0f} ms)"
            setup, done = Setup(maze, model, "navigate", rig, settings=load_settings()), []
            for i in range(runs):
                machine = SimulatedRig(maze, settings | changed)
                done.append(run_job(machine, setup, Job(1, 5, None, FRESH + i, 20.0)))
                machine.close()
            whole = [[ring.time_s for ring in one.rings] for one in done if one.success]
            rings = np.mean([times for times in whole if len(times) == len(maze.rings)], axis=0)
            arrived, times, _ = arrivals(done)
            table.add(rig, name, arrived, f"{np.mean(times):.3f}", *(f"{seconds:.3f}" for seconds in rings))
    return table


def longest(outcomes: list[NavigationResult]) -> tuple[str, ...]:
    """The largest 99th percentile of the runs, and the longest tick, ms."""
    return tuple(f"{max(o.tick_ms[key] for o in outcomes):.1f}" for key in ("p99", "max"))


def parts(runs: int) -> list[tuple[str, str, Callable[[], list[NavigationResult]]]]:
    """Name of each part, what is changed, and its runs."""
    base, model, nominal = load_settings(), packaged_model("toy"), RigModel.nominal(load_map("cme"))
    physics = replace(nominal, camera_delay=model.camera_delay, stage=model.stage)

    def with_(
        values: dict[str, dict[str, Any]], model: RigModel | None = None, tree: str = "navigate"
    ) -> Callable[[], list[NavigationResult]]:
        changed = base.with_values(values)  # here, so that a refused value shows before the runs
        return lambda: runs_on("toy", runs, settings=changed, model=model, tree=tree)

    once = {"tracking": {"replan_every": 1000, "replan_theta": 1e3, "replan_speed": 1e3}}
    return [
        ("everything", "-", with_({})),
        ("no prediction over the camera's delay", "camera_delay 0", with_({}, replace(model, camera_delay=0.0))),
        ("no lead over the servo's lag", "gate.lead_s 0", with_({"gate": {"lead_s": 0.0}})),
        ("a plan once per ring, its own gains", "tracking.replan_* off", with_(once)),
        ("an opening chosen by the formula", "travel.planned_choices 1", with_({"travel": {"planned_choices": 1}})),
        ("the next move begins in the next ring", "gate.entry_s 0", with_({"gate": {"entry_s": 0.0}})),
        ("stop in front of an opening", "gate.window_speed_m_s 0.02, travel.speed_m_s 0",
         with_({"gate": {"window_speed_m_s": 0.02, "entry_s": 0.0}, "travel": {"speed_m_s": 0.0}})),
        ("no command tried before an opening", "rollout.late_s 0, rollout.late_body_s 0",
         with_({"rollout": {"late_s": 0.0, "late_body_s": 0.0}})),
        ("effects without the process", "pi for sp", with_({}, replace(model, processes={}, kind="pi"))),
        ("textbook ball, learned delay and stage", "nominal ball", with_({}, physics)),
        ("textbook everything", "no model", with_({}, nominal)),
    ]  # fmt: skip
