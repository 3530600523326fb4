"""Navigation on the three packaged rigs and on rigs drawn at random, and what each part brings. Used by tools/bench.py.

All in simulation, one process, the same packaged settings everywhere."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from random_rigs import RANGES, draw, drive, packaged_model

from mazeplan.core.records import NavigationResult
from mazeplan.learning.modelfile import RigModel
from mazeplan.maze.mapfile import load_map
from mazeplan.rigs.registry import make_rig
from mazeplan.run.campaign.evaluate import start_angle
from mazeplan.run.execution import run_job
from mazeplan.run.settings import Settings, load_settings
from mazeplan.run.specification import Job, Setup

ASKED = {
    "ideal": "32/32, mean 2.6 s",
    "toy": "100/100, mean 2.9 s, p95 3.5 s",
    "rough": "99/100, mean 3.7 s, p95 4.6 s",
}
DOUBT = 0.03  # s^4/rad^2; the price in the table of parts
ROOT = Path(__file__).resolve().parent.parent
HELD_OUT = 500_000_000  # seeds of drawn rigs from here on had no part in tuning


def row(name: str, outcomes: list[NavigationResult], last: str) -> str:
    """One line of a table."""
    times = np.array([o.time_s for o in outcomes if o.success])
    failures = Counter(str(f.kind) for o in outcomes for f in o.failures)
    figures = (
        [f"{x:.2f}" for x in (times.mean(), *np.percentile(times, [50, 95]), times.max())] if len(times) else "----"
    )
    text = ", ".join(f"{kind} {count}" for kind, count in sorted(failures.items())) or "none"
    line = f"| {name} | {len(times)}/{len(outcomes)} | {' | '.join(figures)} | {text} | {last} |"
    print(line, file=sys.stderr)
    return line


def runs_on(
    rig: str, runs: int, *, model: RigModel | None = None, settings: Settings | None = None, tree: str = "navigate",
    seed: int = 0,
) -> list[NavigationResult]:  # fmt: skip
    """`evaluate` with something changed that no option of the command changes."""
    maze, how, out = load_map("cme"), settings or load_settings(), []
    for i in range(runs):
        machine = make_rig(rig, maze)
        try:
            setup = Setup(maze, model or packaged_model(rig), tree, rig, settings=how)
            out.append(run_job(machine, setup, Job(1, 5, start_angle(i), seed + i, 20.0)))
        finally:
            machine.close()
    return out


def drive_section(quick: bool) -> list[str]:
    """Packaged rigs, drawn rigs, and a table with one part off at a time."""
    few = 4 if quick else 1
    rows = [
        "## Navigation on three rigs with the same settings (simulated)",
        "",
        "| rig | arrived | mean s | p50 | p95 | worst | failures on the way | asked |",
        "|---|---|---|---|---|---|---|---|",
    ]
    done = {}
    for rig, runs in (("ideal", 32), ("toy", 100), ("rough", 100)):
        done[rig] = runs_on(rig, runs // few // 2 if quick else runs)
        rows.append(row(f"`evaluate --rig {rig} --runs {runs}`", done[rig], ASKED[rig]))
    toy, rough = done["toy"], done["rough"]
    count = 8 if quick else 200
    drawn = [drive(draw(HELD_OUT + i), load_settings(), HELD_OUT + i) for i in range(count)]
    rows.append(row(f"{count} rigs drawn at random", drawn, "198/200"))
    rows += [
        "",
        f"{ticks('toy', toy)} {ticks('rough', rough)} {ticks('drawn rigs', drawn)} Asked: p99 below 20, none above 33.",
        "Drawn uniformly from: " + ", ".join(f"{key} {low:g} to {high:g}" for key, (low, high) in RANGES.items()) + ".",
        "Their seeds had no part in tuning; their models are the truth with errors such as identification makes.",
        "",
        "### What each part brings: toy, one part off at a time",
        "",
        "| what | arrived | mean s | p50 | p95 | worst | failures on the way | changed |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, changed, outcomes in parts(8 if quick else 32):
        rows.append(row(name, outcomes(), changed))
    return rows


def ticks(name: str, outcomes: list[NavigationResult]) -> str:
    """Times of a tick, estimate to command, in words."""
    late = [o.tick_ms for o in outcomes]
    return (
        f"Tick, {name}: p99 {max(t['p99'] for t in late):.1f} ms (worst run), longest "
        f"{max(t['max'] for t in late):.1f} ms."
    )


def tree_with_pd() -> str:
    """The packaged tree, but plans are followed by PD; a file that lies beside others that were built."""
    text = (ROOT / "behaviors" / "navigate.xml").read_text()
    track = '<Track opening="{opening}" plan="{plan}"'
    if track not in text:
        raise SystemExit("the packaged tree has no such Track any more")
    path = ROOT / "build" / "pd.xml"
    path.parent.mkdir(exist_ok=True)
    path.write_text(text.replace(track, track + ' law="pd"'))
    return str(path)


def parts(runs: int) -> list[tuple[str, str, Callable[[], list[NavigationResult]]]]:
    """Name, what is changed, and the runs."""
    base, model = load_settings(), packaged_model("toy")
    nominal = RigModel.nominal(load_map("cme"))
    physics = replace(nominal, camera_delay=model.camera_delay, stage=model.stage)

    def with_(
        sections: dict[str, dict[str, Any]], model: RigModel | None = None, tree: str = "navigate"
    ) -> Callable[[], list[NavigationResult]]:
        changed = base.with_values(sections)  # here, so that a value that is refused shows before the runs
        return lambda: runs_on("toy", runs, settings=changed, model=model, tree=tree)

    once = {"tracking": {"replan_every": 1000, "replan_theta": 1e3, "replan_speed": 1e3}}
    return [
        ("everything", "-", with_({})),
        ("no prediction over the camera's delay", "camera_delay 0", with_({}, replace(model, camera_delay=0.0))),
        ("no lead over the servo's lag", "gate.lead_s 0", with_({"gate": {"lead_s": 0.0}})),
        ("a plan once per ring, its own gains", "tracking.replan_* off", with_(once)),
        ("a plan once per ring, followed by PD", "the same, law pd", with_(once, tree=tree_with_pd())),
        ("an opening chosen by the formula", "travel.planned_choices 1", with_({"travel": {"planned_choices": 1}})),
        ("what is not known has a price", f"cost.uncertainty {DOUBT:g}", with_({"cost": {"uncertainty": DOUBT}})),
        ("the next move begins in the next ring", "gate.entry_s 0", with_({"gate": {"entry_s": 0.0}})),
        ("stop in front of an opening", "gate.window_speed_m_s 0.02, travel.speed_m_s 0",
         with_({"gate": {"window_speed_m_s": 0.02, "entry_s": 0.0}, "travel": {"speed_m_s": 0.0}})),
        ("no command tried before an opening", "rollout.late_s 0, rollout.late_body_s 0",
         with_({"rollout": {"late_s": 0.0, "late_body_s": 0.0}})),
        ("effects without the process", "pi for sp", with_({}, replace(model, processes={}, kind="pi"))),
        ("textbook ball, learned delay and stage", "nominal ball", with_({}, physics)),
        ("textbook everything", "no model", with_({}, nominal)),
    ]  # fmt: skip


if __name__ == "__main__":
    print("\n".join(drive_section("--quick" in sys.argv)))
