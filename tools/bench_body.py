"""A ball with a body against the bead on a circle: what records with contact tell, and who predicts them better.

Usage: python tools/bench_body.py [--quick]. Records of others' rigs with contact are taken from MAZEPLAN_DATA or beside
the checkout, and left out where there are none. Used by tools/bench.py.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from bench_drive import runs_on
from bench_learning import accelerations
from random_rigs import packaged_model

from mazeplan.control.estimation.estimator import Estimator
from mazeplan.control.estimation.rigid_body_estimator import BodyEstimator
from mazeplan.control.estimation.rigid_body_fit import DEFAULT_FREE
from mazeplan.control.estimation.rigid_body_parameters import body_of
from mazeplan.core.logs.table import Table, read_table
from mazeplan.core.maths.angles import difference
from mazeplan.core.records import Array, Command, IntArray, Observation, State
from mazeplan.diagnosis.rig.record import RigRecord, body_filter, rig_record
from mazeplan.learning.identification import fit_rig
from mazeplan.learning.modelfile import RigModel, load_model
from mazeplan.learning.rig_gp import SMOOTHING
from mazeplan.learning.rollout import STEPS, angle_noise, causal_start, choose_windows, roll_out
from mazeplan.learning.samples import RingSamples, SampleOptions, ring_samples
from mazeplan.maze.mapfile import load_map
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.formulas.arrays import RingKinematics
from mazeplan.rigs.registry import make_rig
from mazeplan.rigs.sim.simulated import SimulatedRig
from mazeplan.run.campaign.evaluate import start_angle
from mazeplan.run.collect import Collection, run_collection
from mazeplan.run.execution import run_job
from mazeplan.run.settings import load_settings
from mazeplan.run.specification import Job, Setup

ROOT = Path(__file__).resolve().parent.parent
MAZE = load_map("cme")
RECORDS = ("null-1", "null-2", "null-3", "friction", "tilt", "late", "drops-friction")
FREE = (*DEFAULT_FREE, "gain_beta", "gain_gamma", "cross_beta", "cross_gamma")
COMMANDS = ("u_beta", "u_gamma")
SEED = 1000  # of the first navigation; settings and models were chosen on others
AHEAD = (2, 20, 40)  # samples: the delay of the toy's camera, and those of `compare`


@dataclass(frozen=True)
class Windows:
    """Windows of a record by ring: samples, and rows at which a window of STEPS samples begins."""

    table: Table
    rings: dict[int, tuple[RingSamples, IntArray]]


def contact_folder() -> Path | None:
    """Where records with contact are."""
    for folder in (os.environ.get("MAZEPLAN_DATA"), ROOT.parent / "shared" / "data"):
        if folder is not None and (Path(folder) / "contact" / "A").is_dir():
            return Path(folder) / "contact" / "A"
    return None


def windows_of(table: Table, delay: float) -> Windows:
    """Evenly spaced windows."""
    samples = ring_samples(table, MAZE, SMOOTHING, SampleOptions(delay=delay, recompute=True))
    found = {ring: (s, choose_windows(s, np.ones(len(s), dtype=bool)).start) for ring, s in samples.items()}
    return Windows(table, {ring: one for ring, one in found.items() if len(one[1]) >= 10 and ring < 5})


def bead_errors(
    model: RigModel, windows: Windows, process: bool = False, state: Array | None = None
) -> dict[int, Array]:
    """Mean error (3,) of the angle, rad, AHEAD samples on, by ring; process: with what a process adds; state (N, 5): of
    a body, by which it begins."""
    out = {}
    for ring, (s, start) in windows.rings.items():

        def accelerate(k: RingKinematics, ring: int = ring) -> Array:
            return accelerations(model, ring, k) if process else BallModel(model.ball(ring).effects).acceleration(k)

        rows = np.flatnonzero(s.good)
        misfit = float(np.sqrt(np.nanmean((s.theta_ddot[rows] - accelerate(s.at(rows))) ** 2)))
        theta, rate, _ = causal_start(accelerate, s, start, angle_noise(s), misfit)
        if state is not None:
            x, y, vx, vy, _ = state[s.row[start]].T
            theta = s.measured[start] + difference(np.arctan2(y, x), s.measured[start])
            rate = (x * vy - y * vx) / (x * x + y * y)
        done = roll_out(accelerate, s, start, theta, rate)
        out[ring] = np.nanmean(done.error[:, AHEAD], axis=0)  # a start beside a lost picture is none
    return out


def body_errors(seen: RigRecord, windows: Windows, commands: bool = True) -> dict[int, Array]:
    """The same of a ball with a body, whose numbers were found in another record; commands: the plate moves by them
    through the stage, else by the tilt sensor, as for the bead."""
    columns = {name: c for name, c in windows.table.columns.items() if commands or name not in COMMANDS}
    body, _ = body_filter(Table(columns, windows.table.source), MAZE)
    state = body.run(seen.fit.model).state
    out = {}
    for ring, (s, start) in windows.rings.items():
        rows = s.row[start]
        rolled = body.rolled_out(seen.fit.model, state, rows, STEPS)
        angle = np.arctan2(rolled[..., 1], rolled[..., 0])
        there = s.k.theta[start[:, None] + np.arange(STEPS + 1)]  # smoothed, as for the bead
        out[ring] = np.array([float(np.nanmean(np.abs(difference(angle[:, n], there[:, n])))) for n in AHEAD])
    return out


def collected(seconds: float, seed: int) -> Table:
    """A record of the toy."""
    with tempfile.TemporaryDirectory() as folder:
        log, rig = Path(folder) / "toy.mcap", make_rig("toy", MAZE)
        run_collection(rig, MAZE, Collection(seconds, (1, 2, 3, 4), seed, None, 1.5), log, rig_name="toy")
        return read_table(log)


def record_row(path: Path, model: RigModel) -> str:
    """What a record tells."""
    began = time.perf_counter()
    seen = rig_record(read_table(path), MAZE, model, free=FREE)
    took, fit = time.perf_counter() - began, seen.fit

    def told(name: str, factor: float, digits: int) -> str:
        return f"{factor * fit.value(name):.{digits}f} ± {factor * fit.stderr[name]:.{digits}f}"

    cells = [path.stem, f"{seen.pictures}", told("noise", 1e3, 3), f"{1e3 * fit.value('plane') ** 0.5:.1f}"]
    cells += [", ".join(f"{a:.3f}" for a in seen.memory), told("rolling", 1.0, 4), told("wall", 1.0, 3)]
    cells += [told(name, 57.2958, 3) for name in ("tilt_beta", "tilt_gamma")]
    cells += [told(name, 1.0, 4) for name in FREE[-4:]]
    cells += [told("delay", 1e3, 1), f"{took:.0f}"]
    return f"| {' | '.join(cells)} |"


def ahead_rows(name: str, errors: dict[str, dict[int, Array]]) -> list[str]:
    """A line for each way to predict."""
    rows = []
    for way, by_ring in errors.items():
        cells = (f"{e[0]:.3f} / {e[1]:.3f} / {e[2]:.3f}" for e in by_ring.values())
        rows.append(f"| {name} | {way} | {' | '.join(cells)} |")
    return rows


class Shadowed:
    """A simulated rig whose true state is compared with what both estimators believe, while one navigates."""

    def __init__(self, rig: SimulatedRig, model: RigModel) -> None:
        body, options = body_of(model), load_settings().estimator
        assert body is not None
        self._rig, self.rate_hz, self.maze = rig, rig.rate_hz, rig.maze
        self.both = (Estimator(MAZE, model, options), BodyEstimator(MAZE, model, body, options))
        self.errors: list[list[tuple[float, float]]] = []  # by sample and estimator: place, m; velocity, m/s
        self.seconds: list[tuple[float, ...]] = []
        self._t = 0.0

    def reset(self, *, ring: int, theta: float, rng: np.random.Generator) -> None:
        self._rig.reset(ring=ring, theta=theta, rng=rng)

    def observe(self) -> Observation:
        seen = self._rig.observe()
        self._t, true, states, times = seen.t, self._rig.truth(), list[State](), list[float]()
        for estimator in self.both:
            began = time.perf_counter()
            states.append(estimator.update(seen))
            times.append(time.perf_counter() - began)
        there = true[:2] + self.both[0].dead_time * true[3:5]
        off = ((s.x - there[0], s.y - there[1], s.vx - true[3], s.vy - true[4]) for s in states)
        self.errors.append([(float(np.hypot(a, b)), float(np.hypot(c, d))) for a, b, c, d in off])
        self.seconds.append(tuple(times))
        return seen

    def command(self, u_beta: float, u_gamma: float) -> None:
        self._rig.command(u_beta, u_gamma)
        for estimator in self.both:
            estimator.sent(Command(u_beta, u_gamma), self._t)

    def level(self) -> None:
        self._rig.level()

    def close(self) -> None:
        self._rig.close()


def now_rows(rig: str, runs: int) -> list[str]:
    """Errors of both estimators at the moment of the next command, in the same navigations."""
    errors, seconds, model = [], [], packaged_model(rig)
    for i in range(runs):
        inner = make_rig(rig, MAZE)
        assert isinstance(inner, SimulatedRig)
        shadowed = Shadowed(inner, model)
        machine: Any = shadowed  # a rig but for how it is made
        run_job(machine, Setup(MAZE, model, rig_name=rig), Job(1, 5, start_angle(i), SEED + i, 20.0))
        errors.append(np.array(shadowed.errors))
        seconds.append(np.array(shadowed.seconds))
        shadowed.close()
    all_, took = np.concatenate(errors), 1e6 * np.median(np.concatenate(seconds), axis=0)
    rows = []
    for i, name in enumerate(("bead", "body")):
        (p50, v50), (p95, v95) = 1e3 * np.quantile(all_[:, i], [0.5, 0.95], axis=0)
        rows.append(f"| {rig} | {name} | {p50:.2f} | {p95:.2f} | {v50:.1f} | {v95:.1f} | {took[i]:.0f} |")
    return rows


def drive_rows(rig: str, runs: int) -> list[str]:
    """Navigations with and without the body, from the same starts with the same seeds."""
    with_, times, rows = packaged_model(rig), [], []
    for name, model in (("bead", replace(with_, body=None)), ("body", with_)):
        done = runs_on(rig, runs, model=model, seed=SEED)
        t = np.array([o.time_s if o.success else np.nan for o in done])
        late, worst = np.nanpercentile(t, 95), np.nanmax(t)
        failures = sum(len(o.failures) for o in done)
        times.append(t)
        cells = f"{np.isfinite(t).sum()}/{runs} | {np.nanmean(t):.3f} | {late:.2f} | {worst:.2f} | {failures}"
        rows.append(f"| {rig} | {name} | {cells} |")
    change = times[1] - times[0]
    rows[1] = f"{rows[1]} {np.nanmean(change):+.3f} ± {np.nanstd(change) / runs**0.5:.3f} |"
    rows[0] += " |"
    return rows


def speed_lines(seen: RigRecord) -> list[str]:
    """What a picture and a predicted sample cost."""
    body, model = seen.body, seen.fit.model
    body.run(model)
    filtered = min(_seconds(lambda: body.run(model)) for _ in range(5)) / len(body.pictures)
    rows, states = np.arange(200, 1200), body.run(model).state
    body.rolled_out(model, states, rows[:2], STEPS)
    rolled = _seconds(lambda: body.rolled_out(model, states, rows, STEPS)) / (len(rows) * STEPS)
    return [
        f"One thread: {1e6 * filtered:.1f} µs a picture for the filter, {1e6 * rolled:.2f} µs for a sample of a "
        "roll-out (five sub-steps each)."
    ]


def _seconds(work: Callable[[], object]) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def contact_rows(folder: Path, quick: bool) -> tuple[list[str], list[str]]:
    """What records tell; errors ahead, of models that were fitted to one record, in another one."""
    known, rows = load_model(folder / "model"), []
    for name in RECORDS[: 1 if quick else None]:
        rows.append(record_row(folder / f"{name}.csv", known))
        print(rows[-1], file=sys.stderr, flush=True)
    past = read_table(folder / ("null-2.csv" if quick else "reference.csv"))
    seen, bead = rig_record(past, MAZE, known), fit_rig(past, MAZE).model
    windows = windows_of(read_table(folder / "null-1.csv"), bead.camera_delay)
    state = body_filter(windows.table, MAZE)[0].run(seen.fit.model).state
    return rows, ahead_rows("A", {
        "bead": bead_errors(bead, windows),
        "bead, begun by the body's filter": bead_errors(bead, windows, state=state),
        "body, tilt by the sensor": body_errors(seen, windows, commands=False),
        "body": body_errors(seen, windows),
    })  # fmt: skip


def toy_rows(quick: bool) -> tuple[list[str], RigRecord]:
    """The same of the toy, with the process of its packaged model."""
    toy = load_model("toy")
    seen = rig_record(collected(60.0 if quick else 600.0, 1), MAZE, toy)
    windows = windows_of(collected(40.0 if quick else 300.0, 2), toy.camera_delay)
    ways = {"bead": bead_errors(toy, windows), "bead and process": bead_errors(toy, windows, True)}
    return ahead_rows("toy (simulated)", {**ways, "body": body_errors(seen, windows)}), seen


def body_section(quick: bool) -> list[str]:
    """Everything, as lines of Markdown."""
    folder = contact_folder()
    records, ahead = ([], []) if folder is None else contact_rows(folder, quick)
    more, seen = toy_rows(quick)
    runs = 4 if quick else 100
    return [
        "## A ball with a body",
        "",
        "`mazeplan diagnose LOG --body`: a filter whose state is place, velocity and spin, with walls, fitted to a",
        "whole record, all rings at once. Records of a rig with contact that others simulated: friction three times as",
        "large in `friction`, the table moved by 0.5 deg in `tilt`, the camera 60 ms later in `late`, 15 % of the",
        "pictures lost and friction three times as large in `drops-friction`. Memory: autocorrelation of whitened",
        "innovations after 1, 2, 3 pictures. Gain: true tilt over measured; coupling: what the fitted stage leaves.",
        "",
        *_record_table(records),
        "",
        f"Mean error of the angle (rad) {', '.join(map(str, AHEAD[:-1]))} and {AHEAD[-1]} samples ahead, by a causal",
        "start, in a record that no model has seen; the tilt is known. Bead: effects along each ring, and what its",
        "Gaussian process adds; body and bead of A were fitted to the same record.",
        "",
        "| rig | model | ring 1 | ring 2 | ring 3 | ring 4 |", "|---" * 6 + "|", *ahead, *more,
        "",
        *speed_lines(seen),
        "",
        f"At the moment of the next command, in {runs // 4} navigations of the packaged rig, against the simulator's",
        "truth; seeds from 1000 on:",
        "",
        "| rig | estimator | place off, median mm | 95 % | velocity off, median mm/s | 95 % | a sample, µs |",
        "|---" * 7 + "|", *(row for rig in ("toy", "rough") for row in now_rows(rig, runs // 4)),
        "",
        f"The same {runs} starts with either, and the change by pairs:",
        "",
        "| rig | estimator | arrived | mean s | 95 % | worst | failures on the way | change, s |",
        "|---" * 8 + "|", *(row for rig in ("toy", "rough") for row in drive_rows(rig, runs)),
    ]  # fmt: skip


def _record_table(rows: list[str]) -> list[str]:
    if not rows:
        return ["The records are not on this machine."]
    head = (
        "| record | pictures | camera noise, mm | unexplained, mm s^-1.5 | memory | rolling friction, m/s² | at walls "
    )
    table = "| table beta, deg | gamma, deg | gain beta | gain gamma | gamma in beta | beta in gamma "
    return [f"{head}{table}| camera delay, ms | s |", "|---" * 15 + "|", *rows]


if __name__ == "__main__":
    print("\n".join(body_section("--quick" in sys.argv)))
