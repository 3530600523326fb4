"""How cost grows with size: the section `growth` of BENCHMARKS.md, and docs/growth.png.

Usage: python tools/bench_growth.py [--quick | ROW ...], such as "map check": measures these rows of BENCHMARKS.md anew.

The exponent p of a row is that of cost ~ size^p between its two largest sizes.
"""

from __future__ import annotations

import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from bench_growth_campaign import measured
from bench_solver import cases, parameters_of

import mazeplan as package
from mazeplan.apps.view.replay.recorded import open_recording
from mazeplan.control.ilqg import IlqgOptions
from mazeplan.control.ring_planner import RingPlanner
from mazeplan.core.logs.run_log import read_log
from mazeplan.learning.gaussian_process import GaussianProcess
from mazeplan.learning.modelfile import load_model
from mazeplan.maze.graph import RouteGraph
from mazeplan.maze.mapfile import check_text, load_map

ROOT = Path(__file__).resolve().parent.parent
RING, SEED = 2, 4000
CHANNEL_MM, WALL_MM, WIDTH_MM, APART_MM = 15.4, 4.0, 14.0, 6.0  # of the mazes that are made here


@dataclass(frozen=True)
class Growth:
    """What is measured: `cost(size)` in ms (memory: MB) at each size; why: the reason where it grows faster than
    linearly."""

    what: str
    unit: str
    sizes: tuple[int, ...]
    cost: Callable[[int], float]
    why: str = ""
    memory: bool = False

    def text(self, cost: float) -> str:
        """A cost with its unit."""
        if self.memory:
            return f"{cost:.0f} MB"
        return f"{cost:.3g} ms" if cost < 1e3 else f"{1e-3 * cost:.3g} s"


def best_ms(act: Callable[[], Any], times: int = 3) -> float:
    """Least wall time of some calls, ms."""
    took = []
    for _ in range(times):
        began = time.perf_counter()
        act()
        took.append(time.perf_counter() - began)
    return 1e3 * min(took)


def with_rows(known: Any, rows: int) -> GaussianProcess:
    """A process with so many rows: those of the toy's, moved a little."""
    rng = np.random.default_rng(SEED)
    assert isinstance(known, GaussianProcess)
    which = rng.integers(len(known), size=rows)
    moved = known.inputs[which] + 0.02 * known.inputs.std(axis=0) * rng.standard_normal((rows, known.inputs.shape[1]))
    return GaussianProcess.mean_only(known.hyper, moved, known.alpha[which] * len(known) / rows)


def tick_ms(rows: int) -> float:
    """Median tick of a run on the toy with processes of so many rows, ms."""
    model = load_model("toy")
    grown = replace(model, processes={ring: with_rows(process, rows) for ring, process in model.processes.items()})
    return package.navigate("ring1", "ring5", rig="toy", model=grown, seed=SEED).tick_ms["p50"]


def plan_ms(rows: int = 2000, horizon: int = 40) -> float:
    """Median time of a cold plan on a process of so many rows, ms."""
    maze, model = load_map("cme"), load_model("toy")
    planner = RingPlanner(
        parameters_of(maze, model, RING), maze.tilt_limit, IlqgOptions(horizon=horizon),
        process=with_rows(model.processes[RING], rows),
    )  # fmt: skip
    planner.warm_up()
    return float(np.median([best_ms(partial(planner.plan, *case), 2) for case in cases(8, SEED)]))


def map_text(rings: int, openings: int) -> str:
    """A maze with so many rings, and openings that are shared out among the walls by their length."""
    inner = [APART_MM + (CHANNEL_MM + WALL_MM) * k for k in range(rings)][::-1]
    channels = [{"inner_radius_mm": round(r, 3), "outer_radius_mm": round(r + CHANNEL_MM, 3)} for r in inner]
    channels[-1]["inner_radius_mm"] = 0
    walls = np.array([ring["inner_radius_mm"] for ring in channels[:-1]])
    room = np.floor(math.tau * walls / (WIDTH_MM + APART_MM)).astype(int)
    share = np.maximum(1, np.minimum(room, np.floor(openings * room / room.sum()).astype(int)))
    places = [
        {"rings": [k + 1, k + 2], "angle_deg": round(360.0 * j / int(n), 6), "width_mm": WIDTH_MM}
        for k, n in enumerate(share)
        for j in range(n)
    ]
    return yaml.safe_dump({
        "name": "grown", "ball": {"radius_mm": 6.35, "mass_g": 8.4}, "tilt_limit_deg": 5, "wall_height_mm": 20,
        "rim_thickness_mm": 5, "rings": channels, "openings": places,
    })  # fmt: skip


def check_ms(rings: int, openings: int) -> float:
    """Time of `map check`, ms, without the start of the program."""
    text = map_text(rings, openings)
    return best_ms(lambda: check_text(text))


def route_ms(rings: int, openings: int) -> float:
    """Time of a route from the outermost ring to the centre, with its graph, ms."""
    found = check_text(map_text(rings, openings))
    assert found.maze is not None, found.errors
    maze = found.maze
    return best_ms(lambda: RouteGraph(maze).route(1, len(maze.rings), 0.3))


class Logs:
    """Logs of `collect --rings` on the toy, by minutes; made when they are asked for."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def of(self, minutes: int) -> Path:
        """The log of so many minutes."""
        path = self._folder / f"{minutes}.mcap"
        if not path.exists():
            mazeplan("collect", "--rig", "toy", "--rings", "--seconds", str(60 * minutes), "-o", str(path))
        return path


def mazeplan(*words: str) -> float:
    """Wall time of a command, ms. Raises CalledProcessError."""
    began = time.perf_counter()
    subprocess.run([sys.executable, "-m", "mazeplan", *words], check=True, capture_output=True, cwd=ROOT)
    return 1e3 * (time.perf_counter() - began)


def growths(folder: Path, quick: bool) -> list[Growth]:
    """Everything that is measured; quick: the smallest sizes."""
    logs = Logs(folder)

    def learned(rows: int) -> float:
        words = ("--most", str(rows), "--force", "-o", str(folder / "model"))
        return mazeplan("learn", str(logs.of(2 if quick else 15)), *words)

    def compared(rows: int) -> float:
        words = ("--most", str(rows), "--kinds", "sp", "--bands", "0", "--ring", str(RING))
        return mazeplan("compare", str(logs.of(2 if quick else 15)), *words)

    def read(minutes: int) -> float:
        log = logs.of(minutes)  # made here, so that this takes no part
        return best_ms(lambda: read_log(log))

    def opened(minutes: int) -> float:
        log = logs.of(minutes)
        return best_ms(lambda: open_recording(log))

    every = [
        Growth("plan", "rows of the Gaussian process", (500, 1000, 2000, 4000, 8000, 16000), lambda n: plan_ms(rows=n)),
        Growth("tick", "rows of the Gaussian process", (500, 1000, 2000, 4000, 8000, 16000), tick_ms),
        Growth("plan", "steps of the horizon", (10, 20, 40, 80, 160), lambda n: plan_ms(horizon=n)),
        Growth("map check", "openings, 30 rings", (100, 200, 500, 1000, 2000), lambda n: check_ms(30, n)),
        Growth("map check", "rings, 3 openings each", (5, 10, 20, 50), lambda n: check_ms(n, 3 * n)),
        Growth(
            "route", "openings, 30 rings", (100, 200, 500, 1000, 2000), lambda n: route_ms(30, n),
            "any two openings of a ring make an edge, as the time of a turn is not the sum of its parts'",
        ),
        Growth(
            "route", "rings, 3 openings each", (5, 10, 20, 50), lambda n: route_ms(n, 3 * n),
            "the search keeps its states in a heap: n log n",
        ),
        Growth("read a log", "minutes", (1, 5, 15, 60), read),
        Growth("open in the page", "minutes", (1, 5, 15, 60), opened),
        Growth("learn", "rows of the Gaussian process", (500, 1000, 2000, 4000), learned),
        Growth("compare", "rows of the Gaussian process", (500, 1000, 2000, 4000), compared),
        Growth(
            "end of a campaign", "runs", (100, 1000, 10_000, 100_000), lambda n: measured(n)[0],
        ),
        Growth(
            "memory at the end of a campaign", "runs", (100, 1000, 10_000, 100_000), lambda n: measured(n)[1],
            memory=True,
        ),
        Growth(
            "diagnose", "minutes", (1, 2, 5, 15, 60),
            lambda n: mazeplan("diagnose", str(logs.of(n)), "--model", "toy", "--json"),
        ),
    ]  # fmt: skip
    return [replace(growth, sizes=growth.sizes[:2]) for growth in every] if quick else every


def exponent(sizes: Sequence[int], ms: Sequence[float]) -> float:
    """p of cost ~ size^p between the two largest sizes."""
    return math.log(ms[-1] / ms[-2]) / math.log(sizes[-1] / sizes[-2])


def row(growth: Growth, cost: Sequence[float]) -> str:
    """A row of the table, in Markdown."""
    costs = ", ".join(f"{size}: {growth.text(ms)}" for size, ms in zip(growth.sizes, cost, strict=True))
    head = f"| {growth.what} | {growth.unit} | "
    return f"{head}{costs} | {exponent(growth.sizes, cost):.2f} | {growth.why or '-'} |"


def measure_again(names: Sequence[str]) -> None:
    """Measure the rows of these names (first column) anew, and replace them in BENCHMARKS.md."""
    path = ROOT / "BENCHMARKS.md"
    with tempfile.TemporaryDirectory() as place:
        for growth in (g for g in growths(Path(place), False) if g.what in names):
            new, head = row(growth, [growth.cost(size) for size in growth.sizes]), f"| {growth.what} | {growth.unit} | "
            lines = [new if line.startswith(head) else line for line in path.read_text().splitlines()]
            path.write_text("\n".join(lines) + "\n")
            print(new)


def growth_section(quick: bool) -> list[str]:
    """Everything, as lines of Markdown; draws docs/growth.png unless quick."""
    with tempfile.TemporaryDirectory() as place:
        found = [(growth, [growth.cost(size) for size in growth.sizes]) for growth in growths(Path(place), quick)]
    if not quick:
        draw(found, ROOT / "docs" / "growth.png")
    rows = [row(growth, cost) for growth, cost in found]
    return [
        "## How cost grows",
        "",
        "`tools/bench_growth.py`, one core, wall time. The exponent p is that of cost ~ size^p between the two largest "
        "sizes: 1 is linear. It differs by about 0.15 from one measurement to the next.",
        "",
        "| what | size | size: time | exponent | why |",
        "|---|---|---|---|---|",
        *rows,
    ]


def draw(found: Sequence[tuple[Growth, list[float]]], path: Path) -> None:
    """A picture: time over size, both relative to the smallest size, on logarithmic axes."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(9.0, 5.0), layout="constrained")
    for (growth, ms), mark in zip(found, "osv^D<>Px*hpd1", strict=False):
        sizes = np.array(growth.sizes) / growth.sizes[0]
        axes.loglog(sizes, np.array(ms) / ms[0], marker=mark, label=f"{growth.what}, by {growth.unit}")
    most = max(growth.sizes[-1] / growth.sizes[0] for growth, _ in found)
    axes.loglog([1.0, most], [1.0, most], color="0.6", linestyle="--", label="linear")
    axes.set(xlabel="size, times the smallest", ylabel="time or memory, times that of the smallest")
    axes.grid(visible=True, which="both", alpha=0.2)
    axes.legend(fontsize=8)
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    if names := [word for word in sys.argv[1:] if word != "--quick"]:
        measure_again(names)
    else:
        print("\n".join(growth_section("--quick" in sys.argv)))
