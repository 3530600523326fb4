"""Campaigns: what two workers bring, what Dask costs, and what a killed worker takes with it. Used by tools/bench.py.

    python tools/bench_campaign.py [--quick] [--runs 1000]

One worker (in this process), two processes and two workers of Dask do the same runs in turn, a block each, another one
of them first each time, so that whatever else the machine is doing slows all of them. All are warm before the first
block; what that takes stands apart.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from mazeplan.core.records import NavigationResult
from mazeplan.run.campaign.evaluate import Campaign, do_run
from mazeplan.run.campaign.executor import Executor, Lost, open_executor
from mazeplan.run.campaign.one_run import Ran
from mazeplan.run.campaign.store import open_store
from mazeplan.run.campaign.user_files import Parcel

BLOCK, RUNS = 100, 1000
QUICK_BLOCK, QUICK_RUNS = 8, 16
EMPTY = 500  # tasks that do nothing
TWICE, DASK_COST = 1.8, 5.0  # what is asked for; %
TOY = Campaign(RUNS, "toy", deadline=False, own_process=True)
ONE, TWO, DASK = "one worker", "two processes", "two workers of Dask"


@dataclass
class Way:
    """One way to do the runs: s until it was warm, s of each block; of each run s by the clock, s of the processor's
    time, and the result."""

    executor: Executor
    warm: float = 0.0
    blocks: list[float] = field(default_factory=list)
    walls: list[float] = field(default_factory=list)
    cpus: list[float] = field(default_factory=list)
    results: dict[int, dict] = field(default_factory=dict)


def campaign_section(quick: bool, runs: int | None = None) -> list[str]:
    """Everything, as lines of Markdown."""
    size = QUICK_BLOCK if quick else BLOCK
    count = runs or (QUICK_RUNS if quick else RUNS)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        ways: dict[str, Way] = {}
        for name, asked in ((ONE, (1, None)), (TWO, (2, None)), (DASK, (2, "local"))):
            ways[name] = _warm(stack, *asked)
            print(f"{name}: warm after {ways[name].warm:.1f} s", file=sys.stderr, flush=True)
        for first in range(0, count, size):
            turn = first // size % len(ways)
            for name, way in [*ways.items()][turn:] + [*ways.items()][:turn]:
                _block(way, range(first, min(first + size, count)), folder / name)
                print(f"{name}: {first + size} runs, {way.blocks[-1]:.1f} s", file=sys.stderr, flush=True)
        empty = {name: _empty(ways[name].executor) for name in (TWO, DASK)}
        killed = [_killed(name, ways[name], min(count, 2 * size)) for name in (TWO, DASK)]
    return [*_head(count, size), *_table(ways), "", *_said(ways, empty), "", *killed]


def _warm(stack: ExitStack, workers: int, dask: str | None) -> Way:
    """A way whose workers have all done a run."""
    began = time.perf_counter()
    way = Way(stack.enter_context(open_executor(workers, dask)))
    seen: set[str] = set()
    while len(seen) < workers:
        tasks = [(Parcel(), TOY, index) for index in range(2 * workers)]
        seen |= {ran.host for _, ran in way.executor.each(do_run, tasks) if isinstance(ran, Ran)}
    way.warm = time.perf_counter() - began
    return way


def _block(way: Way, which: range, folder: Path) -> None:
    """Some runs, kept as `evaluate --store` keeps them."""
    with open_store(folder, TOY) as store:
        began = time.perf_counter()
        shared = way.executor.share(Parcel())
        for k, ran in way.executor.each(do_run, [(shared, TOY, index) for index in which]):
            assert isinstance(ran, Ran)
            store.keep(which[k], ran)
            way.walls.append(ran.wall_s)
            way.cpus.append(ran.cpu_s)
            way.results[which[k]] = _same(ran.result)
        way.blocks.append(time.perf_counter() - began)


def _same(result: NavigationResult) -> dict:
    """All but what the clock on the wall says."""
    return replace(result, planner_ms={}, tick_ms={}).to_json()


def _empty(executor: Executor) -> float:
    """What a task costs that does nothing, s."""
    list(executor.each(_nothing, [(0,)] * 20))
    began = time.perf_counter()
    list(executor.each(_nothing, [(index,) for index in range(EMPTY)]))
    return (time.perf_counter() - began) / EMPTY


def _nothing(index: int) -> int:
    return index


def _killed(name: str, way: Way, count: int) -> str:
    """A line about a campaign of which a worker is killed after a fourth of the runs."""
    found: dict[int, dict] = {}
    began, victim = time.perf_counter(), 0
    for index, ran in way.executor.each(do_run, [(Parcel(), TOY, index) for index in range(count)]):
        if isinstance(ran, Lost):
            continue
        found[index] = _same(ran.result)
        if len(found) == max(2, count // 4):
            victim = int(ran.host.rpartition(":")[2])
            os.kill(victim, signal.SIGKILL)
    same = sum(found.get(index) == way.results[index] for index in range(count))
    seconds = time.perf_counter() - began
    told = f"{same} of {count} results are there and the same, in {seconds:.0f} s"
    return f"- {name}, one killed (-9) after a fourth of the runs: {told}"


def _head(count: int, size: int) -> list[str]:
    return [
        "## Campaigns",
        "",
        f"`python tools/bench_campaign.py --runs {count}`: runs on `toy` without deadlines of the planner, each kept",
        f"in a folder as it ends; three ways in turn, {size} runs at a time, so that they are slowed alike by what",
        "else the machine does. All workers have done a run before the first block. Busy: share of the workers' time",
        "that is spent in runs; the rest is what client, pipes and scheduler take, and, at each block's end, waiting",
        "for the last run.",
        "",
    ]


def _table(ways: dict[str, Way]) -> list[str]:
    rows = [
        "| way | until warm, s | runs | s | runs a second | busy | a run, median s | of it processor, s |",
        "|---" * 8 + "|",
    ]
    for name, way in ways.items():
        workers, seconds = 1 if name == ONE else 2, sum(way.blocks)
        busy = sum(way.walls) / (workers * seconds)
        rows.append(
            f"| {name} | {way.warm:.1f} | {len(way.walls)} | {seconds:.1f} | {len(way.walls) / seconds:.3f} | "
            f"{100.0 * busy:.1f} % | {np.median(way.walls):.3f} | "
            f"{np.median(way.cpus):.3f} |"
        )
    return rows


def _said(ways: dict[str, Way], empty: dict[str, float]) -> list[str]:
    one, two, dask = (np.array(ways[name].blocks) for name in (ONE, TWO, DASK))
    same = all(ways[name].results == ways[ONE].results for name in (TWO, DASK))
    dasks = f"{one.sum() / dask.sum():.2f} times (by blocks {_range(one / dask)})"
    costs, typical = 100.0 * (dask / two - 1.0), float(np.median(ways[DASK].walls))
    cost = 100.0 * (dask.sum() / two.sum() - 1.0)
    each = ", ".join(f"{1e3 * seconds:.1f} ms with {name}" for name, seconds in empty.items())
    return [
        f"- two processes are {one.sum() / two.sum():.2f} times as fast as one worker (asked for: {TWICE}; by blocks",
        f"  {_range(one / two)}), two workers of Dask {dasks}",
        f"- Dask costs {cost:.1f} % against two processes (asked for: less than {DASK_COST:.0f} %; by blocks",
        f"  {_range(costs, 1)} %)",
        f"- a task that does nothing takes {each}, which is {100.0 * empty[DASK] / typical:.2f} % of a run",
        f"- results are {'the same' if same else 'NOT THE SAME'} for all three",
    ]


def _range(values: np.ndarray, digits: int = 2) -> str:
    return f"{values.min():.{digits}f} to {values.max():.{digits}f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--runs", type=int)
    options = parser.parse_args()
    print("\n".join(campaign_section(options.quick, options.runs)))


if __name__ == "__main__":
    main()
