"""Section `growth`: how cost grows with size. Exponent: p of cost ~ size^p between the two largest sizes."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from bench_kit import Section, Table, execute
from grown_maps import map_text

import mazeplan as package
from mazeplan.control.ilqg import IlqgOptions
from mazeplan.control.ring_planner import RingPlanner
from mazeplan.core.logs.run_log_reader import read_log
from mazeplan.learning.gaussian_process import GaussianProcess
from mazeplan.learning.modelfile import load_model
from mazeplan.maze.graph import RouteGraph
from mazeplan.maze.mapfile import check_text, load_map

RING, SEED = 2, 4000
SPREAD = np.array([0.3, 0.01, 0.05, 0.01, 0.05])  # of start rates and tilts: rad/s, then rad, rad/s for either axis


def best_ms(act: Callable[[], Any], times: int = 3) -> float:
    """Least wall time of some calls, ms."""
    took = []
    for _ in range(times):
        began = time.perf_counter()
        act()
        took.append(time.perf_counter() - began)
    return 1e3 * min(took)


def with_rows(known: GaussianProcess, rows: int) -> GaussianProcess:
    """A Gaussian process with so many rows: those of a known one, moved a little."""
    rng = np.random.default_rng(SEED)
    which = rng.integers(len(known), size=rows)
    moved = known.inputs[which] + 0.02 * known.inputs.std(axis=0) * rng.standard_normal((rows, known.inputs.shape[1]))
    return replace(known, inputs=moved, features=np.zeros((rows, 0)), alpha=known.alpha[which] * len(known) / rows)


def tick_ms(rows: int) -> float:
    """Median tick of a run on the toy with Gaussian processes of so many rows, ms."""
    model = load_model("toy")
    grown = replace(model, processes={ring: with_rows(process, rows) for ring, process in model.processes.items()})  # pyright: ignore
    return package.navigate("ring1", "ring5", rig="toy", model=grown, seed=SEED).tick_ms["p50"]


def plan_ms(rows: int = 2000, horizon: int = 40) -> float:
    """Median time of a cold plan of pi/4 on a Gaussian process of so many rows, ms."""
    maze, model, rng = load_map("cme"), load_model("toy"), np.random.default_rng(SEED)
    parameters, process = model.ring_parameters(RING, maze.ring(RING).track_radius), model.processes[RING]
    options = IlqgOptions(horizon=horizon)
    planner = RingPlanner(parameters, maze.tilt_limit, options, process=with_rows(process, rows))  # pyright: ignore
    planner.warm_up()
    took = []
    for _ in range(8):
        theta = rng.uniform(-math.pi, math.pi)
        start = np.array([theta, *(SPREAD * rng.standard_normal(5))])
        took.append(best_ms(partial(planner.plan, start, theta + math.pi / 4 * float(rng.choice((-1.0, 1.0)))), 2))
    return float(np.median(took))


def check_ms(rings: int, openings: int) -> float:
    """Time of `map check`, ms, without the start of the program."""
    text = map_text(rings, openings)
    return best_ms(lambda: check_text(text))


def route_ms(rings: int, openings: int) -> float:
    """Time of a route from the outermost ring to the centre, with its graph, ms."""
    maze: Any = check_text(map_text(rings, openings)).maze
    return best_ms(lambda: RouteGraph(maze).route(1, len(maze.rings), 0.3))


def growth_section(quick: bool) -> Section:
    """A row for each cost; quick: the two smallest sizes."""
    table = Table(("what", "size", "size: time", "exponent"))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)

        def log(minutes: int) -> str:
            path = folder / f"{minutes}.mcap"
            if not path.exists():
                execute("collect", "--rig", "toy", "--rings", "--seconds", str(60 * minutes), "-o", str(path))
            return str(path)

        def learn_ms(rows: int) -> float:
            words = ("learn", learned, "--most", str(rows), "--force", "-o", str(folder / "model"))
            return best_ms(partial(execute, *words), 1)

        def diagnose_ms(minutes: int) -> float:
            return best_ms(partial(execute, "diagnose", log(minutes), "--model", "toy"), 1)

        def row(what: str, unit: str, cost: Callable[[int], float], *sizes: int) -> None:
            sizes = sizes[:2] if quick else sizes
            ms = [cost(size) for size in sizes]
            texts = (f"{x:.3g} ms" if x < 1e3 else f"{1e-3 * x:.3g} s" for x in ms)
            power = math.log(ms[-1] / ms[-2]) / math.log(sizes[-1] / sizes[-2])
            table.add(what, unit, ", ".join(map(": ".join, zip(map(str, sizes), texts, strict=True))), f"{power:.2f}")

        learned = log(1 if quick else 15)
        row("plan", "rows of the Gaussian process", plan_ms, 500, 1000, 2000, 4000, 8000, 16000)
        row("tick", "rows of the Gaussian process", tick_ms, 500, 1000, 2000, 4000, 8000, 16000)
        row("plan", "steps of the horizon", lambda n: plan_ms(horizon=n), 10, 20, 40, 80, 160)
        row("map check", "openings, 30 rings", lambda n: check_ms(30, n), 100, 200, 500, 1000, 2000)
        row("route", "openings, 30 rings", lambda n: route_ms(30, n), 100, 200, 500, 1000, 2000)
        row("read a log", "minutes", lambda n: best_ms(partial(read_log, log(n))), 1, 5, 15, 60)
        row("learn", "rows of the Gaussian process", learn_ms, 500, 1000, 2000, 4000)
        row("diagnose", "minutes", diagnose_ms, 1, 2, 5, 15, 60)
    notes = ("One core, wall time. The exponent differs by about 0.15 from one measurement to the next.",)
    return Section("How cost grows", notes, (table,))
