"""Measures what the README and the changelog may claim, and writes BENCHMARKS.md. Usage: python tools/bench.py
[--quick] [--parallel] [--only NAME ...] [-o FILE]

Every section is a command that anyone can repeat. All navigation figures are obtained in simulation, in physics
(MuJoCo) that the planner does not share. Seeds are in the commands (default 0).
"""

from __future__ import annotations

import argparse
import json
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from bench_balls import balls_section
from bench_baselines import baselines_section
from bench_batch import batch_section
from bench_body import body_section
from bench_camera import camera_section
from bench_campaign import campaign_section
from bench_closed_loop import closed_loop_section
from bench_contact import contact_section
from bench_contactplant import contactplant_section
from bench_diagnose import diagnose_section
from bench_drive import drive_section
from bench_effects import effects_section
from bench_emps import emps_section
from bench_faults import faults_section
from bench_firmware import firmware_section
from bench_growth import growth_section
from bench_gym import gym_section
from bench_improve import improve_section
from bench_learning import learning_section
from bench_logged_runs import logged_runs_section
from bench_memory import memory_section
from bench_models import collect_toy, measured_section, toy_section, training_section
from bench_moves import moves_section
from bench_mutants import mutants_section
from bench_neural import neural_section
from bench_out import out_section
from bench_pairs import pairs_section
from bench_plant import plant_section
from bench_policy import policy_section
from bench_predictability import predictability_section
from bench_real import real_section
from bench_realtime import realtime_section
from bench_replay import replay_section
from bench_rig import rig_section
from bench_solver import solver_section
from bench_strange import drawn_section, strange_section
from bench_supply import supply_section
from bench_trees import trees_section
from bench_view import view_section
from bench_waypoints import waypoints_section

from mazeplan.run.settings import load_settings

ROOT = Path(__file__).resolve().parent.parent
AGAIN = "- measured again on"
PACKAGES = ("mazeplan", "numpy", "numba", "mujoco", "torch", "gpytorch")
PAPER = "7 of 10, mean 7.71 s, best 6.2 s, worst 10.13 s (published, on hardware)"


def mazeplan(*arguments: str) -> dict:
    """The JSON document of one command; its failure status is not ours to judge."""
    done = subprocess.run(
        [sys.executable, "-m", "mazeplan", *arguments, "--json"], capture_output=True, text=True, cwd=ROOT, check=False
    )
    if not done.stdout.strip():
        raise SystemExit(f"mazeplan {' '.join(arguments)}: exit {done.returncode}\n{done.stderr}")
    return json.loads(done.stdout)


def cpu() -> str:
    """Name of the processor, where the system tells."""
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def evaluation_rows(jobs: list[tuple[str, list[str]]]) -> list[str]:
    rows = [
        "| what | command | arrived | mean s | best | p50 | p95 | worst | failures on the way |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for label, arguments in jobs:
        got = mazeplan("evaluate", *arguments)
        t = got["time_s"]
        times = [f"{t[key]:.2f}" if t[key] is not None else "-" for key in ("mean", "best", "p50", "p95", "worst")]
        failures = ", ".join(f"{kind} {count}" for kind, count in got["failures"].items()) or "none"
        command = "`mazeplan evaluate " + " ".join(arguments) + "`"
        rows.append(f"| {label} | {command} | {got['success']}/{got['runs']} | {' | '.join(times)} | {failures} |")
        print(rows[-1], file=sys.stderr)
    return rows


def navigation_section(quick: bool) -> list[str]:
    few = "4" if quick else "16"
    main = [
        ("ideal rig", ["--rig", "ideal", "--runs", few]),
        ("toy rig", ["--rig", "toy", "--runs", "8" if quick else "32"]),
        ("toy rig, other noise", ["--rig", "toy", "--runs", few, "--seed", "1000"]),
        ("outwards", ["--rig", "toy", "--from", "ring5", "--to", "ring1", "--runs", few]),
        ("second map", ["--rig", "toy", "--map", "lopsided", "--runs", few]),
        (
            "second map, outwards",
            ["--rig", "toy", "--map", "lopsided", "--from", "ring3", "--to", "ring1", "--runs", few],
        ),
    ]
    pairs = [
        (
            f"ring {a} to {b}",
            ["--rig", "toy", "--from", f"ring{a}", "--to", f"ring{b}", "--runs", "2" if quick else "4"],
        )
        for a in range(1, 6)
        for b in range(1, 6)
        if a != b and (a, b) not in ((1, 5), (5, 1))
    ]
    return [
        "## Navigation (simulated)",
        "",
        f"To compare: {PAPER}.",
        "",
        "The settings were searched by tools/tune.py on packaged and drawn rigs with other seeds; a few of them "
        "were set",
        "by hand after trials on the standard starts of the packaged rigs, seeds 0 to 47. The rows with other seeds,",
        "rings and maps had no part in that.",
        "",
        *evaluation_rows(main),
        "",
        "### Between any two rings",
        "",
        *evaluation_rows(pairs),
    ]


def tick_section() -> list[str]:
    arguments = ["evaluate", "--rig", "toy", "--runs", "8"]
    got = mazeplan(*arguments)
    rows = ["## Time of one tick and of one plan", "", f"`mazeplan {' '.join(arguments)} --json`, one process.", ""]
    rows += ["| what | p50 ms | p99 ms (worst run) | max ms |", "|---|---|---|---|"]
    for key, label in (("tick_ms", "tick: estimate, tree, plan, command"), ("planner_ms", "plan")):
        rows.append(f"| {label} | {got[key]['p50']:.2f} | {got[key]['p99']:.2f} | {got[key]['max']:.2f} |")
    deadline = load_settings().leaves.travel.deadline_ms
    late = sum(run["planner_ms"]["max"] > deadline + 1.0 for run in got["results"])
    rows.append(
        f"| runs with a plan over its deadline of {deadline:g} ms by 1 ms or more | {late} of {got['runs']} | | |"
    )
    log = ROOT / "build" / "bench.mcap"
    log.parent.mkdir(exist_ok=True)
    one = mazeplan("navigate", "--rig", "toy", "--log", str(log), "--force")["tick_ms"]
    rows.append(f"| tick with the log written | {one['p50']:.2f} | {one['p99']:.2f} | {one['max']:.2f} |")
    return rows


def start_section() -> list[str]:
    def seconds(*command: str) -> float:
        began = time.perf_counter()
        subprocess.run(command, capture_output=True, check=True, cwd=ROOT)
        return time.perf_counter() - began

    rows = ["## Start of the program", "", "| command | median of 5, s |", "|---|---|"]
    for arguments in (["--help"], ["map", "check", "cme"], ["navigate", "--rig", "ideal", "--start-angle", "11.25"]):
        times = sorted(seconds(sys.executable, "-m", "mazeplan", *arguments) for _ in range(5))
        rows.append(f"| `mazeplan {' '.join(arguments)}` | {times[2]:.2f} |")
    return rows


def models_sections(quick: bool) -> list[list[str]]:
    """What needs no quiet machine."""
    return [
        measured_section(mazeplan),
        toy_section(mazeplan, quick),
        neural_section(mazeplan, quick),
        predictability_section(quick),
        diagnose_section(quick),
        logged_runs_section(quick),
        plant_section(quick),
        emps_section(quick),
        body_section(quick),
        contact_section(quick),
        baselines_section(quick),
        improve_section(quick),
        learning_section(quick),
        real_section(quick),
        trees_section(quick),
        faults_section(mazeplan, quick),
        pairs_section(quick),
        out_section(quick),
        replay_section(quick),
        camera_section(mazeplan, quick),
    ]


def timed_solver_section(quick: bool) -> list[str]:
    """The solver on a model with 4000 rows a ring, learned from the log of `toy_section`."""
    if quick:
        return solver_section(None, True)
    log, model = ROOT / "build" / "toy.mcap", ROOT / "build" / "toy4000"
    if not log.exists():
        collect_toy(quick)
    command = ["learn", str(log), "-o", str(model), "--most", "4000", "--force"]
    subprocess.run([sys.executable, "-m", "mazeplan", *command], check=True, capture_output=True, cwd=ROOT)
    section = solver_section(model, False)
    return [line.replace(str(model), "build/toy4000") for line in section]


SECTIONS: dict[str, Callable[[bool], list[str]]] = {
    "navigation": navigation_section, "drive": drive_section, "moves": moves_section,
    "tick": lambda quick: tick_section(), "start": lambda quick: start_section(),
    "training": lambda quick: training_section(), "solver": timed_solver_section,
    "measured": lambda quick: measured_section(mazeplan), "toy": lambda quick: toy_section(mazeplan, quick),
    "predictability": predictability_section, "diagnose": diagnose_section, "emps": emps_section,
    "loggedruns": logged_runs_section,
    "plant": lambda quick: plant_section(quick, keep=True),
    "baselines": baselines_section, "improve": improve_section, "effects": effects_section,
    "closedloop": closed_loop_section, "body": body_section,
    "contact": contact_section,
    "contactplant": contactplant_section,  # hours, so only when it is asked for: it is not in `models_sections`
    "neural": lambda quick: neural_section(mazeplan, quick), "learning": learning_section, "real": real_section,
    "camera": lambda quick: camera_section(mazeplan, quick),
    "campaign": campaign_section, "batch": batch_section,
    "trees": trees_section, "waypoints": waypoints_section, "balls": balls_section, "policy": policy_section,
    "view": view_section, "replay": replay_section, "rig": rig_section, "gym": gym_section,
    "faults": lambda quick: faults_section(mazeplan, quick), "pairs": pairs_section, "out": out_section,
    "strange": strange_section, "drawn": drawn_section,  # an hour, so only when it is asked for
    "firmware": firmware_section, "supply": supply_section,
    "growth": growth_section, "realtime": realtime_section, "memory": memory_section,
    "mutants": mutants_section,  # hours as well
}  # fmt: skip


def renew(path: Path, section: list[str]) -> None:
    """Put a section in the place of the one with its heading, and say in the head that it is newer than the rest."""
    kept = path if path.exists() else ROOT / "BENCHMARKS.md"
    lines = kept.read_text().splitlines()
    begin = lines.index(section[0]) if section[0] in lines else len(lines)  # one that is new comes last
    if begin == len(lines):
        lines.append("")
        begin += 1
    end = next((i for i in range(begin + 1, len(lines)) if lines[i].startswith("## ")), len(lines))
    lines[begin:end] = [*section, ""]
    title = f": {section[0].removeprefix('## ')}"
    lines = [line for line in lines if not (line.startswith(AGAIN) and line.endswith(title))]
    first = next(i for i, line in enumerate(lines) if line.startswith("- versions:"))
    lines.insert(first + 1, f"{AGAIN} {datetime.now(UTC):%Y-%m-%d}{title}")
    path.write_text("\n".join(lines).rstrip() + "\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="few runs, to try the script itself")
    parser.add_argument("--parallel", action="store_true", help="models beside navigation; what is timed runs alone")
    parser.add_argument("--only", choices=list(SECTIONS), nargs="+", help="measure these anew, keep the others")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "BENCHMARKS.md")
    options = parser.parse_args()
    if options.only:
        for name in options.only:
            renew(options.output, SECTIONS[name](options.quick))
        print(f"wrote {options.output}")
        return
    head = [
        "# Benchmarks",
        "",
        "Written by `make bench` (tools/bench.py); nothing here is typed by hand.",
        "",
        f"- date: {datetime.now(UTC):%Y-%m-%d}{' (quick)' if options.quick else ''}",
        f"- machine: {cpu()}, Python {platform.python_version()}, {platform.system()}",
        f"- versions: {', '.join(f'{p} {version(p)}' for p in PACKAGES)}",
        "",
    ]
    with ThreadPoolExecutor(1) as beside:
        models = beside.submit(models_sections, options.quick)
        if not options.parallel:
            wait([models])
        sections = [section(options.quick) for section in (navigation_section, drive_section, moves_section)]
        tables = models.result()
    # what is timed runs alone
    sections += [tick_section(), start_section(), training_section(), timed_solver_section(options.quick)]
    sections += [view_section(options.quick), firmware_section(options.quick), rig_section(options.quick)]
    sections += [
        supply_section(options.quick),
        policy_section(options.quick),
        gym_section(options.quick),
        campaign_section(options.quick),
        batch_section(options.quick),
        *tables,
    ]
    if options.parallel:
        head.insert(-1, "- models and navigation were measured at the same time, on two cores; what is timed, alone")
    text = "\n".join(head + [line for section in sections for line in [*section, ""]])
    options.output.write_text(text.rstrip() + "\n")
    print(f"wrote {options.output}")


if __name__ == "__main__":
    main()
