"""A ball with a body against the bead on a circle: what records with contact tell, and who predicts them better.

Usage: python tools/bench_body.py [--quick]. Records of others' rigs with contact are taken from MAZEPLAN_DATA or beside
the checkout, and left out where there are none. Used by tools/bench.py.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from bench_learning import accelerations

from mazeplan.collect import Collection, run_collection
from mazeplan.data.table import Table, read_table
from mazeplan.diagnosis.bodyrecord import BodySeen, body_filter, body_seen
from mazeplan.maths.angles import difference
from mazeplan.maze.mapfile import load_map
from mazeplan.models.ball import BallModel
from mazeplan.models.modelfile import RigModel, load_model
from mazeplan.models.rig_learning import SMOOTHING
from mazeplan.models.rollout import STEPS, choose_windows, roll_out
from mazeplan.models.samples import RingSamples, SampleOptions, ring_samples
from mazeplan.models.start import angle_noise, causal_start
from mazeplan.physics.arrays import RingKinematics
from mazeplan.records import Array, IntArray
from mazeplan.rigs.registry import make_rig

ROOT = Path(__file__).resolve().parent.parent
MAZE = load_map("cme")
RECORDS = ("null-1", "null-2", "null-3", "friction", "tilt", "late", "drops-friction")
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


def bead_errors(model: RigModel, windows: Windows, process: bool) -> dict[int, Array]:
    """Mean error (3,) of the angle, rad, AHEAD samples on, by ring; process: with what a process adds."""
    out = {}
    for ring, (s, start) in windows.rings.items():

        def accelerate(k: RingKinematics, ring: int = ring) -> Array:
            return accelerations(model, ring, k) if process else BallModel(model.ball(ring).effects).acceleration(k)

        rows = np.flatnonzero(s.good)
        misfit = float(np.sqrt(np.nanmean((s.theta_ddot[rows] - accelerate(s.at(rows))) ** 2)))
        theta, rate = causal_start(accelerate, s, start, angle_noise(s), misfit)
        done = roll_out(accelerate, s, start, theta, rate)
        out[ring] = np.nanmean(done.error[:, AHEAD], axis=0)  # a start beside a lost picture is none
    return out


def body_errors(seen: BodySeen, windows: Windows) -> dict[int, Array]:
    """The same of a ball with a body, whose numbers were found in another record."""
    body, _ = body_filter(windows.table, MAZE)
    state = body.run(seen.fit.model).state
    out = {}
    for ring, (s, start) in windows.rings.items():
        rows = s.row[start]
        rolled = body.rolled_out(seen.fit.model, state, rows, STEPS)
        angle = np.arctan2(rolled[..., 1], rolled[..., 0])
        measured = s.measured[start[:, None] + np.arange(STEPS + 1)]
        out[ring] = np.array([float(np.nanmean(np.abs(difference(angle[:, n], measured[:, n])))) for n in AHEAD])
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
    seen = body_seen(read_table(path), MAZE, model)
    took, fit = time.perf_counter() - began, seen.fit

    def told(name: str, factor: float, digits: int) -> str:
        return f"{factor * fit.value(name):.{digits}f} ± {factor * fit.stderr[name]:.{digits}f}"

    cells = [path.stem, f"{seen.pictures}", f"{1e3 * fit.value('noise'):.2f}", f"{1e3 * fit.value('plane') ** 0.5:.1f}"]
    cells += [", ".join(f"{a:.3f}" for a in seen.memory), told("rolling", 1.0, 3), told("wall", 1.0, 3)]
    cells += [told("tilt_beta", 57.3, 2), told("tilt_gamma", 57.3, 2), told("delay", 1e3, 1), f"{took:.0f}"]
    return f"| {' | '.join(cells)} |"


def ahead_rows(name: str, errors: dict[str, dict[int, Array]]) -> list[str]:
    """A line for each way to predict."""
    rows = []
    for way, by_ring in errors.items():
        cells = (f"{e[0]:.3f} / {e[1]:.3f} / {e[2]:.3f}" for e in by_ring.values())
        rows.append(f"| {name} | {way} | {' | '.join(cells)} |")
    return rows


def speed_lines(seen: BodySeen) -> list[str]:
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


def _seconds(work: object) -> float:
    began = time.perf_counter()
    work()  # type: ignore[operator]
    return time.perf_counter() - began


def body_section(quick: bool) -> list[str]:
    """Everything, as lines of Markdown."""
    folder, rows, ahead = contact_folder(), [], []
    if folder is not None:
        model = load_model(folder / "model")
        for name in RECORDS[: 1 if quick else None]:
            rows.append(record_row(folder / f"{name}.csv", model))
            print(rows[-1], file=sys.stderr, flush=True)
        seen = body_seen(read_table(folder / ("null-2.csv" if quick else "reference.csv")), MAZE, model)
        windows = windows_of(read_table(folder / "null-1.csv"), model.camera_delay)
        ahead += ahead_rows("A", {"bead": bead_errors(model, windows, False), "body": body_errors(seen, windows)})
    toy = load_model("toy")
    seen = body_seen(collected(60.0 if quick else 600.0, 1), MAZE, toy)
    windows = windows_of(collected(40.0 if quick else 300.0, 2), toy.camera_delay)
    ways = {"bead": bead_errors(toy, windows, False), "bead and process": bead_errors(toy, windows, True)}
    ahead += ahead_rows("toy (simulated)", {**ways, "body": body_errors(seen, windows)})
    return [
        "## A ball with a body",
        "",
        "`mazeplan diagnose LOG --body`: a filter whose state is place, velocity and spin, with walls, fitted to a "
        "whole record, all rings at once.",
        "Records of a rig with contact that others simulated (camera noise, friction x3 in `friction`, table moved by "
        "0.5 deg in `tilt`, camera",
        "60 ms later in `late`, 15 % of the pictures lost in `drops-friction`). Memory: autocorrelation of whitened "
        "innovations after 1, 2, 3 pictures.",
        "",
        *_record_table(rows),
        "",
        f"Mean error of the angle (rad) {', '.join(map(str, AHEAD[:-1]))} and {AHEAD[-1]} samples ahead, from a causal "
        "start, on a record that no model has seen. Bead: the effects of",
        "the rig's model along each ring; process: what its Gaussian process adds; body: fitted to another record.",
        "",
        "| rig | model | ring 1 | ring 2 | ring 3 | ring 4 |", "|---" * 6 + "|", *ahead,
        "",
        *speed_lines(seen),
    ]  # fmt: skip


def _record_table(rows: list[str]) -> list[str]:
    if not rows:
        return ["(no such records here)"]
    head = (
        "| record | pictures | camera noise, mm | unexplained, mm s^-1.5 | memory | rolling friction, m/s² | at walls "
    )
    return [f"{head}| table beta, deg | gamma, deg | camera delay, ms | s |", "|---" * 11 + "|", *rows]


if __name__ == "__main__":
    print("\n".join(body_section("--quick" in sys.argv)))
