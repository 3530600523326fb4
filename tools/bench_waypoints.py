"""Ring after ring by `navigate --via`, and what a monitor of Groot2 costs: the section `waypoints` of BENCHMARKS.md.

Usage: python tools/bench_waypoints.py [--quick].
"""

from __future__ import annotations

import statistics
import struct
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import zmq

import mazeplan
from mazeplan.btree.monitor.server import Monitor
from mazeplan.core.logs.run_log import read_log
from mazeplan.core.records import NavigationResult

VIA, ORDER = ("ring3", "ring2", "ring3"), [1, 2, 3, 2, 3, 4, 5]
PORT = 16_670
WAYS = ("no monitor", "monitor", "monitor, asked 25 times a second", "monitor, a client that hangs")


def waypoint_runs(count: int) -> list[NavigationResult]:
    """Runs from ring 1 by VIA to the centre, seeds 0 to count - 1."""
    return [mazeplan.navigate(1, 5, rig="toy", via=VIA, seed=seed, time_limit=30.0) for seed in range(count)]


@contextmanager
def watched(way: str) -> Iterator[Monitor | None]:
    """A monitor, and a client that asks or hangs."""
    if way == WAYS[0]:
        yield None
        return
    context = zmq.Context()
    with Monitor(PORT) as monitor:
        client = context.socket(zmq.DEALER)
        client.setsockopt(zmq.LINGER, 0)
        client.connect(f"tcp://127.0.0.1:{PORT}")
        if way == WAYS[3]:  # asks, and never reads an answer
            for number in range(200):
                client.send_multipart([b"", struct.pack("<BBI", 2, ord("T"), number)])
        if way != WAYS[2]:
            yield monitor
        else:
            with _asking(client):
                yield monitor
        context.destroy(linger=0)


@contextmanager
def _asking(client: zmq.Socket) -> Iterator[None]:
    over = threading.Event()

    def ask() -> None:
        number = 0
        while not over.wait(0.04):
            for kind in "SB":
                client.send_multipart([b"", struct.pack("<BBI", 2, ord(kind), number)])
                number += 1
                while client.poll(0):
                    client.recv_multipart()

    thread = threading.Thread(target=ask, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def tick_ms(way: str, seed: int, folder: Path) -> float:
    """Mean wall time of a tick, ms, of a run with the packaged tree."""
    log = folder / "run.mcap"
    log.unlink(missing_ok=True)
    with watched(way) as monitor:
        mazeplan.navigate(1, 5, seed=seed, log=log, watch=None if monitor is None else monitor.watch)
    return float(np.nanmean(read_log(log).ticks["tick_ms"]))


def waypoints_section(quick: bool) -> list[str]:
    """Everything, as lines of Markdown."""
    runs = waypoint_runs(3 if quick else 20)
    arrived = [run for run in runs if run.success and [p.ring for p in run.rings] == ORDER]
    times = {way: list[float]() for way in WAYS}
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(3 if quick else 12):
            for way in WAYS if seed % 2 else reversed(WAYS):  # side by side, none always first
                times[way].append(tick_ms(way, seed, Path(folder)))
    plain = statistics.median(times[WAYS[0]])
    return [
        "## Ring after ring, and trees in Groot2 (simulated)",
        "",
        f"`mazeplan navigate --from ring1 --to ring5 --via {','.join(VIA)}` on the toy, seeds 0 to {len(runs) - 1}: "
        f"{len(arrived)} of {len(runs)} arrive by these",
        f"rings in this order, after {statistics.mean(r.time_s for r in arrived):.2f} s on average.",
        "",
        f"Wall time of a tick, the median of {len(times[WAYS[0]])} runs each, seeds from 0, in turn:",
        "",
        "| | tick, ms | times |", "|---|---|---|",
        *(f"| {way} | {statistics.median(t):.3f} | {statistics.median(t) / plain:.3f} |" for way, t in times.items()),
    ]  # fmt: skip


if __name__ == "__main__":
    print("\n".join(waypoints_section("--quick" in sys.argv)))
